"""A move with a blend counts as reached in passing: the arm goes on to the point, or from there to the next.

What ends any move ends it then too, though nobody waits for it any more.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from robotree.protocol.messages import (
    GoalState,
    MavCmd,
    MavResult,
    ModeKind,
    Reason,
    Setpoint,
    SetpointKind,
    Tool,
    Verb,
)
from robotree.sim.arm.device import TOP_SPEED, WIDEST_BLEND
from robotree.sim.firmware import SILENCE
from robotree.sim.physics.vectors import Vector
from robotree.sim.testing import NAN, ArmBench, Operator

BLEND = 0.02
REACHED = 0.004
"""[m] that friction may leave between the tool and a point where it stands."""


class Watched:
    """The arm, and how fast its tool is."""

    def __init__(self, silence: float = SILENCE) -> None:
        self.bench = ArmBench(silence=silence)
        self.operator = self.bench.operator
        self.start = self.position
        self.speeds: list[float] = []

    @property
    def position(self) -> Vector:
        return self.bench.world.arm.state().position

    def away(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> tuple[float, ...]:
        """A point beside the start."""
        return tuple(np.add(self.start, (x, y, z)).tolist())

    def pass_by(self, point: tuple[float, ...], speed: float = 0.2, blend: float = BLEND) -> int:
        """Go to a point; returns its key when it counts as reached."""
        key = self.operator.ask(Verb.GO_TO, *point, NAN, speed, blend)
        self.watch(lambda: self.operator.knows(key) and GoalState(self.operator.status_of(key).state).final)
        assert self.operator.status_of(key).state == GoalState.SUCCEEDED
        return key

    def watch(self, until: Callable[[], bool]) -> None:
        """Let the world go on, and measure how fast the tool is [m/s]."""
        while not until():
            before, at = self.operator.now, self.position
            self.operator.step()
            self.speeds.append(math.dist(self.position, at) / (self.operator.now - before))
            assert len(self.speeds) < 20_000

    def come_to_rest(self) -> None:
        """Wait until it has gone on to its last point."""
        self.watch(lambda: self.operator.mode()[0] != ModeKind.ACTIVE)

    def far_from(self, point: tuple[float, ...]) -> float:
        return math.dist(self.position, point)


@pytest.fixture
def arm() -> Watched:
    return Watched()


def test_it_counts_as_reached_within_the_blend_and_the_tool_goes_on_to_the_point(arm: Watched) -> None:
    point = arm.away(y=0.1)
    arm.pass_by(point)
    assert BLEND / 2 < arm.far_from(point) <= BLEND
    assert arm.operator.mode()[0] == ModeKind.ACTIVE
    assert arm.operator.latest(Tool).busy
    arm.come_to_rest()
    assert arm.far_from(point) < REACHED
    arm.operator.wait(0.2)
    assert not arm.operator.latest(Tool).busy


def test_without_a_blend_the_tool_stands_at_the_point(arm: Watched) -> None:
    for y, blend in ((0.03, ()), (0.0, (0.0,)), (0.03, (NAN,))):
        arm.operator.succeed(Verb.GO_TO, *arm.away(y=y), NAN, 0.2, *blend)
        assert arm.far_from(arm.away(y=y)) < REACHED


@pytest.mark.parametrize(
    "to", [(0.0, 0.2, 0.0), (0.07, 0.1, 0.07), (0.0, 0.0, 0.0)], ids=["on", "aside", "back"]
)
def test_a_move_flows_into_the_next_within_the_speed(arm: Watched, to: tuple[float, ...]) -> None:
    arm.pass_by(arm.away(y=0.1), speed=TOP_SPEED)
    assert arm.speeds[-1] > 0.05
    arm.speeds.clear()
    arm.pass_by(arm.away(*to), speed=TOP_SPEED)
    if any(to):
        assert min(arm.speeds) > 0.02, "it did not stand between"
    arm.come_to_rest()
    assert max(arm.speeds) <= TOP_SPEED
    assert arm.far_from(arm.away(*to)) < REACHED


@pytest.mark.parametrize("blend", [0.0, BLEND])
def test_on_a_long_way_the_tool_makes_up_for_what_its_spring_was_late(arm: Watched, blend: float) -> None:
    for y in (-0.2, 0.2, -0.2):
        arm.pass_by((0.4, y, 0.4), speed=TOP_SPEED, blend=blend)
    assert TOP_SPEED < max(arm.speeds) < 1.1 * TOP_SPEED


def test_a_chain_of_small_steps_is_one_motion(arm: Watched) -> None:
    points = [arm.away(y=0.004 * step) for step in range(1, 16)]
    began = arm.operator.now
    for point in points[:3]:
        arm.operator.succeed(Verb.GO_TO, *point, NAN, 0.2)
    with_a_stand = (arm.operator.now - began) / 3
    began = arm.operator.now
    for point in points[3:]:
        arm.pass_by(point, blend=0.005)
    assert (arm.operator.now - began) / 12 < with_a_stand / 2
    arm.come_to_rest()
    assert arm.far_from(points[-1]) < REACHED
    assert max(arm.speeds) <= TOP_SPEED


def test_asked_for_again_by_its_key_it_is_not_gone_to_again(arm: Watched) -> None:
    first, second = arm.away(y=0.05), arm.away(y=0.15)
    key = arm.pass_by(first)
    arm.operator.ask(Verb.GO_TO, *second, NAN, 0.2, BLEND)
    arm.operator.wait(0.2)
    assert (
        arm.operator.end_of(arm.operator.ask(Verb.GO_TO, *first, NAN, 0.2, BLEND, key=key)).state
        == GoalState.SUCCEEDED
    )
    arm.come_to_rest()
    assert arm.far_from(second) < REACHED


def test_it_does_not_count_as_reached_before_it_has_turned(arm: Watched) -> None:
    twist = arm.bench.world.arm.state().twist
    arm.operator.succeed(Verb.GO_TO, *arm.away(), twist + 0.8, 0.2, BLEND)
    assert arm.bench.world.arm.state().twist - twist > 0.65


ENDINGS: dict[str, Callable[[Operator], object]] = {
    "stop": lambda operator: operator.set_mode(ModeKind.SAFE_STOP),
    "cancel of whichever runs": lambda operator: operator.cancel(0),
    "hold": lambda operator: operator.ask(Verb.HOLD),
    "silence": lambda operator: setattr(operator, "silent", True),
    "control": lambda operator: operator.another(191).order(MavCmd.REQUEST_OPERATOR_CONTROL, 1, 0),
    "lost link": lambda operator: operator.controller.leave(operator.far),
    "fingers": lambda operator: operator.ask(Verb.GRIP, 0.02),
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_ends_a_move_brakes_one_that_has_counted_as_reached(ending: str) -> None:
    arm = Watched(silence=1.2)
    point = arm.away(y=0.045)
    arm.pass_by(point, speed=0.02, blend=WIDEST_BLEND)
    ENDINGS[ending](arm.operator)
    arm.operator.wait(1.6 if ending == "silence" else 0.5)
    stands = arm.position
    arm.operator.wait(0.2)
    assert math.dist(arm.position, stands) < 0.001
    assert arm.far_from(point) > 0.01


def test_a_set_point_goes_on_from_a_move_that_has_counted_as_reached(arm: Watched) -> None:
    point = arm.away(y=0.045)
    arm.pass_by(point, speed=0.02, blend=WIDEST_BLEND)
    for number in range(1, 40):
        upward = (0.0, 0.0, 0.05, *(NAN,) * 4)
        arm.operator.say(Setpoint(0, 1, number, upward, 200, 1, 1, SetpointKind.TOOL_VELOCITY))
        arm.operator.wait(0.02)
    assert arm.position[2] > point[2] + 0.01
    assert arm.position[1] < point[1] - 0.01


def test_as_a_command_it_is_accepted_in_passing(arm: Watched) -> None:
    point = arm.away(y=0.1)
    ack = arm.operator.command(MavCmd.ROBOTREE_GO_TO, *point, NAN, BLEND, NAN, 0.2)
    assert ack.result == MavResult.ACCEPTED
    assert BLEND / 2 < arm.far_from(point) <= BLEND


def test_a_blend_out_of_range_is_refused(arm: Watched) -> None:
    for blend in (-0.001, 0.051, math.inf):
        status = arm.operator.do(Verb.GO_TO, *arm.away(y=0.1), NAN, 0.2, blend)
        assert (status.state, status.reason) == (GoalState.REFUSED, Reason.BAD_ARGUMENT)
