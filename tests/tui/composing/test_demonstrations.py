"""What was shown once becomes few steps, relative to the places where something was taken and let go."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from math import pi, radians

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.composing.demonstration import (
    ARM_OF_TWIST,
    Pose,
    Shown,
    ShownRobot,
    composed,
    simplified,
)
from robotree.tui.composing.gathering import Felt, gathered
from robotree.tui.composing.lines import written
from robotree.tui.composing.play import play
from robotree.tui.composing.steps import ComposedCall, checked
from robotree.tui.composing.writing import prepared
from robotree.tui.errors import BadComposition
from robotree.vr.base.history_event import HistoryEvent
from tests.tui.composing.shown import ARM, CARRIED, DESCRIBED, HOME, KINDS, ROBOTS, ROVER, STEPS, go, grip


def test_a_cup_that_was_carried_by_hand_becomes_two_parts_with_places() -> None:
    made = composed("cup", [ARM], CARRIED, starts={"arm-1": HOME})
    assert written(made) == STEPS
    assert prepared(made, ROBOTS, "Shown.").lines <= 40


def test_a_cup_that_has_moved_is_carried_with_one_parameter_changed() -> None:
    good = checked(composed("cup", [ARM], CARRIED, starts={"arm-1": HOME}), KINDS)
    before, after = (play(good, KINDS, given).orders for given in ({}, {"from_y": -0.25}))
    moved = [(a["y"], b["y"]) for (_, command, a), (_, _, b) in zip(before, after, strict=True)
             if command == "go_to" and a != b]  # fmt: skip
    assert moved == [(-0.2, -0.25)] * 3


def test_a_cup_that_stands_higher_is_taken_higher_and_put_down_where_it_was() -> None:
    good = checked(composed("cup", [ARM], CARRIED, starts={"arm-1": HOME}), KINDS)
    before, after = (play(good, KINDS, given).orders for given in ({}, {"from_z": 0.08}))
    heights = [(a["z"], b["z"]) for (_, command, a), (_, _, b) in zip(before, after, strict=True)
               if command == "go_to" and a != b]  # fmt: skip
    assert heights == [(0.5, 0.55), (0.03, 0.08), (0.15, 0.2)]


def test_a_place_that_is_visited_again_at_another_height_is_the_same_place() -> None:
    shown = [go(0.3, 0, 0.03), grip("close"), go(0.3, 0, 0.08), grip("open")]
    made = composed("cup", [ARM], shown)
    assert dict(made.parameters) == {"from_x": 0.3, "from_y": 0.0, "from_z": 0.03}
    assert "arm.go_to x=$from_x y=$from_y z=$from_z+0.05" in written(made)


def test_angles_are_degrees_in_the_steps_and_radians_in_the_page() -> None:
    made = composed("cup", [ARM], [go(0.3, 0, 0.1, radians(45)), go(0.3, 0, 0.1, 3.1415)])
    ready = prepared(made, ROBOTS, "Shown.")
    for text, angle in (("twist=45deg", radians(45)), ("twist=180deg", pi)):
        assert text in ready.files["cup.steps"]
        assert f"twist={angle!r})" in ready.files["cup.py"]


def test_a_point_at_the_end_of_its_range_is_not_rounded_beyond_it() -> None:
    end, go_to = 0.40006, ARM.commands["go_to"]
    fields = [
        msgspec.structs.replace(field, lower=-end, upper=end) if field.name in "xy" else field
        for field in go_to.parameters
    ]
    near = ARM._replace(commands={**ARM.commands, "go_to": msgspec.structs.replace(go_to, parameters=fields)})
    (step,) = composed("cup", [near], [go(end, -end, 0.1)]).steps
    assert isinstance(step, ComposedCall)
    assert dict(step.arguments) | {"x": end, "y": -end} == dict(step.arguments)


def test_where_nothing_was_gripped_is_no_place() -> None:
    shown = [go(0.3, 0, 0.1), Shown("arm-1", "hold", {}), go(0.3, 0.05, 0.1)]
    made = composed("cup", [ARM], shown)
    assert made.parameters == ()
    assert [getattr(step, "command", "") for step in made.steps] == ["go_to", "hold", "go_to"]


def test_what_was_left_beside_a_place_goes_along_with_it() -> None:
    shown = [go(0.25, -0.2, 0.1), go(0.3, -0.2, 0.03), grip("close")]
    made = composed("cup", [ARM], shown)
    assert "arm.go_to x=$from_x-0.05 y=$from_y z=$from_z+0.07" in written(made)


def test_a_place_that_is_visited_again_keeps_its_name_and_parts_get_numbers() -> None:
    shown = [*CARRIED, go(0.3, -0.2, 0.03), grip("close"), go(0.3, -0.3, 0.03), grip("open")]
    made = composed("cup", [ARM], shown)
    assert [name for name, _ in made.parameters] == [
        f"{place}_{axis}" for place in ("from", "to") for axis in "xyz"
    ]
    assert "part take2" in written(made)
    checked(made, KINDS)


def test_a_hand_that_closed_on_nothing_expects_nothing() -> None:
    made = composed("cup", [ARM], [go(0.3, 0, 0.1), grip("close", holding=False)])
    assert "expect" not in written(made)


def test_more_places_than_names_stay_numbers() -> None:
    shown = [one for n in range(12) for one in (go(0.3, 0.05 * n - 0.3, 0.1), grip("close"), grip("open"))]
    good = checked(composed("cup", [ARM], shown), KINDS)
    assert len(good.composition.parameters) == 24


def test_robots_that_take_turns_have_slots_of_their_own() -> None:
    other = ShownRobot("arm-2", "Arm", KINDS["Arm"])
    shown = [
        go(0.3, 0, 0.1), Shown("arm-2", "hold", {}), Shown("rover-1", "move", {"x": 1.0, "y": 0.0}),
        go(0.3, 0.1, 0.1),
    ]  # fmt: skip
    made = checked(composed("cup", [ARM, other, ROVER], shown), KINDS).composition
    assert made.slots == (("arm", "Arm"), ("arm2", "Arm"), ("rover", "Rover"))
    assert [step.slot for step in made.steps] == ["arm", "arm2", "rover", "arm"]  # type: ignore[union-attr]


def test_what_is_shown_later_comes_behind_what_was_shown_before() -> None:
    first = composed("cup", [ARM], CARRIED)
    again = composed("cup", [ARM], CARRIED, before=first, filled={"arm-1": "arm"})
    assert again.slots == first.slots
    assert again.parameters == first.parameters
    assert again.steps[: len(first.steps)] == first.steps
    checked(again, KINDS)


def test_nothing_shown_is_no_composition() -> None:
    for shown in ([], [Shown("arm-1", "get_info", {})], [Shown("ghost", "hold", {})]):
        with pytest.raises(BadComposition, match="nothing was shown"):
            composed("cup", [ARM], shown)


poses = st.tuples(*[st.floats(-0.6, 0.6)] * 3, st.floats(-3, 3))


def weighed(point: Pose) -> Sequence[float]:
    return (*point[:3], ARM_OF_TWIST * point[3])


def off(point: Pose, way: Sequence[Pose]) -> float:
    """[m] from a point to a way, found by walking along it."""
    if len(way) == 1:
        return math.dist(weighed(point), weighed(way[0]))
    found = math.inf
    for a, b in itertools.pairwise(way):
        p, q, r = map(weighed, (a, b, point))
        low, high = 0.0, 1.0
        while high - low > 1e-6:  # along a line the distance has one minimum
            third = (high - low) / 3
            near, far = (
                math.dist(r, [u + share * (v - u) for u, v in zip(p, q, strict=True)])
                for share in (low + third, high - third)
            )
            low, high = (low, high - third) if near < far else (low + third, high)
            found = min(found, near, far)
    return found


@given(way=st.lists(poses, min_size=1, max_size=7), tolerance=st.sampled_from([0.0, 0.01, 0.05, 0.2]))
def test_a_simplified_way_stays_within_the_tolerance_and_has_no_new_points(
    way: list[Pose], tolerance: float
) -> None:
    less = simplified(way, tolerance)
    assert less[0] == way[0]
    left = iter(way)
    assert all(point in left for point in less), "in their order"
    assert all(off(point, less) <= tolerance + 1e-3 for point in way)


def test_a_straight_way_of_many_points_has_two() -> None:
    way = [(0.001 * n, 0.0, 0.1, 0.0) for n in range(5000)]
    assert simplified(way, 0.001) == [way[0], way[-1]]


# -- out of histories ------------------------------------------------------------------------------


def event(kind: str, unix: float, key: str, **more: object) -> HistoryEvent:
    return HistoryEvent(kind=kind, unix=unix, robot="arm-1", key=key, **more)  # type: ignore[arg-type]


def asked(unix: float, key: str, caller: str = "anna@pts/1", **arguments: object) -> HistoryEvent:
    return event("accepted", unix, key, command="go_to", arguments=arguments, caller=caller)


WHOLE = {"x": "30 cm", "y": 0, "z": 0.1, "twist": 0}
EVENTS = [
    asked(1, "a", **WHOLE), event("ended", 2, "a"),
    asked(3, "b", **WHOLE), event("ended", 4, "b", error="CommandFailed"),
    asked(5, "c", caller="teleop", **WHOLE), event("ended", 6, "c"),
    asked(7, "d", **WHOLE),
    asked(8, "e", y=1), event("ended", 9, "e"),
]  # fmt: skip


def test_what_persons_asked_and_what_ended_well_was_shown() -> None:
    found = gathered(
        EVENTS, DESCRIBED, starts={"arm-1": dict(zip(("x", "y", "z", "twist"), HOME, strict=True))}
    )
    assert [one.arguments for one in found.shown] == [{"x": 0.3, "y": 0.0, "z": 0.1, "twist": 0.0}]
    assert found.starts == {"arm-1": HOME}
    assert found.failed == 3


def test_of_a_robot_that_is_named_all_counts_whoever_asked() -> None:
    assert len(gathered(EVENTS, DESCRIBED, ("arm-1",)).shown) == 2


GRIPPED = [
    event("accepted", 1, "a", command="grip", arguments={"action": "close"}), event("ended", 2, "a"),
    event("accepted", 5, "b", command="grip", arguments={"action": "open"}), event("ended", 6, "b"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("felt", "holding"),
    [
        ([Felt("arm-1", 3, {"width": -0.0003})], False),
        ([Felt("arm-1", 3, {"width": 0.06})], True),
        ([Felt("arm-1", 3, {"width": 0.06, "holding": False})], False),
        ([Felt("arm-1", 4, {"width": 0.06}), Felt("arm-1", 3, {"width": 0.0})], True),
        ([Felt("arm-1", 1.5, {"width": 0.0})], None),
        ([Felt("arm-1", 2.1, {"width": 0.0}, age=0.3)], None),
        ([Felt("arm-1", 5.5, {"width": 0.0})], None),
        ([Felt("arm-2", 3, {"width": 0.0})], None),
        ([Felt("arm-1", 3, {"x": 0.0})], None),
    ],
)
def test_the_newest_readings_between_two_grips_say_whether_something_was_held(
    felt: list[Felt],
    holding: bool | None,  # noqa: FBT001
) -> None:
    assert gathered(GRIPPED, DESCRIBED, ("arm-1",), felt=felt).shown[0].holding is holding
