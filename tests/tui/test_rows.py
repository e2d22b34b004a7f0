"""One list of robots: trees and sorted lists, filters, columns; each robot is in it once."""

from __future__ import annotations

import dataclasses
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from robotree.tui.seen import matching, status
from robotree.tui.seen.rows import (
    GAP,
    GOES,
    ORDERS,
    SortOrder,
    columns,
    family,
    heard,
    listed,
    natural,
    rails,
    row,
)
from robotree.tui.seen.store import Store
from robotree.tui.seen.watched import Alarm
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec
from robotree.vr.base.presence import Held
from robotree.vr.base.requests import State
from robotree.vr.supervision.realm_client import Elsewhere


def address(name: str) -> Address:
    return Address("robot", name, "1")


def robot(
    name: str, children: dict[str, str] | None = None, parent: str = "", **more: Any
) -> RobotDescription:
    slots = tuple(
        SlotSpec(name=slot, kind="Arm", child=address(child) if child else None)
        for slot, child in (children or {}).items()
    )
    bond = BondSpec(parent=address(parent), slot="arm", epoch=1, remaining=5) if parent else None
    kinds = more.pop("kinds", ("Arm", "Robot"))
    return RobotDescription(address=address(name), kinds=kinds, slots=slots, bond=bond, **more)


def store_of(*robots: RobotDescription) -> Store:
    store = Store()
    store.take_descriptions(robots, 1.0)
    return store


def names(store: Store, order: SortOrder = "tree", letters: str = "") -> list[str]:
    return [one.name for one in listed(store, family(store), 2.0, order=order, letters=letters)]


LEVER = (
    robot("lever", {"mover": "mover"}, kinds=("OpenClose", "Robot"), host="host-1"),
    robot("mover", {"arm": "arm-1", "spare": ""}, parent="lever", kinds=("MoveTo", "Robot"), host="host-1"),
    robot("arm-1", parent="mover"),
    robot("rover-10", kinds=("Rover", "Robot")),
    robot("rover-2", kinds=("Rover", "Robot")),
)

NAMES = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9_-]{0,6}", fullmatch=True)


@given(a=st.text(max_size=12), b=st.text(max_size=12), c=st.text(max_size=12))
def test_the_natural_order_is_an_order(a: str, b: str, c: str) -> None:
    assert (natural(a) == natural(b)) == (a == b)
    one, two, three = sorted([a, b, c], key=natural)
    assert natural(one) <= natural(two) <= natural(three)


def test_r2_comes_before_r10() -> None:
    assert sorted(["r10", "R2", "r2", "r1", "r02"], key=natural) == ["r1", "R2", "r02", "r2", "r10"]


def test_children_stand_below_their_parents_with_their_slots() -> None:
    placements = family(store_of(*LEVER))
    assert [(placement.name, placement.depth, placement.slot) for placement in placements] == [
        ("lever", 0, ""),
        ("mover", 1, "mover"),
        ("arm-1", 2, "arm"),
        ("rover-2", 0, ""),
        ("rover-10", 0, ""),
    ]


def test_a_line_goes_down_to_the_last_child() -> None:
    pair = robot("pair", {"left": "a", "right": "bb"})
    store = store_of(
        robot("cell", {"pair": "pair", "rover": "rr"}),
        pair,
        robot("a", {"tool": "t"}, parent="pair"),
        *(robot(name) for name in ("bb", "rr", "t", "z")),
    )
    drawn = [f"{one.rail}{one.name}" for one in family(store)]
    assert drawn == ["cell", "├ pair", "│ ├ a", "│ │ └ t", "│ └ bb", "└ rr", "z"]
    some = listed(store, family(store), 2.0, letters="!name:bb !name:rr")
    assert [f"{one.rail}{one.name}" for one in some] == ["cell", "└ pair", "  └ a", "    └ t", "z"]
    flat = listed(store, family(store), 2.0, order="name")
    assert not any(one.rail for one in flat)


@given(depths=st.lists(st.integers(0, 5), max_size=12))
def test_each_line_of_a_tree_is_joined_to_the_one_above(depths: list[int]) -> None:
    depths = [min(depth, one) for one, depth in enumerate(depths)]
    grown = [min(depth, before + 1) for depth, before in zip(depths, [-1, *depths], strict=False)]
    drawn = rails(grown)
    assert [len(one) for one in drawn] == [2 * depth for depth in grown]
    for above, below in pairwise(drawn):
        for sign, over in zip(below, above, strict=False):
            assert (sign in "│├") <= (over in "│├ "), "a bar ends in a sign that goes on upwards"
            assert (over in "│├") <= (sign in "│├└"), "and goes on downwards"


@given(links=st.dictionaries(NAMES, st.lists(NAMES, max_size=3), max_size=8), order=st.sampled_from(ORDERS))
def test_whoever_commands_whom_each_robot_is_listed_once(
    links: dict[str, list[str]], order: SortOrder
) -> None:
    """Also where they command each other in a circle."""
    robots = [robot(name, {f"s{i}": one for i, one in enumerate(below)}) for name, below in links.items()]
    store = store_of(*robots)
    assert sorted(names(store, order)) == sorted(links)


@pytest.mark.parametrize(
    ("order", "wanted"),
    [
        ("name", ["arm-1", "lever", "mover", "rover-2", "rover-10"]),
        ("kind", ["arm-1", "mover", "lever", "rover-2", "rover-10"]),
        ("state", ["arm-1", "lever", "mover", "rover-2", "rover-10"]),
        ("by", ["mover", "arm-1", "lever", "rover-2", "rover-10"]),
        ("host", ["lever", "mover", "arm-1", "rover-2", "rover-10"]),
    ],
)
def test_the_list_is_sorted_by_any_column(order: SortOrder, wanted: list[str]) -> None:
    store = store_of(*LEVER)
    store.take_state("arm-1", State(stopped=True, bond=address("mover")), 1.0)
    assert names(store, order) == wanted


def test_trees_with_a_problem_come_first_and_stay_trees() -> None:
    store = store_of(*LEVER, robot("arm-0"))
    store.take_state("rover-10", State(online=False), 1.0)
    store.take_state("arm-1", State(stopped=True, bond=address("mover")), 1.0)
    assert names(store, "problems") == ["rover-10", "lever", "mover", "arm-1", "arm-0", "rover-2"]


def test_robots_are_counted_by_status_the_worst_first() -> None:
    store = store_of(*LEVER)
    store.take_state("rover-10", State(online=False), 1.0)
    assert store.count(1.0) == [("offline", 1), ("needs", 2), ("free", 1), ("enslaved", 1)]


@pytest.mark.parametrize(
    ("letters", "wanted"),
    [
        ("ROVER", ["rover-2", "rover-10"]),
        ("!rover !openclose", ["mover", "arm-1"]),
        ("kind:arm", ["arm-1"]),
        ("state:needs", ["lever", "mover"]),
        ("by:lever", ["mover"]),
        ("host:host-1 !kind:open", ["mover"]),
        ("! kind: ", ["lever", "mover", "arm-1", "rover-2", "rover-10"]),
        ("[/x]", []),
    ],
)
def test_a_filter_shows_what_it_says(letters: str, wanted: list[str]) -> None:
    assert names(store_of(*LEVER), letters=letters) == wanted


@given(
    letters=st.text("ab:! knd", max_size=12),
    said=st.dictionaries(st.sampled_from(["name", "kind"]), st.text("ab")),
)
def test_a_term_and_its_opposite_never_hold_together(letters: str, said: dict[str, str]) -> None:
    for term in matching.terms(letters):
        opposite = dataclasses.replace(term, negative=not term.negative)
        assert matching.matches([term], said) != matching.matches([opposite], said)


@given(
    width=st.integers(0, 300),
    longest=st.dictionaries(st.sampled_from(["ROBOT", "KIND", "STATE", "BY"]), st.integers(0, 90)),
)
def test_what_is_short_of_room_goes_in_its_order_and_the_state_never(
    width: int, longest: dict[str, int]
) -> None:
    shown = columns(width, longest)
    titles = [one.title for one in shown]
    gone = [title for title in GOES if title not in titles]
    assert gone == list(GOES[: len(gone)])
    assert {"ROBOT", "KIND", "STATE"} <= set(titles)
    if width >= 14:
        assert sum(one.room for one in shown) + GAP * (len(shown) - 1) <= width
    if width >= 40:
        assert all(one.room >= 8 for one in shown if one.title in {"ROBOT", "STATE"})


@pytest.mark.parametrize(
    ("letters", "found"),
    [
        ("~am1", ["arm-1"]),
        ("~rvr", ["rover-2", "rover-10"]),
        ("re:^rover-[0-9]$", ["rover-2"]),
        ("name:re:^(mover|LEVER)$", ["lever", "mover"]),
        ("!re:rover !~lvr", ["mover", "arm-1"]),
        ("re:(", ["lever", "mover", "arm-1", "rover-2", "rover-10"]),
    ],
)
def test_letters_may_be_fuzzy_or_a_regular_expression(letters: str, found: list[str]) -> None:
    assert names(store_of(*LEVER), letters=letters) == found


@pytest.mark.parametrize(
    ("expression", "why"),
    [
        ("(", "no regular expression: missing ), unterminated subpattern"),
        ("(a+)+$", "a group cannot be repeated"),
        ("a*b*c*d", "more than 2 of * + { or more than 3 of them with ? and |"),
        ("(.|.)(.|.)(.|.)(.|.)Q", "more than 2 of * + { or more than 3 of them with ? and |"),
        (r"(.*)(.*)\1\2Q", "only plain groups, and nothing that names one, can be used"),
        ("(?=a*)b", "only plain groups, and nothing that names one, can be used"),
        ("x" * 81, "longer than 80 characters"),
    ],
)
def test_an_expression_that_could_hold_up_the_screen_is_named_and_asks_for_nothing(
    expression: str, why: str
) -> None:
    assert matching.faults(f"arm !re:{expression}") == (f"{expression}: {why}",)
    assert [term.letters for term in matching.terms(f"arm re:{expression}")] == ["arm"]


def test_a_list_in_parts_has_a_heading_for_each_and_every_robot_once() -> None:
    store = store_of(*LEVER)
    store.take_state("rover-2", State(stopped=True), 2.0)
    shown = listed(store, family(store), 2.0, division="kind")
    assert [one.heading or (one.name, one.depth) for one in shown] == [
        "Arm: 1 robot", ("arm-1", 0),
        "MoveTo: 1 robot", ("mover", 0),
        "OpenClose: 1 robot", ("lever", 0),
        "Rover: 2 robots, 1 stopped", ("rover-2", 0), ("rover-10", 0),
    ]  # fmt: skip
    worst = listed(store, family(store), 2.0, division="state", order="name")
    assert [one.heading for one in worst if one.heading][:2] == ["stopped: 1 robot", "needs: 2 robots"]
    assert sorted(one.name for one in worst if one.name) == sorted(store.known)


def test_parts_by_site_begin_with_this_machine() -> None:
    store = store_of(*LEVER)
    store.take_elsewhere({"rover-2": Elsewhere("hall", 0.1, silent=False)}, 1.0)
    shown = listed(store, family(store), 2.0, division="site")
    assert [one.heading for one in shown if one.heading] == ["this machine: 4 robots", "hall: 1 robot"]
    assert [(one.name, one.depth) for one in shown[1:4]] == [("lever", 0), ("mover", 1), ("arm-1", 2)]


def test_a_row_says_when_it_was_heard_who_commands_and_who_waits() -> None:
    assert [heard(age) for age in (None, 0.1, 1.2, 1.44, 9.94, 12.4, 200.0)] == [
        "", "≤1 s", "≤1 s", "1.4 s", "9.9 s", "12 s", "3 min",
    ]  # fmt: skip
    store = store_of(*LEVER)
    state = State(busy="drive", caller="anna@pts/3", waiting=2, waiters=("bob@pts/4", "eve@pts/5"))
    store.take_state("rover-2", state, 2.0)
    shown = row(store, next(one for one in family(store) if one.name == "rover-2"), 3.5)
    assert (shown.heard, shown.by, shown.waits) == ("1.5 s", "anna@pts/3", "bob@pts/4, eve@pts/5")


def test_a_free_robot_says_who_has_control_of_it() -> None:
    store = store_of(*LEVER)
    store.me = "anna@pts/3"
    for operator, words in (("ben@pts/4", "ben@pts/4 has control"), (store.me, "you have control")):
        store.take_state("rover-2", State(operator=operator), 2.0)
        shown = row(store, next(one for one in family(store) if one.name == "rover-2"), 2.5)
        assert (shown.state, shown.by) == (words, operator)
    store.take_state("rover-2", State(operator="ben@pts/4", wanted_by="eve@pts/5"), 2.7)
    assert store.by("rover-2") == "ben@pts/4 → eve@pts/5", "who asks for it is seen"
    store.take_state("rover-2", State(operator="ben@pts/4", busy="drive"), 3.0)
    assert store.doing("rover-2", 3.0).startswith("drive"), "what it does comes first"


def test_a_robot_with_an_alarm_says_so_and_comes_before_those_without_a_problem() -> None:
    store = store_of(*LEVER)
    alarm = Alarm(robot="rover-2", reading="battery", sign="<", limit=30.0, unit="%", raised=1.0)
    store.take_alarms([alarm], 1.0, "press a")
    assert names(store, "problems")[0] == "rover-2"
    assert names(store, letters="state:alarm") == ["rover-2"]
    assert row(store, family(store)[-1], 2.0).alarm == ""
    assert (
        row(store, next(one for one in family(store) if one.name == "rover-2"), 2.0).alarm == "battery < 30 %"
    )


def test_a_wide_list_has_epoch_lease_and_process_and_a_narrow_one_never() -> None:
    titles = [column.title for column in columns(160, {}, wide=True)]
    assert titles == ["ROBOT", "KIND", "STATE", "HEARD", "BY", "HOST", "EPOCH", "LEASE", "PROCESS", "ABOUT"]
    assert [column.title for column in columns(80, {}, wide=True)] == ["ROBOT", "KIND", "STATE", "BY", "HOST"]
    assert not {"EPOCH", "LEASE", "PROCESS"} & {column.title for column in columns(300, {})}
    store = store_of(*LEVER)
    child = next(placement for placement in family(store) if placement.name == "arm-1")
    store.take_state("arm-1", State(epoch=7), 1.0)
    store.take_processes([Held("robot/arm-1/1", "process 4711", "")])
    made = row(store, child, 2.0, wide=True)
    assert (made.epoch, made.lease, made.process) == ("7", "5 s", "4711")
    made = row(store, child, 2.0)
    assert (made.epoch, made.lease, made.process) == ("", "", ""), "a lease that runs draws no line again"


def test_a_robot_needs_what_the_robots_below_it_need() -> None:
    store = store_of(
        robot("boss", {"lever": "lever"}),
        robot("lever", {"mover": "mover"}, parent="boss"),
        robot("mover", {"arm": ""}, parent="lever"),
    )
    rows = [row(store, one, 2.0) for one in family(store)]
    assert [(one.status, one.state) for one in rows] == [
        ("needs", "needs mover.arm: Arm"),
        ("needs", "needs mover.arm: Arm"),
        ("needs", "needs arm: Arm"),
    ]
    told = store.descriptions
    assert status.text(told["boss"], told.get) == "needs mover.arm: Arm"


def test_a_circle_of_parents_ends_what_they_need() -> None:
    store = store_of(robot("a", {"arm": "b"}), robot("b", {"arm": "a", "spare": ""}))
    assert [row(store, one, 2.0).state for one in family(store)] == ["needs b.spare: Arm", "needs spare: Arm"]
    assert (store.readings("a"), store.units("a")) == ({}, {}), "and the way down to readings"


def test_who_hangs_stays_in_its_place_with_pid_and_remedy_until_it_is_dismissed() -> None:
    store = store_of(*LEVER)
    left = [one for one in LEVER if one.name != "mover"]
    store.take_descriptions(left, 2.0)
    store.take_silent([Held("robot/mover/1", "process 4711", "`kill -9 4711` ends it")], 3.0)
    assert names(store) == ["lever", "mover", "arm-1", "rover-2", "rover-10"], "and so does its child"
    made = row(store, family(store)[1], 4.0)
    assert (made.status, made.state, made.old) == ("hangs", "HANGS (pid 4711)", True)
    store.departed(address("mover"), 10.0, left=False)
    assert row(store, family(store)[1], 15.0).state == "GONE 5 s"
    assert store.by("mover") == "", "nobody commands what has gone"
    free = [replace(one, bond=None) if one.name == "arm-1" else one for one in left]
    store.take_descriptions(free, 11.0)
    assert names(store)[0] == "arm-1", "nobody commands what a robot commanded that has gone"
    assert store.by("arm-1") == ""
    assert store.dismiss("mover")
    assert "mover" not in names(store)


def test_who_answers_again_is_as_before() -> None:
    store = store_of(*LEVER)
    store.take_descriptions(LEVER[:3], 2.0)
    store.take_silent([Held("robot/rover-2/1", "process 1", "")], 3.0)
    store.take_descriptions(LEVER, 4.0)
    assert not store.absent
    assert store.entries[-1].text == "rover-2 (robot) answers again"


def test_a_newcomer_sees_who_hangs_already() -> None:
    store = Store()
    store.take_silent(
        [Held("robot/arm-1/1", "process 7", "wake it"), Held("host/h/1", "process 7", "x")], 1.0
    )
    assert names(store) == ["arm-1"], "a host is no robot"
    assert len(store.entries) == 2
    store.take_silent([Held("robot/arm-1/1", "process 7", "wake it")], 2.0)
    assert len(store.entries) == 2, "told once"


def test_a_robot_behind_an_open_link_is_marked_and_found_by_it() -> None:
    guarded, unguarded = (robot(name, attributes={"link": name}) for name in ("signed", "open"))
    store = store_of(guarded, unguarded, robot("virtual"))
    marks = {placement.name: row(store, placement, 2.0).unguarded for placement in family(store)}
    assert marks == {"open": True, "signed": False, "virtual": False}
    assert names(store, letters="open link") == ["open"]
