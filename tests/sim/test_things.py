"""The lever of the thesis' task and a block to pick up, handled gently, whatever the network does."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from robotree.protocol.messages import GoalState, Gripper, GripperState, Reason, Verb
from robotree.protocol.messages import Gripper as GripperMessage
from robotree.sim.arm.world import BLOCK, BLOCK_SIDE
from robotree.sim.physics.camera import Renderer
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


def test_the_lever_is_closed_with_less_than_35_newtons_though_joints_rub_and_each_word_is_late() -> None:
    bench = ArmBench(delay=0.5)
    bench.world.cell.model.dof_frictionloss[:6] *= 5.0
    swing(bench.operator, -ARC / 2, ARC / 2)
    assert bench.world.lever_angle > 0.75
    assert 5.0 < bench.world.arm.state().peak_force < 35.0


def test_the_lever_is_opened_with_less_than_35_newtons(arm: ArmBench) -> None:
    arm.world.lever[:] = ARC / 2
    swing(arm.operator, ARC / 2, -ARC / 2)
    assert arm.world.lever_angle < -0.75
    assert 5.0 < arm.world.arm.state().peak_force < 35.0


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
        arm.operator.wait(1.5)
        assert arm.world.lever_angle == pytest.approx(end, abs=0.01)


X, Y, _ = BLOCK.foot
LOW, HIGH = 0.03, 0.15
STILL = 0.0005
"""[m]"""


def test_a_block_that_nobody_touches_takes_no_part_in_a_step(arm: ArmBench) -> None:
    arm.operator.succeed(Verb.GO_TO, 0.4, 0.0, 0.35, 0.0)
    model, data = arm.world.cell.model, arm.world.cell.data
    assert arm.world.block_place == pytest.approx(BLOCK.foot, abs=STILL)
    assert data.ntree_awake == 2, "the arm and the lever, which tests and people may set"
    assert model.nv - data.nv_awake == 6
    assert data.ncon == 0


def test_a_sleeping_block_is_pushed_aside_by_the_fingers(arm: ArmBench) -> None:
    arm.operator.succeed(Verb.GRIP, 0.0)
    arm.operator.succeed(Verb.GO_TO, X, -0.10, HIGH, 0.0)
    arm.operator.succeed(Verb.GO_TO, X, -0.10, LOW, 0.0)
    arm.operator.succeed(Verb.GO_TO, X, -0.22, LOW, 0.0, 0.05)
    assert arm.world.block_place[1] < Y - 0.05


def height_in_picture(arm: ArmBench) -> float:
    """Row of the middle of what is green, counted from the top; nan: nothing is."""
    cell = arm.world.cell
    picture = Renderer(cell.model).picture(cell.published, "cell", 320, 180).astype(int)
    red, green, blue = (picture[..., i] for i in range(3))
    return float(np.argwhere((green > 1.2 * red) & (green > 1.2 * blue))[:, 0].mean())


def test_a_block_is_picked_up_shown_carried_and_falls_when_it_is_let_go(arm: ArmBench) -> None:
    """To set it down is the example `pick_and_place`'s."""
    lying = height_in_picture(arm)
    arm.operator.succeed(Verb.GO_TO, X, Y, HIGH, 0.0)
    arm.operator.succeed(Verb.GO_TO, X, Y, LOW, 0.0)
    arm.operator.succeed(Verb.GRIP, 0.0)
    arm.operator.succeed(Verb.GO_TO, X, Y, HIGH, 0.0)
    arm.operator.wait(0.2)
    gripper = arm.operator.latest(Gripper)
    assert gripper.state == GripperState.HOLDING
    assert gripper.width == pytest.approx(BLOCK_SIDE, abs=0.001)
    assert arm.world.block_place[2] == pytest.approx(BLOCK_SIDE / 2 + HIGH - LOW, abs=0.004)
    assert height_in_picture(arm) < lying - 10, "higher in the picture"
    arm.operator.succeed(Verb.GO_TO, X, -0.25, HIGH, 0.0)
    assert arm.world.block_place[:2] == pytest.approx((X, -0.25), abs=0.004)
    arm.operator.succeed(Verb.GRIP, 0.08)
    arm.operator.wait(2.0)
    assert arm.world.block_place[2] == pytest.approx(BLOCK_SIDE / 2, abs=0.002)
    assert arm.world.cell.data.ntree_awake == 2, "it sleeps again"
