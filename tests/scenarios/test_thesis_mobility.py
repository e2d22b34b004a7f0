"""What the thesis says of the mobility of virtual robots: a story for each of its claims and figure 1.2.

1.3.1 and figure 1.2: VR1 migrates to the machine of VR2, and both talk there without a network. 2.2: what is
far away is late. 2.3.2 and 3.2, "VR Mobility": the state travels, the moving robot does nothing; its children
pause their leases, its parent sends nothing, neither of them moves; who arrives late meets nobody else.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.errors import CannotMove
from robotree.vr.base.requests import TakeRobot
from tests.vr.moving.conftest import Stage, played
from tests.vr.moving.test_moves import LEAF, TOUR

pytestmark = pytest.mark.real_threads

TOP = """
class Top(VirtualRobot):
    tour = Child("Tour")

    @command
    def go(self, steps: int) -> list[int]:
        return self.tour.tour(steps=steps)
"""


async def built(stage: Stage, *, leaf: str = "b") -> None:
    """Build Top in c over Tour in a, over a leaf."""
    await stage.add("a", "b", "c")
    await stage.create(leaf, "leaf", LEAF)
    await stage.create("a", "tour", TOUR)
    await stage.create("c", "top", TOP)
    await stage.enslave("tour", "arm", "leaf")
    await stage.enslave("top", "tour", "tour")


async def delayed(stage: Stage) -> tuple[asyncio.Event, asyncio.Event]:
    """Have a robot that leaves for b be late; returns what tells that it is on its way, and what lets in."""
    moves = stage.homes["b"].host.moves
    answer, on_way, let_in = moves.answer, asyncio.Event(), asyncio.Event()

    async def late(request: Any, *more: Any) -> Any:
        if isinstance(request, TakeRobot):
            on_way.set()
            await let_in.wait()
        return await answer(request, *more)

    moves.answer = late  # type: ignore[method-assign]
    return on_way, let_in


def test_figure_1_2_a_robot_migrates_to_the_machine_of_its_partner_and_nothing_crosses_the_line(
    tmp_path: Path,
) -> None:
    async def story(stage: Stage) -> None:
        await built(stage)
        crossed: list[str] = []
        stage.network.on_message = lambda _from, _to, what, key, _body: crossed.append(f"{what} {key}")
        leaf = stage.robot("leaf").address.key
        assert await stage.robot("top").call("go", {"steps": 5}) == list(range(5))
        assert sum(one == f"ask {leaf}" for one in crossed) >= 5, "each command travels, and its value back"
        await stage.migrate("tour", "b")
        before = stage.field("tour", "count")
        crossed.clear()
        assert await stage.robot("top").call("go", {"steps": 5}) == list(range(5))
        assert f"ask {leaf}" not in crossed, "two threads of one process"
        assert stage.field("tour", "count") == before + 5, "the state has come along"

    played(tmp_path, story)


def test_vr_mobility_a_moving_robot_does_nothing_and_its_children_wait_for_it(tmp_path: Path) -> None:
    async def story(stage: Stage) -> None:
        await built(stage, leaf="c")
        on_way, let_in = await delayed(stage)
        call = asyncio.ensure_future(stage.robot("top").call("go", {"steps": 20}, deadline=60.0))
        await stage.until(lambda: len(stage.field("leaf", "done")) >= 3)
        moving = asyncio.ensure_future(stage.migrate("tour", "b"))
        await on_way.wait()
        await asyncio.sleep(0.2)
        done = stage.field("leaf", "done")
        await asyncio.sleep(1.0)
        assert stage.field("leaf", "done") == done, "it is a passive element"
        lease = stage.homes["c"].host.agents["leaf"].runtime.core.state.lease.current
        assert lease is not None
        assert lease.parent.name == "tour", "its child waits"
        let_in.set()
        await moving
        assert await call == list(range(20)), "its parent's call waited, and goes on"
        assert stage.field("leaf", "done") == list(range(20))

    played(tmp_path, story)


def test_vr_mobility_neither_parent_nor_child_moves_meanwhile_and_says_why(tmp_path: Path) -> None:
    async def story(stage: Stage) -> None:
        await built(stage, leaf="c")
        on_way, let_in = await delayed(stage)
        moving = asyncio.ensure_future(stage.migrate("tour", "b"))
        await on_way.wait()
        with pytest.raises(CannotMove, match="on its way to b"):
            await stage.migrate("tour", "c")
        top = asyncio.ensure_future(stage.migrate("top", "a"))
        await asyncio.sleep(0.2)
        let_in.set()
        await moving
        await asyncio.gather(top, return_exceptions=True)
        assert len(stage.where("top")) == 1
        assert await stage.robot("top").call("go", {"steps": 3}) == list(range(3))

    played(tmp_path, story)


def test_vr_mobility_who_is_late_is_nowhere_else_meanwhile_and_arrives_once(tmp_path: Path) -> None:
    """In the thesis a robot that is late is lost, and perhaps comes back to nobody; here nobody else acts."""

    async def story(stage: Stage) -> None:
        await built(stage, leaf="c")
        on_way, let_in = await delayed(stage)
        call = asyncio.ensure_future(stage.robot("top").call("go", {"steps": 15}, deadline=60.0))
        await stage.until(lambda: bool(stage.field("leaf", "done")))
        moving = asyncio.ensure_future(stage.migrate("tour", "b"))
        await on_way.wait()
        runtime = stage.homes["a"].host.agents["tour"].runtime
        await stage.until(lambda: runtime.in_doubt)
        assert "tour" not in stage.homes["b"].host.agents
        assert runtime.is_on_way, "where it was it does nothing"
        let_in.set()
        await moving
        assert stage.where("tour") == ["b"]
        assert await call == list(range(15))
        assert stage.field("leaf", "done") == list(range(15))

    played(tmp_path, story)
