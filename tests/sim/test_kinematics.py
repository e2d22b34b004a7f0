"""Pinocchio computes what MuJoCo simulates, and a tool that points down is found again."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.sim.arm import model as arm
from robotree.sim.arm.kinematics import HOME, ROLL, Kinematics, tool_down, twist_of
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

KINEMATICS = Kinematics()
LOWER, UPPER = KINEMATICS.lower.tolist(), KINEMATICS.upper.tolist()
MODEL = arm.spec().compile()


def postures() -> st.SearchStrategy[Vector]:
    angles = [st.floats(low, high) for low, high in zip(LOWER, UPPER, strict=True)]
    return st.tuples(*angles).map(np.array)


def downward_postures() -> st.SearchStrategy[Vector]:
    """Elbow up, forearm not rolled, tool pointing down."""

    def complete(yaw: float, bend: float, forearm: float, twist: float) -> Vector:
        return np.array((yaw, forearm - bend, bend, 0.0, math.pi - forearm, twist))

    angles = (st.floats(-2.8, 2.8), st.floats(0.6, 2.5), st.floats(1.2, 2.3), st.floats(-3.0, 3.0))
    return st.builds(complete, *angles)


def simulated(q: Vector, v: Vector) -> mujoco.MjData:
    data = mujoco.MjData(MODEL)
    data.qpos[:6], data.qvel[:6], data.qpos[6:] = q, v, 0.03
    mujoco.mj_forward(MODEL, data)
    return data


@given(q=postures())
def test_both_engines_put_the_tool_in_the_same_place(q: Vector) -> None:
    data, tool = simulated(q, np.zeros(6)), MODEL.site("tcp").id
    position, rotation = KINEMATICS.pose(q)
    np.testing.assert_allclose(position, data.site_xpos[tool], atol=1e-12)
    np.testing.assert_allclose(rotation, data.site_xmat[tool].reshape(3, 3), atol=1e-12)


@given(q=postures(), seed=st.integers(0, 2**32 - 1))
def test_both_engines_feel_the_same_gravity_and_velocity(q: Vector, seed: int) -> None:
    v = np.random.default_rng(seed).uniform(-1, 1, 6)
    data = simulated(q, v)
    np.testing.assert_allclose(KINEMATICS.dynamics(q, v).bias, data.qfrc_bias[:6], atol=1e-9)


@given(q=postures(), seed=st.integers(0, 2**32 - 1))
def test_the_jacobian_is_the_pose_differentiated(q: Vector, seed: int) -> None:
    v = np.random.default_rng(seed).uniform(-1, 1, 6)
    h = 1e-6
    ahead, behind = KINEMATICS.pose(q + h * v)[0], KINEMATICS.pose(q - h * v)[0]
    velocity = KINEMATICS.dynamics(q, v).jacobian @ v
    np.testing.assert_allclose(velocity[:3], (ahead - behind) / (2 * h), atol=1e-6)


@given(q=downward_postures(), nudge=st.integers(0, 2**32 - 1))
@settings(deadline=None)
def test_a_downward_pose_is_found_again_from_nearby(q: Vector, nudge: int) -> None:
    position, rotation = KINEMATICS.pose(q)
    seed = np.clip(q + np.random.default_rng(nudge).uniform(-0.2, 0.2, 6), KINEMATICS.lower, KINEMATICS.upper)
    found = KINEMATICS.solve(position, rotation, seed)
    assert found.reached
    reached, turned = KINEMATICS.pose(found.q)
    np.testing.assert_allclose(reached, position, atol=2e-4)
    np.testing.assert_allclose(turned, rotation, atol=2e-4)


@given(q=downward_postures())
@settings(deadline=None)
def test_the_forearm_is_never_rolled_to_get_there(q: Vector) -> None:
    seed = np.array(HOME)
    seed[ROLL] = 2.0
    assert KINEMATICS.solve(*KINEMATICS.pose(q), seed).q[ROLL] == 0.0


def test_what_is_out_of_reach_is_not_found() -> None:
    assert not KINEMATICS.solve(np.array((0.9, 0.0, 0.2)), tool_down(0.0), np.array(HOME)).reached


@given(twist=st.floats(-math.pi + 1e-9, math.pi))
def test_a_twist_reads_back_as_itself(twist: float) -> None:
    assert math.isclose(twist_of(tool_down(twist)), twist, abs_tol=1e-9)


def test_the_arm_is_switched_on_with_its_tool_down() -> None:
    _, rotation = KINEMATICS.pose(np.array(HOME))
    np.testing.assert_allclose(rotation, tool_down(0.0), atol=1e-12)
