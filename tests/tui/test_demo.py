"""Demos: the realm of one, what the demo of a crash says, who is reported to the companion."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from robotree.tui import demo, demo_companion
from robotree.tui.demo_crash import Goal, Verdict, verdict_of
from robotree.tui.errors import MemberFailed
from robotree.tui.exit_codes import REFUSED
from robotree.tui.wire.security import REALM_KEY
from robotree.vr.base.errors import CommandFailed
from robotree.vr.base.history_event import EventKind, HistoryEvent
from robotree.vr.network.realms import realm_folder

if TYPE_CHECKING:
    from pathlib import Path

    from robotree.tui.processes.crew import Crew


class Unlucky:
    """A demo whose first program does not start."""

    file = demo.CELL.file
    goals = None

    def __init__(self) -> None:
        self.realm = self.key = ""

    async def cast(self, crew: Crew, **_options: object) -> None:
        self.realm, self.key = crew.realm, crew._environment["ROBOTREE_KEY"]  # of its members
        raise MemberFailed(["sim"], "did not start", "")

    async def play(self, realm: str, folder: Path, *, readonly: bool) -> int:
        del realm, folder, readonly
        raise AssertionError


@pytest.mark.parametrize(("given", "wanted"), [("", "mine"), ("other", "other")])
async def test_a_demo_for_a_person_is_in_the_realm_of_the_environment(
    monkeypatch: pytest.MonkeyPatch, given: str, wanted: str
) -> None:
    monkeypatch.setenv("ROBOTREE_REALM", "mine")
    story = Unlucky()
    monkeypatch.setattr(demo, "cast", story.cast)
    assert await demo.demo(story, headless=False, realm=given, key="none") == REFUSED
    assert (story.realm, story.key) == (wanted, "none")


async def test_a_demo_of_a_script_leaves_neither_its_realm_nor_its_key(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    story, own = Unlucky(), realm_folder(demo.own_realm(headless=True))

    async def cast(crew: Crew, **options: object) -> None:
        assert (own / REALM_KEY).exists()
        await story.cast(crew, **options)

    monkeypatch.setattr(demo, "cast", cast)
    assert await demo.demo(story, headless=True, pictures=str(tmp_path)) == REFUSED
    assert (story.realm, story.key) == (own.name, str(own / REALM_KEY))
    assert not own.exists()


# -- the demo of a crash says what the controller and the histories say, and no more ---------------

STEPS = ["c/1/1", "c/1/2", "c/2/1"]


def event(robot: str, kind: EventKind, key: str, unix: float = 1.0, error: str = "") -> HistoryEvent:
    return HistoryEvent(kind=kind, unix=unix, robot=robot, key=key, error=error)


def verdict(**changes: Any) -> Verdict:
    """What comes of a command of three steps, with a kill after the second, unless a test says otherwise."""
    asked = changes.pop("asked", STEPS)
    answered = changes.pop("answered", STEPS)
    events = [event("lever", "accepted", "c"), event("lever", "ended", "c")]
    events += [event("arm-1", "accepted", key, number) for number, key in enumerate(asked)]
    events += [event("mover", "answered", key, error=changes.pop("error", "")) for key in answered]
    said: dict[str, Any] = {
        "kills": [1.5],
        "goals": [Goal(float(number), f"{number}") for number in range(3)],
        "events": events,
        "angle": 0.8,
        "force": 9.0,
        "trouble": "",
        "wall": 1.0,
    }
    return verdict_of(**(said | changes))


def test_a_command_that_went_on_and_did_nothing_twice_is_good() -> None:
    found = verdict()
    assert (found.ok, found.kills, found.continued, found.goals) == (True, 1, 1, 3)
    assert (found.twice, found.lost, found.doubts) == (0, 0, 0)


@pytest.mark.parametrize(
    ("changes", "counted"),
    [
        ({"goals": [Goal(0.0, "1"), Goal(1.0, "2"), Goal(2.0, "3"), Goal(3.0, "3")]}, ("twice", 1)),
        ({"goals": [Goal(float(number), f"{number}") for number in range(4)]}, ("twice", 1)),
        ({"asked": [*STEPS, "c/2/1"]}, ("twice", 1)),
        ({"answered": STEPS[:2]}, ("twice", 1)),
        ({"goals": [Goal(0.0, "1"), Goal(1.0, "2")]}, ("lost", 1)),
        ({"error": "CommandInDoubt"}, ("doubts", 1)),
        ({"kills": [1.5, 2.5]}, ("continued", 1)),
        ({"kills": []}, ("kills", 0)),
        ({"angle": -0.7}, ("kills", 1)),
        ({"trouble": "the lever is stuck"}, ("twice", 0)),
    ],
)
def test_whatever_else_happened_is_counted_and_is_not_good(
    changes: dict[str, Any], counted: tuple[str, int]
) -> None:
    found = verdict(**changes)
    assert not found.ok
    assert getattr(found, counted[0]) == counted[1]


# -- the companion's demo reports who is there to each run of the script, also to one that was started again


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
