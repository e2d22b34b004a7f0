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
from robotree.vr.supervision.realm_client import RealmClient

CUP = "blue cup"
CUPS = (CUP, "green cup", "red cup")
LONGEST = 240.0
"""[s] for a greeting, a way, a cup and a giving, on a busy machine."""


@pytest.fixture
async def realm_client(place: Path) -> AsyncIterator[RealmClient]:
    async with AsyncExitStack() as ties, Crew("evening", place) as crew:
        await cast(crew, speedup="3", file=STORY.file)
        realm_client = await ties.enter_async_context(joined("evening"))
        await realm_client.call(ROBOT, "go_to", {"place": "door"}, deadline=60.0)
        await realm_client.enslave(SCRIPT, "robot", ROBOT)
        yield realm_client
        await ties.aclose()


async def until(holds: Callable[[], Awaitable[object]]) -> None:
    async with asyncio.timeout(LONGEST):
        while not await holds():  # noqa: ASYNC110 # it asks other processes
            await asyncio.sleep(0.1)


async def begin(realm_client: RealmClient) -> str:
    """Start the script, and report Anna; returns where the cup is for it then."""
    await realm_client.tell(SCRIPT, "start", {}, deadline=900.0)

    async def knows_the_cup() -> bool:
        if (await realm_client.describe(SCRIPT)).attributes["condition"] != "active":
            return False  # its facts are those of its last run
        return await slot(realm_client, "cup", CUP, "place") not in {"", "unknown", "asked"}

    await until(knows_the_cup)
    await realm_client.call(SCRIPT, "person_seen", {"who": "anna"})
    return await slot(realm_client, "cup", CUP, "place")


async def slot(realm_client: RealmClient, kind: str, whose: str, name: str) -> str:
    """Return what a slot of a fact of the script holds; empty: there is no such fact."""
    for line in str(await realm_client.call(SCRIPT, "facts", {})).splitlines():
        if f"{kind}: {{" in line and whose in line and (found := re.search(rf"{name}: (\w+)", line)):
            return found.group(1)
    return ""


async def reaches(realm_client: RealmClient, kind: str, whose: str, name: str, value: str) -> None:
    async def holds() -> bool:
        return await slot(realm_client, kind, whose, name) == value

    await until(holds)


async def gives(realm_client: RealmClient) -> None:
    """Wait until the cup is on its way to the open hand."""

    async def under_way() -> bool:
        robot: Any = await realm_client.describe(ROBOT)
        return bool(robot.busy == "give")

    await until(under_way)
    await asyncio.sleep(1.0)


async def holds_a_cup(realm_client: RealmClient) -> bool:
    """Whether the left hand, with which it takes first, is closed about something as wide as a cup."""
    return 0.05 < (await realm_client.describe("left")).readings["width"] < 0.07


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.timeout(900)
async def test_stopped_while_it_gives_the_evening_puts_the_cup_back_and_serves_again(
    realm_client: RealmClient,
) -> None:
    await until(lambda: said(realm_client, "Good day, I am Anna."))
    assert await begin(realm_client) in {"unseen", "table"}
    await gives(realm_client)

    # everything is stopped: the script is over, and a person starts it again
    await realm_client.stop(None)
    assert await holds_a_cup(realm_client)
    await realm_client.resume(None)
    await asyncio.sleep(1.0)
    assert await holds_a_cup(realm_client), "nothing moves by the release"
    assert await begin(realm_client) == "putting", "it is not on the table, and is put back there"
    await reaches(realm_client, "cup", CUP, "place", "table")
    assert not await holds_a_cup(realm_client), "it is booked where it is"
    await gives(realm_client)

    # the robot alone is stopped: the script waits, and goes on when the robot is released
    await realm_client.stop(ROBOT)
    await reaches(realm_client, "partner", ROBOT, "state", "stopped")
    assert await holds_a_cup(realm_client)
    await realm_client.resume(SCRIPT)
    await until(lambda: said(realm_client, "Thank you very much."))
    await reaches(realm_client, "visitor", "anna", "stage", "over")
    places = {cup: await slot(realm_client, "cup", cup, "place") for cup in CUPS}
    assert places.pop(CUP) == "anna", "she has the one cup that was ever taken"
    assert set(places.values()) <= {"unseen", "table"}, "the others stand where they stood"
    assert not await holds_a_cup(realm_client)


async def said(realm_client: RealmClient, text: str) -> bool:
    return (await heard(realm_client, 0))[2] == text
