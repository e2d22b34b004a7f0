"""The supervisor's memory: arrivals and departures tell themselves, silence is told from calm."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from robotree.tui.seen import rows
from robotree.tui.seen.store import FLASH, SILENCE, Store
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, CommandSpec, Listing, RobotDescription, SlotSpec
from robotree.vr.base.presence import Held
from robotree.vr.base.requests import HostDescribed, Level, LoggedLine, State


def address(name: str, incarnation: str = "1") -> Address:
    return Address("robot", name, incarnation)


def listing(name: str, kinds: tuple[str, ...] = ("Arm", "Robot"), incarnation: str = "1") -> Listing:
    return Listing(address=address(name, incarnation), kinds=kinds, doc="An arm.\n\nLong.")


def robot(name: str, **changes: Any) -> RobotDescription:
    return RobotDescription(address=address(name), kinds=changes.pop("kinds", ("Arm", "Robot")), **changes)


@pytest.fixture
def store() -> Store:
    found = Store()
    found.take_lists([listing("arm-1")], [], 0.0)
    return found


def texts(store: Store) -> list[str]:
    return [happening.text for happening in store.entries]


def test_what_is_there_at_the_beginning_is_no_news(store: Store) -> None:
    assert texts(store) == []
    assert store.joined


def test_arrivals_and_departures_tell_themselves_once(store: Store) -> None:
    store.take_lists([listing("arm-1"), listing("arm-2")], [], 1.0)
    store.take_lists([listing("arm-2")], [], 2.0)
    store.departed(address("arm-1"), 2.0, left=True)
    store.take_lists([listing("arm-2")], [], 3.0)
    assert texts(store) == ["arm-2 (Arm) is listed", "arm-1 (Arm) left the list"]


def test_what_an_agent_said_decides_if_it_has_left_or_is_lost(store: Store) -> None:
    store.take_lists([listing("arm-1"), listing("arm-2")], [], 1.0)
    store.take_lists([], [], 2.0)
    assert texts(store)[1:] == [], "why is to be found out"
    assert set(store.missed) == {address("arm-1"), address("arm-2")}
    store.departed(address("arm-1"), 3.0, left=False)
    store.departed(address("arm-2"), 3.0, left=True)
    assert texts(store)[1:] == ["arm-1 (Arm): its process has gone", "arm-2 (Arm) left the list"]
    assert set(store.absent) == {"arm-1"}, "who took its leave is not kept"
    assert store.absent["arm-1"].remedy == "its process has gone: start it again"


def test_who_starts_a_process_again_is_named(store: Store) -> None:
    store.restarter = "the demo"
    store.take_lists([], [], 2.0)
    store.departed(address("arm-1"), 3.0, left=False)
    assert store.absent["arm-1"].remedy == "its process has gone: the demo starts it again"


def test_what_lives_in_a_host_that_nobody_starts_again_is_brought_back_by_a_person(store: Store) -> None:
    """A host that was started by hand beside the demo."""
    store.restarter, store.restarts = "the demo", {"host-1"}.__contains__
    for name, host in (("mine", "h2"), ("of-demo", "host-1")):
        store.take_lists([msgspec.structs.replace(listing(name), host=host)], [], 2.0)
        store.take_lists([], [], 3.0)
        store.departed(address(name), 4.0, left=False)
    assert store.absent["mine"].remedy == "its process has gone: `robotree host h2` brings it back"
    assert store.absent["of-demo"].remedy == "its process has gone: the demo starts it again"


def test_a_robot_whose_listing_expires_stays_in_sight_until_it_is_known_why(store: Store) -> None:
    """Its process hangs: it answers no more, then its listing expires, and only then is it said to hang."""
    store.take_descriptions([], 1.5)
    store.take_lists([], [], 2.0)
    assert store.known == {"arm-1"}
    assert (store.status("arm-1", 2.0), store.doing("arm-1", 2.0)) == ("silent", "does not answer")
    assert rows.row(store, rows.family(store)[0], 2.0).state == "does not answer"
    store.departed(address("arm-1"), 3.0, left=True)
    assert store.known == set(), "it had taken its leave"
    assert (store.status("arm-1", 3.0), store.doing("arm-1", 3.0)) == ("gone", "has left")


def test_a_process_that_hung_woke_and_took_its_leave_has_not_died(store: Store) -> None:
    store.take_silent([Held("robot/arm-1/1", "process 31555", "")], 2.0)
    store.take_lists([], [], 3.0)
    store.departed(address("arm-1"), 4.0, left=True)
    assert (store.known, store.absent, store.missed) == (set(), {}, {})
    assert texts(store)[1:] == ["arm-1 (Arm) left the list"]


def test_who_leaves_the_list_and_answers_is_commanded_by_somebody(store: Store) -> None:
    store.take_lists([], [], 1.0)
    bond = BondSpec(parent=address("mover"), slot="arm", epoch=1, remaining=5)
    store.take_descriptions([robot("arm-1", bond=bond)], 1.0)
    store.found(address("arm-1"), 1.0)
    assert texts(store) == ["arm-1 (Arm) is commanded by mover.arm now"]


def test_who_hangs_leaves_with_no_wording_of_a_departure(store: Store) -> None:
    """Its listing expires while its presence still stands."""
    store.take_lists([], [], 1.0)
    store.take_silent([Held("robot/arm-1/1", "process 31555", "`kill -9 31555` ends it")], 2.0)
    assert texts(store) == ["arm-1 (Arm): its process hangs and does not answer; `kill -9 31555` ends it"]
    assert store.doing("arm-1", 3.0) == "HANGS (pid 31555)"
    assert store.missed == {}


def test_who_was_never_listed_leaves_no_list(store: Store) -> None:
    store.take_services([], 1.0, stale=True)
    store.take_lists([listing("arm-1"), listing("arm-2")], [], 1.0)
    store.take_services(["lookup-1"], 2.0, stale=False)
    store.take_lists([], [], 2.0)
    for name in ("arm-1", "arm-2"):
        store.found(address(name), 2.0)
    assert texts(store) == [
        "arm-2 (Arm) has come, but no lookup service lists it",
        "a lookup service is back",
    ]


def test_a_newcomer_stands_out_for_a_moment(store: Store) -> None:
    store.take_lists([listing("arm-1"), listing("arm-2")], [], 1.0)
    assert [store.came(name, 1.5) for name in ("arm-1", "arm-2")] == [False, True]
    assert not store.came("arm-2", 1.0 + FLASH)


def test_another_incarnation_is_a_newcomer(store: Store) -> None:
    store.take_lists([listing("arm-1", incarnation="2")], [], 1.0)
    assert texts(store) == ["arm-1 (Arm) is listed"]


@pytest.mark.parametrize(
    ("state", "status", "doing"),
    [
        (State(busy="go_to", waiting=2, readings={"progress": 0.4}), "busy", "go_to 40 % +2"),
        (State(busy="go_to", readings={"progress": float("nan")}), "busy", "go_to"),
        (State(bond=address("mover")), "enslaved", "under mover"),
    ],
)
def test_a_state_is_a_status(store: Store, state: State, status: str, doing: str) -> None:
    store.take_state("arm-1", state, 1.0)
    assert store.status("arm-1", 1.0) == status
    assert store.doing("arm-1", 1.0) == doing


def test_before_its_first_state_a_robot_is_as_it_described_itself(store: Store) -> None:
    store.take_descriptions([robot("arm-1", stopped=True)])
    assert (store.status("arm-1", 1.0), store.doing("arm-1", 1.0)) == ("stopped", "stopped")
    store.take_state("arm-1", State(busy="go_to"), 1.0)
    assert store.status("arm-1", 1.0) == "busy", "a state is newer"


def test_silence_is_not_calm(store: Store) -> None:
    store.take_state("arm-1", State(), 1.0)
    assert store.status("arm-1", 1.0 + SILENCE) == "free"
    assert store.doing("arm-1", 10.0) == "silent 9 s"


def test_what_an_operator_must_know_is_told_when_it_begins_and_when_it_ends(store: Store) -> None:
    shut = State(stopped=True, stop_reason="its brakes are shut")
    stop, away = State(stopped=True), State(online=False)
    for state in (State(), stop, stop, State(), away, State(), shut):
        store.take_state("arm-1", state, 1.0)
    assert texts(store) == [
        "arm-1 is in protective stop",
        "arm-1 was resumed: its stop has ended",
        "arm-1 lost its controller: its readings are stale",
        "arm-1 has its controller back",
        "arm-1 is in protective stop: its brakes are shut",
    ]


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (
            State(operator="me"),
            State(operator="me", wanted_by="ben"),
            "ben asks for control of arm-1: `control",
        ),
        (
            State(wanted_by="me", operator="ben"),
            State(operator="ben"),
            "ben did not give you control of arm-1",
        ),
        (
            State(operator="ben"),
            State(operator="ben", offered_to="me"),
            "ben offers you control of arm-1: `con",
        ),
    ],
)
def test_who_sits_here_is_told_of_control_what_concerns_nobody_else(
    store: Store, before: State, after: State, told: str
) -> None:
    for store.me in ("eve", "me"):
        for state in (before, after):
            store.take_state("arm-1", state, 1.0)
    assert [text[: len(told)] for text in texts(store)] == [told]


def test_a_stop_is_told_once_though_the_robots_log_has_it_too(store: Store) -> None:
    store.take_state("arm-1", State(), 1.0)
    store.take_line("arm-1", LoggedLine(1, 0.0, "warning", "stopped: anna@pts/3's protective stop"), 2.0)
    store.take_state("arm-1", State(stopped=True, stop_reason="anna@pts/3's protective stop"), 2.0)
    assert texts(store) == ["arm-1 is in anna@pts/3's protective stop"]


def test_without_a_lookup_service_the_lists_are_stale(store: Store) -> None:
    store.take_services(["lookup-1"], 1.0, stale=False)
    store.take_services([], 2.0, stale=True)
    assert store.stale
    store.take_services(["lookup-1"], 3.0, stale=False)
    assert [happening.weight for happening in store.entries] == ["error", "good"]


def family() -> list[RobotDescription]:
    """Lever over mover over arm-1."""
    top, middle = address("lever"), address("mover")
    return [
        robot(
            "lever",
            kinds=("Lever", "VirtualRobot", "Robot"),
            slots=(SlotSpec(name="mover", kind="MoveTo", child=middle),),
        ),
        robot(
            "mover",
            kinds=("MoveTo", "VirtualRobot", "Robot"),
            slots=(
                SlotSpec(name="arm", kind="Arm", child=address("arm-1")),
                SlotSpec(name="spare", kind="Robot"),
            ),
            commands=(CommandSpec(name="go_to", through="arm.go_to"),),
            bond=BondSpec(parent=top, slot="mover", epoch=1, remaining=5),
        ),
        robot("arm-1", bond=BondSpec(parent=middle, slot="arm", epoch=1, remaining=5)),
    ]


def test_a_robot_without_readings_shows_those_of_the_child_it_passes_commands_on_to(store: Store) -> None:
    store.take_descriptions(family())
    store.take_state("arm-1", State(readings={"x": 0.4, "progress": 0.2}), 1.0)
    store.take_state("lever", State(readings={"felt": 3.0}), 1.0)
    assert store.readings("lever") == {"felt": 3.0, "x": 0.4}
    assert store.progress("lever") is None
    assert store.progress("arm-1") == 0.2


def test_candidates_are_of_the_right_kind_and_never_above_the_parent(store: Store) -> None:
    store.take_descriptions(family())
    store.take_lists(
        [listing("arm-2"), listing("lever", ("Lever", "Robot")), listing("rover-1", ("Rover", "Robot"))],
        [],
        1.0,
    )
    assert [candidate.name for candidate in store.candidates("mover", "Arm")] == ["arm-2"]
    assert [candidate.name for candidate in store.candidates("mover", "Robot")] == ["arm-2", "rover-1"]
    assert store.lineage("arm-1") == ("arm-1", "mover", "lever")


def test_a_robot_that_still_waits_for_its_own_child_is_a_candidate(store: Store) -> None:
    """Its exposed commands are not listed as long as nobody can carry them out, but it has them."""
    grip = CommandSpec(name="grip", through="arm.grip", available=False)
    waiting = RobotDescription(address=address("arm-2"), kinds=("Arm", "Robot"), commands=(grip,))
    store.take_descriptions([waiting], 1.0)
    store.take_lists([listing("arm-2"), listing("arm-3")], [], 1.0)
    assert [candidate.name for candidate in store.candidates("lever", "Arm", ("grip",))] == ["arm-2"]


def test_who_commands_is_the_parent_or_who_asked(store: Store) -> None:
    assert store.by("arm-1") == ""
    store.take_state("arm-1", State(busy="go_to", caller="operator"), 1.0)
    assert store.by("arm-1") == "operator"
    store.take_state("arm-1", State(busy="go_to", caller="operator", bond=address("mover")), 2.0)
    assert store.by("arm-1") == "mover"


def test_a_command_tells_how_long_and_how_far(store: Store) -> None:
    store.take_state("arm-1", State(), 1.0)
    store.take_state("arm-1", State(busy="move", note="3 cm to go"), 2.0)
    assert store.doing("arm-1", 2.5) == "move 3 cm to go"
    store.take_state("arm-1", State(busy="move", readings={"progress": 0.5}), 12.0)
    assert store.doing("arm-1", 14.0) == "move 50 % 12 s"


def test_the_largest_force_of_the_selected_robot_is_remembered(store: Store) -> None:
    store.take_descriptions(family())
    store.take_state("arm-1", State(), 1.0)
    store.attend("mover")
    for now, force in ((2.0, 3.0), (3.0, 20.0), (4.0, 6.8)):
        store.take_state("arm-1", State(readings={"fx": 0.0, "fz": -force}), now)
    assert [round(force, 1) for _, force in store.forces] == [3.0, 20.0, 6.8]
    store.attend("lever")
    assert not store.forces


def test_a_robot_that_has_gone_is_forgotten(store: Store) -> None:
    store.take_state("arm-9", State(stopped=True), 1.0)
    assert store.stopped == ("arm-9",)
    store.take_descriptions([robot("arm-1")])
    assert store.stopped == ()


def test_the_tree_is_looked_at_again_only_when_something_hints_at_a_change(store: Store) -> None:
    store.take_state("arm-1", State(), 1.0)
    shape = store.shape
    store.take_state("arm-1", State(busy="go_to", readings={"x": 1.0}), 1.1)
    assert store.shape == shape
    store.take_state("arm-1", State(bond=address("mover"), epoch=7), 1.2)
    assert store.shape == shape + 1


def entry(level: Level, text: str, caller: str = "anna@pts/3") -> LoggedLine:
    return LoggedLine(1, 0.0, level, text, "go_to", "k", caller)


def test_the_log_has_what_became_of_the_commands_of_people_whoever_they_are(store: Store) -> None:
    store.take_line("arm-1", entry("asked", "go_to by anna@pts/3 begins"), 1.0)
    store.take_line("arm-1", entry("asked", "go_to by bob@pts/4 waits", "bob@pts/4"), 2.0)
    store.take_line("arm-1", entry("done", "go_to by anna@pts/3 is done"), 3.0)
    store.take_line("arm-1", entry("failed", "arm-1.go_to failed: it is out of reach", "bob@pts/4"), 4.0)
    store.take_line("arm-1", LoggedLine(4, 0.0, "warning", "it is warm"), 6.0)
    assert [(one.weight, one.text) for one in store.entries] == [
        ("plain", "arm-1: go_to by anna@pts/3 begins"),
        ("plain", "arm-1: go_to by bob@pts/4 waits"),
        ("good", "arm-1: go_to by anna@pts/3 is done"),
        ("error", "arm-1.go_to failed: it is out of reach"),
        ("warning", "arm-1: it is warm"),
    ]


def test_what_a_parent_asks_is_part_of_the_parents_command(store: Store) -> None:
    store.take_line("arm-1", entry("failed", "arm-1.go_to failed", "mover"), 1.0)
    assert texts(store) == []


def test_a_robot_moves_only_to_hosts_that_say_that_they_take_it(store: Store) -> None:
    host = HostDescribed(address=Address("host", "h1", "1"), keeps=True)
    store.take_hosts(
        [
            host,
            msgspec.structs.replace(host, address=Address("host", "forgetful", "1"), keeps=False),
            msgspec.structs.replace(host, address=Address("host", "own", "1"), alone="mover"),
            msgspec.structs.replace(host, address=Address("host", "stand-in", "1"), stands_by="h1"),
        ]
    )
    assert store.hosts == ("forgetful", "h1", "own")
    assert store.taking_hosts == ("h1",)
