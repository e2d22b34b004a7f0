"""How a robot is, and whose: one ladder of states, and each robot exactly once in the trees."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from robotree.tui.seen import status
from robotree.tui.seen.forest import Branch, drawing, forest, structure
from robotree.tui.seen.status import Status
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec
from robotree.vr.base.requests import State

PARENT = Address("robot", "mover", "1")

STATES = st.builds(
    State,
    busy=st.sampled_from(["", "go_to"]),
    waiting=st.integers(0, 2),
    online=st.booleans(),
    stopped=st.booleans(),
    abandoned=st.sampled_from([(), ("defy",)]),
    bond=st.sampled_from([None, PARENT]),
    paused=st.sampled_from(["", "anna@pts/3"]),
    held=st.sampled_from(["", "step 2: arm.hold()"]),
)


@given(state=STATES)
def test_a_state_and_a_description_of_the_same_robot_say_the_same(state: State) -> None:
    described = RobotDescription(
        address=Address("robot", "arm-1", "1"),
        kinds=("Arm",),
        busy=state.busy,
        waiting=state.waiting,
        online=state.online,
        stopped=state.stopped,
        abandoned=state.abandoned,
        paused=state.paused,
        held=state.held,
        bond=BondSpec(parent=PARENT, slot="arm", epoch=1, remaining=5) if state.bond else None,
    )
    assert status.status_of(described) == status.status_of(state)
    assert status.words(described) == status.words(state)


@given(state=STATES, share=st.one_of(st.none(), st.floats()))
def test_only_calm_robots_need_no_word(state: State, share: float | None) -> None:
    calm = status.status_of(state) in status.CALM
    assert calm == (status.words(state) in status.CALM)
    left_out = state.stopped or state.abandoned or state.busy or state.paused
    assert calm == (state.online and not left_out), "trouble and work are never left out"
    assert "nan" not in status.doing(state, share)
    assert "inf" not in status.doing(state, share)


@pytest.mark.parametrize(
    ("state", "one", "beside_a_sign", "alone"),
    [
        (State(), "free", "free", "free"),
        (State(busy="go_to", waiting=2), "busy", "go_to 40 % +2", "busy: go_to +2"),
        (State(busy="go_to", abandoned=("defy",)), "abandoned", *["ABANDONED: defy still runs"] * 2),
        (
            State(busy="move", paused="anna@pts/3", held="step 2: arm.hold()"),
            "paused",
            *["paused before step 2: arm.hold()"] * 2,
        ),
        (State(busy="move", paused="anna@pts/3"), "paused", *["paused: move"] * 2),
        (State(away=6.6), "waits", *["its parent is away, 7 s left"] * 2),
        (State(stopped=True, paused="anna@pts/3"), "stopped", "stopped", "STOPPED"),
        (State(stopped=True, abandoned=("defy",)), "stopped", "stopped", "STOPPED"),
        (State(online=False, stopped=True), "offline", "offline", "offline"),
    ],
)
def test_what_matters_most_comes_first(state: State, one: Status, beside_a_sign: str, alone: str) -> None:
    assert status.status_of(state) == one
    assert status.doing(state, 0.4) == beside_a_sign
    assert status.words(state) == alone


# -- parents and children, as trees: each robot appears exactly once -------------------------------


def robot(name: str, **children: str | None) -> RobotDescription:
    slots = tuple(
        SlotSpec(name=slot, kind="Arm", child=Address("robot", child, "1") if child else None)
        for slot, child in children.items()
    )
    return RobotDescription(address=Address("robot", name, "1"), kinds=("Thing", "Robot"), slots=slots)


def names(branches: tuple[Branch, ...]) -> list[str]:
    return [name for branch in branches for name in [branch.name, *names(branch.branches)] if name]


def test_free_robots_are_roots_and_empty_slots_are_shown() -> None:
    roots = forest([robot("pair", left="a", right=None), robot("a"), robot("z")])
    assert drawing(roots).splitlines() == [
        "pair (Thing)",
        "├─ left: a (Thing)",
        "└─ right: empty (takes Arm)",
        "z (Thing)",
    ]


def test_who_is_not_moved_by_people_alone_is_marked() -> None:
    moved = [replace(robot("a"), placement="auto"), replace(robot("b"), placement="advise", advised="h2")]
    assert drawing(forest(moved)) == "a (Thing)  placement auto\nb (Thing)  placement advise: better on h2"


def test_a_child_that_does_not_answer_keeps_its_place() -> None:
    assert "arm: ghost (does not answer)" in drawing(forest([robot("mover", arm="ghost")]))


def test_a_robot_that_was_lost_and_is_free_again_is_not_called_away() -> None:
    slot = SlotSpec(name="arm", kind="Arm", lost="a has ended or cannot be reached", was="a")
    greeter = replace(robot("greeter"), slots=(slot,))
    away = "greeter (Thing)\n└─ arm: empty (takes Arm; a has ended or cannot be reached)"
    assert drawing(forest([greeter])) == away
    assert "arm: empty (takes Arm; a was lost, and is free again)" in drawing(forest([greeter, robot("a")]))


def test_a_cycle_that_should_not_be_ends_the_drawing_not_the_program() -> None:
    assert names(forest([robot("a", x="b"), robot("b", x="a")])) == ["a", "b", "a"]


def test_a_tree_as_plain_data_has_slots_and_children() -> None:
    (root,) = forest([robot("pair", left="a"), robot("a")])
    assert structure(root) == {
        "name": "pair",
        "kind": "Thing",
        "state": "free",
        "children": [
            {"name": "a", "kind": "Thing", "state": "free", "slot": "left", "takes": "Arm", "children": []}
        ],
    }


@given(parents=st.lists(st.integers(-1, 8), max_size=9))
def test_every_robot_of_a_real_forest_is_drawn_exactly_once(parents: list[int]) -> None:
    """Robot i is a child of parents[i], which must come before it; else it is free."""
    below: dict[int, list[int]] = {}
    for child, parent in enumerate(parents):
        if 0 <= parent < child:
            below.setdefault(parent, []).append(child)
    robots = [
        robot(f"r{one}", **{f"s{child}": f"r{child}" for child in below.get(one, [])})
        for one in range(len(parents))
    ]
    assert sorted(names(forest(robots))) == sorted(f"r{one}" for one in range(len(parents)))
