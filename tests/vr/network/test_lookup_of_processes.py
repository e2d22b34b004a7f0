"""Lookup, robots and hosts as real processes over real Zenoh: killed, stopped, and back."""

from __future__ import annotations

import signal
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from robotree.vr.network.local import LocalTransport
from robotree.vr.supervision.fleet import Fleet
from robotree.vr.world.promises import PROMISED_WITHIN
from robotree.vr.world.testing import until
from tests.vr.network.processes import Start, start_all

CARRIER = """
from robotree.vr import Child, VirtualRobot

class Carrier(VirtualRobot):
    rover = Child("Rover")
    move = rover.exposed("move")
"""


class Onlooker:
    """A fleet, and what it was told."""

    def __init__(self, fleet: Fleet) -> None:
        self.fleet = fleet
        self.told: list[str] = []
        fleet.directory.on_change(
            lambda change: (
                self.told.append(f"{change.kind} {change.listing.name}") if change.listing else None
            )
        )

    @property
    def names(self) -> list[str]:
        return [listing.name for listing in self.fleet.robots()]


@pytest.fixture
async def onlooker(join_realm: Callable[[], Awaitable[LocalTransport]]) -> AsyncIterator[Onlooker]:
    fleet = Fleet(await join_realm())
    onlooker = Onlooker(fleet)
    await fleet.start()
    yield onlooker
    await fleet.close()


async def test_lookups_are_killed_and_stopped_and_nobody_notices(start: Start, onlooker: Onlooker) -> None:
    *lookups, rover = await start_all(
        start, ("lookup", "l1"), ("lookup", "l2"), ("lookup", "l3"), ("robot", "rover")
    )
    fleet = onlooker.fleet
    await until(lambda: onlooker.told == ["arrived rover"], "a robot is listed, once")
    await until(lambda: list(fleet.services) == ["l1", "l2", "l3"], "all three are there")
    lookups[0].signal(signal.SIGKILL)
    lookups[1].signal(signal.SIGSTOP)
    assert await fleet.call("rover", "move", {"x": 1.0}) == 1.0
    await until(lambda: list(fleet.services) == ["l3"], "only one is left")
    lookups[1].signal(signal.SIGCONT)
    await until(lambda: list(fleet.services) == ["l2", "l3"], "the stopped one is back")
    await fleet.directory.settled(PROMISED_WITHIN)
    await until(lambda: not fleet.directory.remembers, "what the lost ones said is forgotten")
    assert onlooker.told == ["arrived rover"]
    for lookup in lookups[1:]:
        lookup.signal(signal.SIGKILL)
    await until(lambda: fleet.stale, "all are gone")
    assert await fleet.call("rover", "move", {"x": 2.0}) == 2.0, "robots obey those who know them"
    assert onlooker.names == ["rover"]
    await start_all(start, ("lookup", "l4"))
    await until(lambda: list(fleet.services) == ["l4"], "a new one is there")
    await until(lambda: not fleet.directory.remembers, "what the lost ones said is forgotten")
    assert onlooker.told == ["arrived rover"], "all have registered again before the old list was forgotten"
    rover.signal(signal.SIGKILL)
    killed = time.perf_counter()
    await until(lambda: onlooker.told[1:] == ["departed rover"], "a death is noticed")
    assert time.perf_counter() - killed < 0.5


async def test_the_child_of_a_killed_parent_is_back_within_a_second(
    start: Start, onlooker: Onlooker, tmp_path: Path
) -> None:
    _, host, _ = await start_all(start, ("lookup", "l1"), ("host", "h1"), ("robot", "rover"))
    fleet = onlooker.fleet
    source = tmp_path / "carrier.py"
    source.write_text(CARRIER)
    await until(lambda: onlooker.names == ["rover"], "the rover is listed")
    assert (await fleet.create(str(source), "carrier")).host == "h1"
    await fleet.enslave("carrier", "rover", "rover")
    await until(lambda: onlooker.names == ["carrier"], "the parent is listed, the child is not")
    assert await fleet.call("carrier", "move", {"x": 3.0}) == 3.0
    assert [robot.name for robot in await fleet.tree()] == ["carrier", "rover"]
    host.signal(signal.SIGKILL)
    killed = time.perf_counter()
    await until(lambda: onlooker.names == ["rover"], "the child is listed again")
    assert time.perf_counter() - killed < 1.0
    assert await fleet.call("rover", "move", {"x": 4.0}) == 4.0


async def test_members_end_in_order_when_their_tether_is_cut(start: Start, onlooker: Onlooker) -> None:
    members = await start_all(start, ("lookup", "l1"), ("host", "h1"), ("robot", "rover"))
    await until(lambda: onlooker.names == ["rover"], "the rover is listed")
    for member in members:
        assert await member.end() == (0, "")
    await until(lambda: onlooker.fleet.stale and onlooker.names == [], "all have left")
    assert await onlooker.fleet.hosts() == []
