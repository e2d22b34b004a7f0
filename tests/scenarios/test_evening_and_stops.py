"""The companion's evening with real processes: stopped in the middle of giving, it serves again."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui.demo import cast
from robotree.tui.demo_companion import ROBOT, SCRIPT, STORY, heard
from robotree.tui.processes.crew import Crew
from robotree.vr.supervision.fleet import Fleet

CUP = "blue cup"
CUPS = (CUP, "green cup", "red cup")
LONGEST = 240.0
"""[s] for a greeting, a way, a cup and a giving, on a busy machine."""


@pytest.fixture
async def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Fleet]:
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with AsyncExitStack() as ties, Crew("evening", tmp_path) as crew:
        await cast(crew, speedup="3", file=STORY.file)
        fleet = await ties.enter_async_context(joined("evening"))
        await fleet.call(ROBOT, "go_to", {"place": "door"}, deadline=60.0)
        await fleet.enslave(SCRIPT, "robot", ROBOT)
        yield fleet
        await ties.aclose()


async def until(holds: Callable[[], Awaitable[object]]) -> None:
    async with asyncio.timeout(LONGEST):
        while not await holds():  # noqa: ASYNC110 # it asks other processes
            await asyncio.sleep(0.1)


async def begin(fleet: Fleet) -> str:
    """Start the script, and report Anna; returns where the cup is for it then."""
    await fleet.tell(SCRIPT, "start", {}, deadline=900.0)

    async def knows_the_cup() -> bool:
        if (await fleet.describe(SCRIPT)).attributes["condition"] != "active":
            return False  # its facts are those of its last run
        return await slot(fleet, "cup", CUP, "place") not in {"", "unknown", "asked"}

    await until(knows_the_cup)
    await fleet.call(SCRIPT, "person_seen", {"who": "anna"})
    return await slot(fleet, "cup", CUP, "place")


async def slot(fleet: Fleet, kind: str, whose: str, name: str) -> str:
    """Return what a slot of a fact of the script holds; empty: there is no such fact."""
    for line in str(await fleet.call(SCRIPT, "facts", {})).splitlines():
        if f"{kind}: {{" in line and whose in line and (found := re.search(rf"{name}: (\w+)", line)):
            return found.group(1)
    return ""


async def reaches(fleet: Fleet, kind: str, whose: str, name: str, value: str) -> None:
    async def holds() -> bool:
        return await slot(fleet, kind, whose, name) == value

    await until(holds)


async def gives(fleet: Fleet) -> None:
    """Wait until the cup is on its way to the open hand."""

    async def under_way() -> bool:
        robot: Any = await fleet.describe(ROBOT)
        return bool(robot.busy == "give")

    await until(under_way)
    await asyncio.sleep(1.0)


async def holds_a_cup(fleet: Fleet) -> bool:
    """Whether the left hand, with which it takes first, is closed about something as wide as a cup."""
    return 0.05 < (await fleet.describe("left")).readings["width"] < 0.07


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.timeout(900)
async def test_stopped_while_it_gives_the_evening_puts_the_cup_back_and_serves_again(
    fleet: Fleet,
) -> None:
    await until(lambda: said(fleet, "Good day, I am Anna."))
    assert await begin(fleet) in {"unseen", "table"}
    await gives(fleet)

    # everything is stopped: the script is over, and a person starts it again
    await fleet.stop(None)
    assert await holds_a_cup(fleet)
    await fleet.resume(None)
    await asyncio.sleep(1.0)
    assert await holds_a_cup(fleet), "nothing moves by the release"
    assert await begin(fleet) == "putting", "it is not on the table, and is put back there"
    await reaches(fleet, "cup", CUP, "place", "table")
    assert not await holds_a_cup(fleet), "it is booked where it is"
    await gives(fleet)

    # the robot alone is stopped: the script waits, and goes on when the robot is released
    await fleet.stop(ROBOT)
    await reaches(fleet, "partner", ROBOT, "state", "stopped")
    assert await holds_a_cup(fleet)
    await fleet.resume(SCRIPT)
    await until(lambda: said(fleet, "Thank you very much."))
    await reaches(fleet, "visitor", "anna", "stage", "over")
    places = {cup: await slot(fleet, "cup", cup, "place") for cup in CUPS}
    assert places.pop(CUP) == "anna", "she has the one cup that was ever taken"
    assert set(places.values()) <= {"unseen", "table"}, "the others stand where they stood"
    assert not await holds_a_cup(fleet)


async def said(fleet: Fleet, text: str) -> bool:
    return (await heard(fleet, 0))[2] == text
