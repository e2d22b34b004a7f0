"""The limits that proxy and controller both know: the same numbers, and the same answers at each of them.

They are written twice on purpose (docs/decisions/0008): the proxy refuses early, the controller for sure.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator

import pytest

from robotree.protocol.messages import GoalState, GoalStatus, Reason
from robotree.proxy import arm, rover
from robotree.proxy.arm import GoTo, Grip
from robotree.proxy.guard import Span, check
from robotree.proxy.motion import Motion
from robotree.proxy.rover import Move, check_arrival
from robotree.sim.arm import planner
from robotree.sim.arm import tuning as arm_tuning
from robotree.sim.arm.device import WIDEST_BLEND
from robotree.sim.firmware.device import WIDEST
from robotree.sim.rover import device as sim_rover
from robotree.sim.testing import ArmBench, RoverBench
from robotree.vr.base.errors import BadArgument

NEAR = 1e-3
"""How far beyond a limit is asked, in its unit."""
REACH = "only the controller knows what it can reach, but beyond this it can reach nothing"
TURN = "the controller takes any angle; the proxy takes one turn, so that degrees are noticed"

ARM: dict[str, tuple[float, float] | str] = {
    "x": REACH,
    "y": REACH,
    "z": REACH,
    "twist": TURN,
    "speed": (arm_tuning.SLOWEST, arm_tuning.TOP_SPEED),
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
