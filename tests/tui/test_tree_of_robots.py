"""Parents and children, as trees: each robot appears exactly once."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from robotree.tui.seen.forest import Branch, drawing, forest, structure
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec


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
