"""The thesis' task: close the lever, open it again, gently, whatever the network does."""

from __future__ import annotations

import math
import re

import pytest

from robotree.protocol.messages import GoalState, GripperState, Reason, Verb
from robotree.protocol.messages import Gripper as GripperMessage
from robotree.sim.testing import ArmBench, Operator

TWIST = math.pi / 2
ARC = 1.57
STEPS = 6


def grip_point(angle: float, up: float = 0.0) -> tuple[float, float, float]:
    """Where to grip the handle, as docs/cell.md says."""
    return 0.42 + 0.20 * math.sin(angle), 0.10, 0.08 + 0.20 * math.cos(angle) + up


def take_hold(operator: Operator, angle: float) -> None:
    operator.succeed(Verb.GRIP, 0.07)
    operator.succeed(Verb.GO_TO, *grip_point(angle, up=0.10), TWIST)
    operator.succeed(Verb.GO_TO, *grip_point(angle), TWIST, 0.05)
    operator.succeed(Verb.GRIP, 0.0)


def let_go(operator: Operator, angle: float) -> None:
    operator.succeed(Verb.GRIP, 0.07)
    operator.succeed(Verb.GO_TO, *grip_point(angle, up=0.10), TWIST)


def swing(operator: Operator, start: float, end: float) -> None:
    take_hold(operator, start)
    for step in range(1, STEPS + 1):
        operator.succeed(Verb.GO_TO, *grip_point(start + (end - start) * step / STEPS), TWIST)
    let_go(operator, end)


def test_the_lever_is_closed_with_less_than_35_newtons_though_each_word_is_a_second_late() -> None:
    bench = ArmBench(delay=1.0)
    swing(bench.operator, -ARC / 2, ARC / 2)
    assert bench.world.lever_angle > 0.75
    assert 5.0 < bench.world.arm.state().peak_force < 35.0


def test_the_lever_is_opened_with_less_than_35_newtons(arm: ArmBench) -> None:
    arm.world.lever[:] = ARC / 2
    swing(arm.operator, ARC / 2, -ARC / 2)
    assert arm.world.lever_angle < -0.75
    assert 5.0 < arm.world.arm.state().peak_force < 35.0


def test_friction_does_not_keep_the_lever_open(arm: ArmBench) -> None:
    joints = slice(0, 6)
    arm.world.cell.model.dof_frictionloss[joints] *= 5.0
    swing(arm.operator, -ARC / 2, ARC / 2)
    assert arm.world.lever_angle > 0.75
    assert arm.world.arm.state().peak_force < 35.0


def test_even_the_chord_instead_of_the_arc_stays_bounded(arm: ArmBench) -> None:
    take_hold(arm.operator, -ARC / 2)
    arm.operator.succeed(Verb.GO_TO, *grip_point(ARC / 2), TWIST)
    assert arm.world.lever_angle > 0.75
    assert arm.world.arm.state().peak_force < 35.0


def test_the_gripper_says_that_it_holds_the_handle_and_a_jammed_lever_ends_the_goal_with_the_reason(
    arm: ArmBench,
) -> None:
    take_hold(arm.operator, -ARC / 2)
    arm.operator.wait(0.2)
    gripper = arm.operator.latest(GripperMessage)
    assert gripper.state == GripperState.HOLDING
    assert gripper.width == pytest.approx(0.024, abs=0.001)
    assert 5.0 < gripper.force <= 15.0
    assert gripper.commanded == 0.0
    x, y, z = grip_point(-ARC / 2)
    status = arm.operator.do(Verb.GO_TO, x - 0.1, y, z - 0.1, TWIST)
    assert (status.state, status.reason) == (GoalState.FAILED, Reason.BLOCKED)
    assert re.fullmatch(
        r"Something holds the tool with \d+ N, \d+ mm short; go up, or see what it touches", status.text
    )
    assert arm.world.arm.state().peak_force < 45.0


def test_released_anywhere_but_upright_the_lever_snaps_to_a_stop(arm: ArmBench) -> None:
    for angle, end in ((-0.05, -0.785), (0.05, 0.785), (0.6, 0.785)):
        arm.world.lever[:] = angle
        arm.operator.wait(3.0)
        assert arm.world.lever_angle == pytest.approx(end, abs=0.01)
