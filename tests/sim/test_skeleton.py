"""The skeleton of the arm: its joints are where MuJoCo has them, and it is told only to who asks."""

from __future__ import annotations

import numpy as np

from robotree.protocol.messages import MavCmd, Skeleton, Verb
from robotree.sim.testing import ArmBench


def test_the_joints_are_where_mujoco_has_them(arm: ArmBench) -> None:
    arm.operator.succeed(Verb.GO_TO, 0.35, 0.15, 0.3, 0.5, 0.25)
    assert arm.operator.all(Skeleton) == [], "nobody has asked"
    arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, Skeleton.codec.definition.id, 100_000)
    arm.operator.wait(0.5)
    told = arm.operator.latest(Skeleton)
    assert told.count == 8
    places = np.array((told.x, told.y, told.z)).T[: told.count]
    model, data = arm.world.cell.model, arm.world.cell.data
    joints = [joint for joint in range(model.njnt) if model.joint(joint).name.startswith("arm/")][:6]
    np.testing.assert_allclose(places[1:-1], data.xanchor[joints], atol=2e-3)
    np.testing.assert_allclose(places[-1], arm.world.arm.state().position, atol=1e-3)
    assert places[0].tolist() == [0.0, 0.0, 0.0]
