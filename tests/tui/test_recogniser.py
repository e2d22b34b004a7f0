"""The companion's demo reports who is there to each run of the script, also to one that was started again."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.tui import demo_companion
from robotree.vr.base.errors import CommandFailed


class Flat:
    """What the recogniser asks of a realm client."""

    def __init__(self) -> None:
        self.heard, self.starts, self.runs = "", 0, False
        self.reported: list[tuple[str, str]] = []

    async def describe(self, name: str) -> Any:
        leads = {"condition": demo_companion.LEADS} if self.runs else {}
        return SimpleNamespace(
            attributes={"heard": self.heard, **leads}, calls={"start": self.starts} if name != "head" else {}
        )

    async def call(self, robot: str, command: str, arguments: dict[str, str]) -> None:
        if not self.runs:
            raise CommandFailed(robot=robot, command=command, detail="it is not started")
        self.reported.append((command, arguments["who"]))

    def start(self) -> None:
        self.runs, self.starts = True, self.starts + 1


class Builder:
    """A realm client that notes what is asked of it."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, ...]] = []

    async def enslave(self, parent: str, slot: str, child: str) -> None:
        self.asked.append(("enslave", f"{parent}.{slot}", child))

    async def call(self, robot: str, command: str, arguments: dict[str, str], deadline: float) -> None:
        del deadline
        self.asked.append((robot, command, *arguments.values()))


async def test_the_companion_stands_at_the_door_where_visitors_come_before_the_script_has_it() -> None:
    realm_client = Builder()
    await demo_companion.Companion().open(realm_client)  # type: ignore[arg-type]
    assert realm_client.asked == [("companion", "go_to", "door"), ("enslave", "evening.robot", "companion")]


async def test_who_is_there_is_reported_to_each_run_of_the_script(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(demo_companion, "LISTEN", 0.0)
    flat = Flat()
    recogniser = asyncio.ensure_future(demo_companion.Companion().accompany(flat, print))  # type: ignore[arg-type]

    async def passes() -> None:
        for _ in range(20):
            await asyncio.sleep(0)

    flat.heard = "1 11 Good day, I am Anna."
    await passes()
    assert flat.reported == [], "the script does not run"
    flat.start()
    await passes()
    assert flat.reported == [("person_seen", "anna")]
    flat.start()
    await passes()
    assert flat.reported == [("person_seen", "anna")] * 2, "the next run knows nobody"
    flat.heard = "2 11 Thank you very much."
    await passes()
    flat.start()
    flat.heard = "3 12 Good day, I am Bela."
    await passes()
    assert flat.reported[2:] == [("person_seen", "bela")], "Anna has her cup and leaves"
    flat.heard = "4 12 I am sorry, I have to go."
    await passes()
    assert flat.reported[3:] == [("person_left", "bela")]
    recogniser.cancel()
    with suppress(asyncio.CancelledError):
        await recogniser
