"""The demo of a crash says what the controller and the histories say, and no more."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.tui.demo_crash import Goal, Verdict, verdict_of
from robotree.vr.base.history_event import EventKind, HistoryEvent

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
