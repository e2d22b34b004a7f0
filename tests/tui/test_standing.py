"""Where a robot is in its page: the running command, its line, its calls, their results and times."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

from robotree.tui.line import standing as words
from robotree.tui.line.past import chain_text, event_line, known_commands
from robotree.tui.seen import wording
from robotree.tui.seen.standing import standing, times
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription, SlotSpec
from robotree.vr.base.history_event import EventKind, HistoryEvent
from robotree.vr.supervision.past import explain

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient


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
    text = words.lines(found, [f"# line {number}" for number in range(1, 40)], 12.0, {})
    assert "paused before step 10: mover.grip(width=0.02), line 35" in text[0]
    assert "→   35  # line 35" in text
    assert any("move x=0.3  1.20 s  x 0.3  line 31" in line for line in text)


def test_between_two_commands_the_last_one_is_shown_with_its_result() -> None:
    over = event("ended", 20.0, "lever", "k", "close", error="ChildFailed")
    found = standing("lever", [*TOLD, over])
    assert found is not None
    assert (found.runs, found.line, found.error) == (False, 0, "ChildFailed")
    assert words.head(found, 30.0, {}).startswith(
        "nothing runs; the last was lever.close: 10.00 s  ChildFailed"
    )


def test_a_command_that_runs_goes_before_one_that_ended_later() -> None:
    beside = [
        event("accepted", 12.0, "lever", "q", "tune"),
        event("ended", 12.5, "lever", "q", "tune"),
    ]
    found = standing("lever", [*TOLD, *beside])
    assert found is not None
    assert found.command == "close"


GO = CommandSpec(
    name="go_to",
    parameters=(
        FieldSpec(name="x", type="float", unit="m"),
        FieldSpec(name="y", type="float", unit="m"),
        FieldSpec(name="twist", type="float", unit="rad"),
    ),
    result=(FieldSpec(name="", type="int"),),
)
LOST = event(
    "accepted", 10.0, "arm-1", "g/1", "go_to", caller="greeter",
    arguments={"x": 0.3, "y": -3.4e-12, "twist": 0.7854},
)  # fmt: skip


def test_a_call_without_an_end_runs_only_where_the_state_says_that_the_robot_is_busy() -> None:
    later = [
        event("accepted", 20.0, "arm-1", "h", "go_to"),
        event("ended", 21.0, "arm-1", "h", "go_to", value=2),
    ]
    last = standing("arm-1", [LOST, *later], busy="")
    assert last is not None
    assert (last.key, last.runs, last.took) == ("h", False, 1.0)
    assert words.head(last, 560.0, {"arm-1.go_to": GO}).endswith("arm-1.go_to: 1.00 s  result 2")
    below = event("accepted", 11.0, "wrist", "g/1/1", "turn")
    lost = standing("arm-1", [LOST, below], busy="")
    assert lost is not None
    assert (lost.runs, lost.line, lost.steps[0].open) == (False, 0, False)
    assert [line.partition("its end")[2] for line in words.lines(lost, (), 560.0, {})][:2] == [
        " is not known: it was interrupted, asked for by greeter",
        " is not known: it was interrupted",
    ]


def test_of_calls_without_an_end_the_latest_runs_before_which_none_waits() -> None:
    runs = event("accepted", 20.0, "arm-1", "h", "go_to")
    waits = event("accepted", 21.0, "arm-1", "i", "go_to")
    found = standing("arm-1", [LOST, runs, waits], busy="go_to", waiting=1)
    assert found is not None
    assert (found.key, found.runs) == ("h", True)


def test_arguments_have_the_units_of_the_command_and_angles_are_in_degrees() -> None:
    found = standing("arm-1", [LOST], busy="go_to")
    assert found is not None
    head = words.head(found, 12.0, {"arm-1.go_to": GO})
    assert head == "arm-1.go_to x=0.3 m y=0 m twist=45 ° has run for 2.0 s, asked for by greeter"
    assert wording.given(GO.by_name["x"], "30 cm") == "0.3 m"
    assert wording.given(GO.by_name["x"], "far") == "far"


def test_the_past_is_written_without_noise() -> None:
    assert "arm-1.go_to x=0.3 y=0 twist=0.7854  by greeter" in event_line(LOST, {})


def test_the_past_has_the_units_of_robots_that_live_and_angles_are_in_degrees() -> None:
    known = {"arm-1.go_to": GO}
    assert "arm-1.go_to x=0.3 m y=0 m twist=45 °  by greeter" in event_line(LOST, known)
    chain = explain(LOST.key, [("host h1", LOST)])
    assert chain is not None
    assert chain_text(chain, known).startswith("arm-1.go_to x=0.3 m y=0 m twist=45 °   on host h1")


async def test_what_was_read_of_a_child_has_its_units() -> None:
    robots = {
        "mover": RobotDescription(
            address=Address("robot", "mover", "1"), kinds=("MoveTo",), host="h1",
            slots=(SlotSpec(name="arm", kind="Arm", child=Address("robot", "arm-1", "2")),),
        ),
        "arm-1": RobotDescription(
            address=Address("robot", "arm-1", "2"), kinds=("Arm",), units={"x": "m", "twist": "rad"}
        ),
    }  # fmt: skip

    async def describe(name: str) -> RobotDescription:
        return robots[name]

    realm_client = cast("RealmClient", SimpleNamespace(describe=describe))
    value = {"x": 0.3, "twist": 1.5708, "age": 2.0}
    read = event("observed", 10.0, "mover", "k/1", "", arguments="arm", value=value)
    known = await known_commands(realm_client, ["mover"], [read])
    assert event_line(read, known).endswith("arm = x 0.3 m, twist 90 °, age 2  [k/1]")
    assert event_line(read, {}).endswith("arm = x 0.3, twist 1.571, age 2  [k/1]")


def test_of_whom_nothing_is_kept_nothing_is_said() -> None:
    assert standing("arm-9", TOLD) is None
