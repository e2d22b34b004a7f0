"""A block to pick up: it lies, is carried and falls as a block does, and costs nothing while it lies."""

from __future__ import annotations

import numpy as np
import pytest

from robotree.protocol.messages import Gripper, GripperState, Verb
from robotree.sim.arm.world import BLOCK, BLOCK_SIDE
from robotree.sim.physics.camera import Renderer
from robotree.sim.testing import ArmBench

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
