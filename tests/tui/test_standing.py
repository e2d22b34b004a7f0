"""Where a robot is in its page: the running command, its line, its calls, their results and times."""

from __future__ import annotations

from robotree.tui.line import standing as words
from robotree.tui.seen.standing import standing, times
from robotree.vr.base.history_event import EventKind, HistoryEvent


def event(kind: EventKind, unix: float, robot: str, key: str, command: str, **more: object) -> HistoryEvent:
    return HistoryEvent(kind=kind, unix=unix, robot=robot, key=key, command=command, **more)  # type: ignore[arg-type] # fields of the event


TOLD = [
    event("accepted", 10.0, "lever", "k", "close", person="anna@pts/3"),
    event("accepted", 10.1, "mover", "k/2", "move", line=31, arguments={"x": 0.3}),
    event("accepted", 10.2, "arm-1", "k/2/1", "go_to", line=12),
    event("ended", 11.2, "arm-1", "k/2/1", "go_to"),
    event("ended", 11.3, "mover", "k/2", "move", value={"x": 0.3}),
    event("accepted", 11.4, "mover", "k/10", "grip", line=35),
]


def test_the_line_is_that_of_the_open_call_and_steps_stand_in_their_order() -> None:
    found = standing("lever", reversed([*TOLD, *TOLD]))  # two files have kept the same
    assert found is not None
    assert (found.command, found.asked, found.runs, found.line) == ("close", "anna@pts/3", True, 35)
    assert [(one.step, one.depth, one.open) for one in found.steps] == [
        ("2", 0, False), ("2/1", 1, False), ("10", 0, True),
    ]  # fmt: skip
    assert times(found, 13.4) == [("mover.grip", 1, 2.0), ("mover.move", 1, found.steps[0].took)]


def test_a_paused_robot_says_itself_where_it_waits() -> None:
    found = standing("lever", TOLD[:-1], held="step 10: mover.grip(width=0.02), line 35")
    assert found is not None
    assert found.line == 35
    text = words.lines(found, [f"# line {number}" for number in range(1, 40)], 12.0)
    assert "paused before step 10: mover.grip(width=0.02), line 35" in text[0]
    assert "→   35  # line 35" in text
    assert any("move x=0.3  1.20 s  x 0.3  line 31" in line for line in text)


def test_between_two_commands_the_last_one_is_shown_with_its_result() -> None:
    over = event("ended", 20.0, "lever", "k", "close", error="ChildFailed")
    found = standing("lever", [*TOLD, over])
    assert found is not None
    assert (found.runs, found.line, found.error) == (False, 0, "ChildFailed")
    assert words.head(found, 30.0).startswith("nothing runs; the last was lever.close: 10.00 s  ChildFailed")


def test_a_command_that_runs_goes_before_one_that_ended_later() -> None:
    beside = [
        event("accepted", 12.0, "lever", "q", "tune"),
        event("ended", 12.5, "lever", "q", "tune"),
    ]
    found = standing("lever", [*TOLD, *beside])
    assert found is not None
    assert found.command == "close"


def test_of_whom_nothing_is_kept_nothing_is_said() -> None:
    assert standing("arm-9", TOLD) is None
