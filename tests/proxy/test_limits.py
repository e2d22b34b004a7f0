"""The limits that proxy and controller both know: the same numbers, and the same answers at each of them.

They are written twice on purpose (docs/decisions/0008): the proxy refuses early, the controller for sure.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import GoalState, GoalStatus, Reason
from robotree.proxy import arm, rover
from robotree.proxy.arm import GoTo, Grip
from robotree.proxy.guard import NO_LIMITS, EpochCheck, Span, changed, check
from robotree.proxy.motion import Hold, Motion
from robotree.proxy.rover import Move, check_arrival
from robotree.sim.arm import device as arm_device
from robotree.sim.arm import planner
from robotree.sim.arm.device import WIDEST_BLEND
from robotree.sim.firmware.device import WIDEST
from robotree.sim.rover import device as sim_rover
from robotree.sim.testing import ArmBench, RoverBench
from robotree.vr.base.errors import BadArgument, StaleEpoch

anything = st.floats(allow_nan=True, allow_infinity=True)
near = st.floats(-1, 1)
value = anything | near
arm_motions: st.SearchStrategy[Motion] = st.one_of(
    st.builds(GoTo, x=value, y=value, z=value, twist=value, speed=value),
    st.builds(Grip, width=value),
    st.just(Hold()),
)


@given(motion=arm_motions)
def test_what_passes_the_guard_is_within_every_limit(motion: Motion) -> None:
    limits = arm.LIMITS
    within = all(limits[name].lower <= v <= limits[name].upper for name, v in asdict(motion).items())
    try:
        check(motion, limits, command="c")
    except BadArgument:
        assert not within
    else:
        assert within


@given(dx=value, dy=value, speed=value, x=near, y=near)
def test_no_move_leads_out_of_the_arena(dx: float, dy: float, speed: float, x: float, y: float) -> None:
    motion, limits = Move(x=dx, y=dy, speed=speed), rover.LIMITS
    try:
        check(motion, limits, command="move")
        check_arrival(motion, (x, y), limits, command="move")
    except BadArgument:
        return
    assert abs(x + dx) <= limits["arena_x"].upper
    assert abs(y + dy) <= limits["arena_y"].upper


def test_a_refusal_names_value_limit_and_unit() -> None:
    with pytest.raises(BadArgument, match=r"go_to: z: -0\.1 m is outside 0\.025 to 0\.8 m"):
        check(GoTo(x=0.3, y=0, z=-0.1, twist=0, speed=0.1), arm.LIMITS, command="go_to")
    with pytest.raises(BadArgument, match=r"is not a number; give one from 0 to 0\.08 m"):
        check(Grip(width=math.nan), arm.LIMITS, command="grip")
    with pytest.raises(BadArgument, match=r"y: the move would end at 1\.900 m, the arena is -1\.5 to 1\.5 m"):
        check_arrival(Move(x=0, y=0.9, speed=0.3), (0.0, 1.0), rover.LIMITS, command="move")


def test_a_value_without_a_known_limit_is_not_sent() -> None:
    with pytest.raises(BadArgument, match="no limit"):
        check(Grip(width=0.01), rover.LIMITS, command="grip")


def test_another_place_has_another_box() -> None:
    narrow = changed(arm.LIMITS, {"x": Span(0.2, 0.4, "m")})
    with pytest.raises(BadArgument, match=r"0\.5 m is outside 0\.2 to 0\.4 m"):
        check(GoTo(x=0.5, y=0, z=0.2, twist=0, speed=0.1), narrow, command="go_to")


def test_a_change_of_a_limit_that_a_kind_does_not_have_is_a_mistake() -> None:
    with pytest.raises(
        ValueError, match="there is no limit widht; there is: x, y, z, twist, speed, blend, width"
    ):
        changed(arm.LIMITS, {"widht": Span(0.0, 0.04, "m")})


def test_of_a_robot_without_limits_nothing_is_asked_that_has_a_number() -> None:
    check(Hold(), NO_LIMITS, command="hold")
    with pytest.raises(BadArgument, match="no limit"):
        check(Grip(width=0.01), NO_LIMITS, command="grip")


@given(lower=value, upper=value)
def test_a_span_that_limits_nothing_is_not_born(lower: float, upper: float) -> None:
    try:
        span = Span(lower, upper, "m")
    except ValueError:
        assert not (math.isfinite(lower) and math.isfinite(upper) and lower <= upper)
    else:
        assert lower in span
        assert upper in span
        assert (lower + math.nan) not in span


@given(epochs=st.lists(st.integers(0, 2**32 - 1)))
def test_epochs_that_pass_never_fall(epochs: list[int]) -> None:
    fence, passed = EpochCheck("arm-1"), [0]
    for epoch in epochs:
        try:
            fence.admit(epoch)
        except StaleEpoch:
            assert epoch < passed[-1]
        else:
            passed.append(epoch)
    assert passed == sorted(passed)


def test_an_epoch_that_the_controller_has_seen_counts_too() -> None:
    fence = EpochCheck("arm-1")
    fence.raise_to(8)
    with pytest.raises(StaleEpoch, match="no longer obeys epoch 7, it is at 8"):
        fence.admit(7)
    fence.admit(8)


NEAR = 1e-3
"""How far beyond a limit is asked, in its unit."""
REACH = "only the controller knows what it can reach, but beyond this it can reach nothing"
TURN = "the controller takes any angle; the proxy takes one turn, so that degrees are noticed"

ARM: dict[str, tuple[float, float] | str] = {
    "x": REACH,
    "y": REACH,
    "z": REACH,
    "twist": TURN,
    "speed": (arm_device.SLOWEST, arm_device.TOP_SPEED),
    "blend": (0.0, WIDEST_BLEND),
    "width": (0.0, WIDEST),
}
ROVER: dict[str, tuple[float, float] | str] = {
    "x": (-2 * sim_rover.ARENA, 2 * sim_rover.ARENA),
    "y": (-2 * sim_rover.ARENA, 2 * sim_rover.ARENA),
    "speed": (sim_rover.SLOWEST, sim_rover.TOP_SPEED),
    "arena_x": (-sim_rover.ARENA, sim_rover.ARENA),
    "arena_y": (-sim_rover.ARENA, sim_rover.ARENA),
}


@pytest.mark.parametrize(("limits", "controller"), [(arm.LIMITS, ARM), (rover.LIMITS, ROVER)])
def test_every_limit_is_the_controllers_own_or_says_why_not(
    limits: dict[str, Span], controller: dict[str, tuple[float, float] | str]
) -> None:
    assert limits.keys() == controller.keys(), "a new limit belongs into the table above"
    both = {name: ends for name, ends in controller.items() if not isinstance(ends, str)}
    assert {name: (limits[name].lower, limits[name].upper) for name in both} == both
    assert arm.LIMITS["z"].lower == planner.LOWEST


@pytest.mark.parametrize(
    ("usual", "limits"), [(arm.USUAL_SPEED, arm.LIMITS["speed"]), (rover.USUAL_SPEED, rover.LIMITS["speed"])]
)
def test_the_usual_speed_is_one_that_both_sides_take(usual: float, limits: Span) -> None:
    assert usual in limits


@pytest.fixture(scope="module")
def bench() -> ArmBench:
    return ArmBench()


def judged(bench: ArmBench | RoverBench, motion: Motion) -> GoalStatus:
    """The controller's first word on a motion; what it has begun is then cancelled."""
    operator, request = bench.operator, motion.request()
    known = len(operator.all(GoalStatus))
    key = operator.ask(request.verb, *request.args)
    operator.until(lambda: any(each.key == key for each in operator.all(GoalStatus)[known:]), 1.0)
    status = next(each for each in operator.all(GoalStatus)[known:] if each.key == key)
    operator.cancel(key)
    return status


def passes(motion: Motion, limits: dict[str, Span]) -> bool:
    try:
        check(motion, limits, command="c")
    except BadArgument:
        return False
    return True


def go(**changes: float) -> GoTo:
    return GoTo(**{"x": 0.35, "y": 0.1, "z": 0.3, "twist": 0.0, "speed": 0.1, **changes})


@pytest.mark.parametrize(
    ("within", "beyond"),
    [
        (go(speed=arm.LIMITS["speed"].lower), go(speed=arm.LIMITS["speed"].lower - NEAR)),
        (go(speed=arm.LIMITS["speed"].upper), go(speed=arm.LIMITS["speed"].upper + NEAR)),
        (go(z=arm.LIMITS["z"].lower), go(z=arm.LIMITS["z"].lower - NEAR)),
        (Grip(width=arm.LIMITS["width"].lower), Grip(width=arm.LIMITS["width"].lower - NEAR)),
        (Grip(width=arm.LIMITS["width"].upper), Grip(width=arm.LIMITS["width"].upper + NEAR)),
        (go(), go(speed=math.nan)),
        (go(), go(x=math.inf)),
    ],
)
def test_guard_and_arm_answer_alike_on_either_side_of_a_limit(
    bench: ArmBench, within: Motion, beyond: Motion
) -> None:
    assert passes(within, arm.LIMITS)
    assert judged(bench, within).state in {GoalState.ACCEPTED, GoalState.ACTIVE}
    assert not passes(beyond, arm.LIMITS)
    if not any(math.isnan(arg) for arg in beyond.request().args):  # to the controller NaN is: as usual
        status = judged(bench, beyond)
        assert status.state == GoalState.REFUSED
        assert status.reason in {Reason.BAD_ARGUMENT, Reason.OUT_OF_REACH}


def outside() -> Iterator[GoTo]:
    """Points a little outside of each face of the arm's box, all over it."""
    chance = random.Random(1)
    for name in ("x", "y", "z"):
        for end in (arm.LIMITS[name].lower - NEAR, arm.LIMITS[name].upper + NEAR):
            for _ in range(8):
                inside = {
                    each: chance.uniform(arm.LIMITS[each].lower, arm.LIMITS[each].upper)
                    for each in ("x", "y", "z", "twist")
                }
                yield go(**{**inside, name: end})


def test_the_box_of_the_guard_keeps_nothing_back_that_the_arm_could_reach(bench: ArmBench) -> None:
    for point in outside():
        assert not passes(point, arm.LIMITS)
        assert judged(bench, point).reason == Reason.OUT_OF_REACH, point


def test_a_turn_too_many_is_the_guards_business_alone(bench: ArmBench) -> None:
    turned = go(twist=arm.LIMITS["twist"].upper + 0.1)
    assert not passes(turned, arm.LIMITS)
    assert judged(bench, turned).state in {GoalState.ACCEPTED, GoalState.ACTIVE}


@pytest.mark.parametrize("axis", ["x", "y"])
def test_guard_and_rover_answer_alike_at_the_ends_of_the_arena_and_of_the_longest_move(axis: str) -> None:
    bench, ends = RoverBench(), rover.LIMITS[f"arena_{axis}"]

    def move(by: float) -> Move:
        return Move(**{"x": 0.0, "y": 0.0, "speed": 1.0, axis: by})

    def arrives(by: float) -> bool:
        here = {"x": 0.0, "y": 0.0, axis: place}
        try:
            check_arrival(move(by), (here["x"], here["y"]), rover.LIMITS, command="c")
        except BadArgument:
            return False
        return passes(move(by), rover.LIMITS)

    place = 0.0
    for by in (ends.lower, ends.upper - ends.lower):
        beyond = by + math.copysign(NEAR, by)
        assert (arrives(by), arrives(beyond)) == (True, False)
        assert judged(bench, move(beyond)).reason == Reason.OUT_OF_REACH
        request = move(by).request()
        assert bench.operator.do(request.verb, *request.args).state == GoalState.SUCCEEDED
        place += by


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_guard_and_rover_answer_alike_on_either_side_of_a_speed(end: str) -> None:
    bench, speed = RoverBench(), getattr(rover.LIMITS["speed"], end)
    beyond = speed + (NEAR if end == "upper" else -NEAR)
    for asked, taken in ((speed, True), (beyond, False)):
        motion = Move(x=0.1, y=0.0, speed=asked)
        assert passes(motion, rover.LIMITS) is taken
        assert (judged(bench, motion).state != GoalState.REFUSED) is taken
