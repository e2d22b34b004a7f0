"""Robots that move between two hosts: stories with real threads and journals, in one process."""

from __future__ import annotations

import asyncio
import os
import re
from typing import Any

import pytest

from robotree.vr.agents import moving
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import CannotMove, CommandCancelled, NoAnswer, VrError
from robotree.vr.base.principal import Principal, user_name
from robotree.vr.base.requests import MoveDecided, TakeRobot
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import Gate
from robotree.vr.exchange.client import HostClient
from tests.vr.moving.conftest import HEADER, Stage

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


async def touring(stage: Stage, steps: int = 20) -> asyncio.Task[object]:
    """Have a tour begin in h1, over a leaf in h3."""
    await stage.add("h1", "h2", "h3")
    await stage.create("h3", "leaf", LEAF)
    await stage.create("h1", "tour", TOUR)
    await stage.enslave("tour", "arm", "leaf")
    call = asyncio.ensure_future(stage.robot("tour").call("tour", {"steps": steps}))
    await stage.until(lambda: stage.field("leaf", "done") != [])
    return call


async def test_who_wanted_a_move_and_what_came_of_it_is_kept(stage: Stage) -> None:
    call = await touring(stage, 30)
    with sitting_at("pts/3"):
        await stage.migrate("tour", "h2")
    with pytest.raises(VrError, match="nowhere"):
        await stage.migrate("tour", "nowhere")
    stage.homes["h1"].host.gate = Gate(any_signer=True)  # as with --isolate: it takes none
    stage.homes["h1"].host.isolate = "process"
    with pytest.raises(CannotMove, match="keeps its code apart"):
        await stage.migrate("tour", "h1")
    moved, refused = await stage.noted("tour")
    who = f"{user_name(os.geteuid())}@pts/3"
    assert (moved.person, moved.command, moved.error) == (who, "tour", "")
    assert re.fullmatch(
        rf"it moved from host h1 to h2 for {who}, and stood still for \d+\.\d ms; tour goes on",
        moved.text,
    )
    assert refused.text.startswith("it did not move to h1: ")
    assert moved.key == refused.key, "both are told of the command that they met"
    assert await call == list(range(30))
    assert await stage.noted("tour", "back") == [], "no host has ended"


async def test_a_robot_that_was_not_taken_goes_on_where_it_was(stage: Stage) -> None:
    call = await touring(stage)
    moves = stage.homes["h2"].host.moves
    answer, taken, refused = moves.answer, [], []

    async def lost(request: Any, *more: Any) -> Any:
        if isinstance(request, TakeRobot):
            taken.append(request)
            for other in ("host/h3/x", "robot/r/x"):
                refused.extend(
                    await asyncio.gather(answer(request, Principal(agent=other)), return_exceptions=True)
                )
            raise NoAnswer(key="h2", seconds=0.0)
        return await answer(request, *more)

    moves.answer = lost  # type: ignore[method-assign]
    with pytest.raises(CannotMove, match="the other host has not taken it"):
        await stage.migrate("tour", "h2")
    assert "another host was to send it" in str(refused[0])
    assert "only a host sends robots" in str(refused[1])
    assert stage.where("tour") == ["h1"]
    assert await call == list(range(20))
    assert stage.field("leaf", "done") == list(range(20))
    late = await answer(taken[0], Principal(agent="host/h1/x"))  # a copy that comes after "never"
    assert late == MoveDecided(taken=False)
    assert stage.where("tour") == ["h1"]


async def test_a_page_moves_itself_and_goes_on_there(stage: Stage) -> None:
    page = """
class Roamer(VirtualRobot):
    places: list[str] = state([])

    @command
    def roam(self, hosts: list[str]) -> list[str]:
        for host in hosts:
            self.move_to(host)
            self.places = [*self.places, host]
        return self.places
"""

    await stage.add("h1", "h2")
    await stage.create("h1", "roamer", page)
    way = ["h2", "h2", "h1", "h2"]
    assert await stage.robot("roamer").call("roam", {"hosts": way}) == way
    await stage.until(lambda: stage.where("roamer") == ["h2"])
    assert stage.home_of("roamer").host.agents["roamer"].runtime.core.state.moves == 3
    with pytest.raises(VrError, match="nowhere"):
        await stage.robot("roamer").call("roam", {"hosts": ["nowhere"]})


async def acted_again(stage: Stage) -> None:
    """Wait until the leaf has done one thing more."""
    before = len(stage.field("leaf", "done"))
    await stage.until(lambda: len(stage.field("leaf", "done")) > before)


async def test_relatives_in_one_host_become_far_ones_and_back(stage: Stage) -> None:
    await stage.add("h1", "h2")
    await stage.create("h1", "leaf", LEAF)
    await stage.create("h1", "tour", TOUR)
    await stage.enslave("tour", "arm", "leaf")
    address = stage.robot("tour").address
    call = asyncio.ensure_future(stage.robot("tour").call("tour", {"steps": 40}))
    for name, host in (("tour", "h2"), ("leaf", "h2"), ("tour", "h1"), ("leaf", "h1")):
        await acted_again(stage)
        await stage.migrate(name, host)
    assert await call == list(range(40))
    assert stage.field("leaf", "done") == list(range(40))
    assert stage.field("tour", "count") == 40
    assert (stage.where("tour"), stage.where("leaf")) == (["h1"], ["h1"])
    assert stage.robot("tour").address == address
    assert await stage.robot("tour").call("tour", {"steps": 2}) == [0, 1]


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("self.file = open(__file__) if False else __import__('io').StringIO()", "self.file is an open file"),
        ("self.count = 3", "self.count was set outside of declared state"),
        ("self.lock = threading.Lock()", "self.lock is a lock"),
    ],
)
async def test_what_cannot_travel_is_named_before_anything_is_frozen(
    stage: Stage, line: str, reason: str
) -> None:
    page = f"""
import threading

class Tied(VirtualRobot):
    @command
    def bind(self) -> None:
        {line}
"""

    await stage.add("h1", "h2")
    await stage.create("h1", "tied", page)
    await stage.robot("tied").call("bind", {})
    prepared: list[str] = []
    stage.homes["h2"].host.moves.moment = prepared.append  # type: ignore[method-assign]
    with pytest.raises(CannotMove) as refused:
        await stage.migrate("tied", "h2")
    assert reason in str(refused.value)
    assert prepared == []
    assert stage.home_of("tied").host.agents["tied"].runtime.ice is None


async def test_a_page_that_computes_does_not_move_now_and_goes_on(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(moving, "STAND_WITHIN", 0.2)
    page = """
class Thinker(VirtualRobot):
    going: bool = state(False)
    enough = False

    @command
    def think(self) -> int:
        self.going = True
        while not type(self).enough:
            pass
        return 1
"""

    await stage.add("h1", "h2")
    await stage.create("h1", "thinker", page)
    call = asyncio.ensure_future(stage.robot("thinker").call("think", {}))
    await stage.until(lambda: bool(stage.field("thinker", "going")))
    with pytest.raises(CannotMove, match="has not come to a wait"):
        await stage.migrate("thinker", "h2")
    type(stage.homes["h1"].host.agents["thinker"].robot).enough = True  # type: ignore[attr-defined]
    assert await call == 1


async def test_a_stop_before_it_is_out_cancels_the_move(stage: Stage) -> None:
    call = await touring(stage, 200)
    moves, robot = stage.homes["h1"].host.moves, stage.robot("tour")
    stops: list[asyncio.Future[Any]] = []

    def stop(place: str) -> None:
        if place == "frozen":
            stage.homes["h1"].host.agents["tour"].on_stop("test", "order-1")
            stops.append(asyncio.ensure_future(robot.safe_stop("test", order="order-1")))

    moves.moment = stop  # type: ignore[method-assign]
    with pytest.raises(CannotMove, match="it was stopped: test"):
        await stage.migrate("tour", "h2")
    assert set(await stops[0]) == {"tour", "leaf"}
    assert stage.where("tour") == ["h1"]
    with pytest.raises(VrError):
        await call


async def test_a_stop_passes_a_robot_in_doubt_to_its_children_and_reaches_it_where_it_goes_on(
    stage: Stage,
) -> None:
    call = await touring(stage, 500)
    robot = stage.robot("tour")
    moving, late = await held_on_its_way(stage)
    leaf = stage.homes["h3"].host.agents["leaf"].runtime
    stop = asyncio.ensure_future(robot.safe_stop("halt", order="order-2", timeout=30.0))
    await stage.until(lambda: leaf.look(lambda state: bool(state.stop.in_force)))
    assert not stop.done()  # nobody has the robot now, so nobody confirms it
    late.set()
    await stage.until(moving.done)
    assert set(await stop) >= {"tour"}
    (where,) = stage.where("tour")
    agent = stage.homes[where].host.agents["tour"]
    assert agent.runtime.look(lambda state: state.stop.in_force) != ""
    with pytest.raises(VrError):
        await call
    await asyncio.gather(moving, return_exceptions=True)


async def test_a_stop_that_comes_to_the_old_host_is_told_with_the_question_for_the_word(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(moving, "ANSWERED_WITHIN", 0.5)

    call = await touring(stage, 500)
    moves = stage.homes["h2"].host.moves
    answer = moves.answer

    async def lost(request: Any, *more: Any) -> Any:
        reply = await answer(request, *more)
        if isinstance(request, TakeRobot):
            old.on_stop("halt", "order-3")
            await asyncio.sleep(1.0)
        return reply

    moves.answer = lost  # type: ignore[method-assign]
    old = stage.homes["h1"].host.agents["tour"]
    await stage.migrate("tour", "h2")
    assert stage.where("tour") == ["h2"]
    new = stage.homes["h2"].host.agents["tour"].runtime
    await stage.until(lambda: new.look(lambda state: state.stop.in_force) != "")
    with pytest.raises(VrError):
        await call


async def held_on_its_way(stage: Stage) -> tuple[asyncio.Future[str], asyncio.Event]:
    """Have the tour set out for h2, which does not take it before it is let to."""
    moves, late = stage.homes["h2"].host.moves, asyncio.Event()
    answer = moves.answer

    async def slow(request: Any, *more: Any) -> Any:
        if isinstance(request, TakeRobot):
            await late.wait()
        return await answer(request, *more)

    moves.answer = slow  # type: ignore[method-assign]
    moving = asyncio.ensure_future(stage.migrate("tour", "h2"))
    runtime = stage.homes["h1"].host.agents["tour"].runtime
    await stage.until(lambda: runtime.in_doubt)
    return moving, late


async def test_a_cancel_that_comes_on_the_way_ends_the_command_where_it_goes_on(stage: Stage) -> None:
    call = await touring(stage, 500)
    moving, late = await held_on_its_way(stage)
    cancelling = asyncio.ensure_future(stage.robot("tour").cancel())
    await asyncio.sleep(0)  # it is sent
    late.set()
    await moving
    await cancelling
    with pytest.raises(CommandCancelled):
        await call
    assert stage.where("tour") == ["h2"]
    done = stage.field("leaf", "done")
    assert done == list(range(len(done))), "no step is done twice or left out"
    assert await stage.robot("tour").call("tour", {"steps": 2}) == [0, 1]
    assert stage.field("leaf", "done")[-2:] == [0, 1], "and nothing of it goes on"


async def test_a_doubt_may_last_longer_than_a_lease_and_its_child_waits_for_it(stage: Stage) -> None:
    stage.term = 0.5
    call = await touring(stage, 30)
    moving, late = await held_on_its_way(stage)
    await asyncio.sleep(1.5)  # three terms of a lease
    late.set()
    await moving
    assert await call == list(range(30))
    assert stage.field("leaf", "done") == list(range(30))


async def test_a_robot_moves_with_the_page_with_which_it_goes_on_since_a_reload(stage: Stage) -> None:
    call = await touring(stage, 10)
    newer = TOUR.replace("return found", "return [*found, -1]")
    client = HostClient(stage.operator, stage.homes["h1"].host.address)
    reloading = asyncio.ensure_future(client.reload(Bundle(HEADER + newer, "tour.py"), "tour"))
    assert await call == list(range(10)), "it turns when it comes to a boundary"
    await reloading
    call = asyncio.ensure_future(stage.robot("tour").call("tour", {"steps": 20}))
    await acted_again(stage)
    await stage.migrate("tour", "h2")
    assert await call == [*range(20), -1]
    assert await stage.robot("tour").call("tour", {"steps": 1}) == [0, -1]


SERVICE = """
from robotree.vr import Service

class Greeter(Service):
    behaviours = {"greet": "script: greet\\npartners:\\n  robot: {kind: Wheel}\\nrules: []\\n"}

    @command
    def count(self) -> int:
        return 1
"""


async def test_a_service_and_what_it_brings_stay_together_where_they_are(stage: Stage) -> None:
    """A service that moved would leave its behaviours behind, and nobody would end them with it."""
    await stage.add("h1", "h2")
    await stage.create("h1", "greeter", SERVICE)
    with pytest.raises(CannotMove, match="its behaviours stay here; delete it, and start it there"):
        await stage.migrate("greeter", "h2")
    with pytest.raises(CannotMove, match="the service greeter has brought it"):
        await stage.migrate("greeter-greet", "h2")
    assert stage.where("greeter") == stage.where("greeter-greet") == ["h1"]
    await stage.create("h1", "plain", SERVICE.replace("    behaviours", "    # behaviours"))
    await stage.migrate("plain", "h2")
    assert stage.where("plain") == ["h2"]
    await stage.robot("greeter").delete()
    assert stage.where("greeter-greet") == []
