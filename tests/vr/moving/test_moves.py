"""Robots that move between two hosts: stories with real threads and journals, in one process."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.errors import CannotMove, NoAnswer
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import MoveDecided, TakeRobot
from tests.vr.moving.stage import Stage, played

LEAF = """
class Leaf(VirtualRobot):
    done: list[int] = state([])

    @command(effect="once")
    def act(self, number: int) -> int:
        self.sleep(0.02)
        self.done = [*self.done, number]
        return number
"""
TOUR = """
class Tour(VirtualRobot):
    arm = Child("Leaf")
    count: int = state(0)

    @command
    def tour(self, steps: int) -> list[int]:
        found = []
        for number in range(steps):
            found.append(self.arm.act(number=number))
            self.count = self.count + 1
        return found
"""


def test_a_command_goes_on_in_the_other_host(tmp_path: Path) -> None:
    async def story(stage: Stage) -> None:
        await stage.add("h1", "h2", "h3")
        await stage.create("h3", "leaf", LEAF)
        await stage.create("h1", "tour", TOUR)
        await stage.enslave("tour", "arm", "leaf")
        before = stage.robot("tour").address
        call = asyncio.ensure_future(stage.robot("tour").call("tour", {"steps": 20}))
        await stage.until(
            lambda: stage.home_of("leaf").host.agents["leaf"].runtime.core.state.fields["done"] != []
        )
        await stage.migrate("tour", "h2")
        assert stage.where("tour") == ["h2"]
        assert await call == list(range(20))
        assert stage.robot("tour").address == before
        leaf = stage.home_of("leaf").host.agents["leaf"].runtime.core.state
        assert leaf.fields["done"] == list(range(20))
        assert stage.home_of("tour").host.agents["tour"].runtime.core.state.fields["count"] == 20
        await stage.migrate("tour", "h1")
        assert await stage.robot("tour").call("tour", {"steps": 2}) == [0, 1]

    played(tmp_path, story)


async def touring(stage: Stage, steps: int = 20) -> asyncio.Task[object]:
    """Have a tour begin in h1, over a leaf in h3."""
    await stage.add("h1", "h2", "h3")
    await stage.create("h3", "leaf", LEAF)
    await stage.create("h1", "tour", TOUR)
    await stage.enslave("tour", "arm", "leaf")
    call = asyncio.ensure_future(stage.robot("tour").call("tour", {"steps": steps}))
    await stage.until(lambda: stage.field("leaf", "done") != [])
    return call


def test_a_robot_that_was_not_taken_goes_on_where_it_was(tmp_path: Path) -> None:
    async def story(stage: Stage) -> None:
        call = await touring(stage)
        moves = stage.homes["h2"].host.moves
        answer, taken = moves.answer, []

        async def lost(request: Any, asker: Any) -> Any:
            if isinstance(request, TakeRobot):
                taken.append(request)
                raise NoAnswer(key="h2", seconds=0.0)
            return await answer(request, asker)

        moves.answer = lost  # type: ignore[method-assign]
        with pytest.raises(CannotMove, match="the other host has not taken it"):
            await stage.migrate("tour", "h2")
        assert stage.where("tour") == ["h1"]
        assert await call == list(range(20))
        assert stage.field("leaf", "done") == list(range(20))
        late = await answer(taken[0], Principal(agent="host/h1/x"))  # a copy that comes after "never"
        assert late == MoveDecided(taken=False)
        assert stage.where("tour") == ["h1"]

    played(tmp_path, story)
