"""The law's promises: bounded force at any error, 20 mm for 10 N and back again, a sensor that is right."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import Reason, Verb
from robotree.sim.arm.compliance import FORCE_LIMIT, TORQUE_LIMIT, NaturalAdmittance, pointing_down
from robotree.sim.arm.kinematics import HOME, Kinematics
from robotree.sim.motion.path import Reference
from robotree.sim.testing import ArmBench

KINEMATICS = Kinematics()
DIAGONAL = np.array((0.577, -0.577, 0.577))
"""A push along it that yields along it shows that all three axes have the same spring."""


@given(goal=st.tuples(*[st.floats(-100, 100)] * 3), twist=st.floats(-math.pi, math.pi))
def test_no_error_however_large_pulls_harder_than_the_limit(
    goal: tuple[float, float, float], twist: float
) -> None:
    q, rest = np.array(HOME), np.zeros(6)
    dynamics = KINEMATICS.dynamics(q, rest)
    attractor = pointing_down(Reference(np.array((*goal, twist)), np.zeros(4)))
    effort = NaturalAdmittance().effort(dynamics, q, rest, attractor, np.zeros(6), 1e-9)
    pull = np.linalg.solve(dynamics.jacobian.T, effort.torque - dynamics.bias)
    assert np.linalg.norm(pull[:3]) <= FORCE_LIMIT + 1e-3
    assert np.linalg.norm(pull[3:]) <= TORQUE_LIMIT + 1e-3


def test_ten_newtons_yield_twenty_millimetres_and_it_comes_back(arm: ArmBench) -> None:
    operator, data = arm.operator, arm.world.cell.data
    operator.succeed(Verb.GO_TO, 0.40, -0.15, 0.30, 0.3)
    operator.wait(1.0)
    before = arm.world.arm.state().position
    push, hand = DIAGONAL, arm.world.cell.model.body("arm/hand").id
    data.xfrc_applied[hand, :3] = 10.0 * push
    operator.wait(4.0)
    pushed = arm.world.arm.state()
    assert np.linalg.norm(pushed.position - before) == pytest.approx(0.020, abs=0.001)
    assert (pushed.position - before) @ push == pytest.approx(0.020, abs=0.001), "it yields along the push"
    np.testing.assert_allclose(pushed.wrench[:3], 10.0 * push, atol=0.05)
    data.xfrc_applied[hand, :3] = 0.0
    operator.wait(4.0)
    assert np.linalg.norm(arm.world.arm.state().position - before) < 0.0005


def test_friction_does_not_spoil_the_compliance(arm: ArmBench) -> None:
    arm.world.cell.model.dof_frictionloss[:] *= 5.0
    operator, hand = arm.operator, arm.world.cell.model.body("arm/hand").id
    operator.wait(2.0)
    before = arm.world.arm.state().position
    arm.world.cell.data.xfrc_applied[hand, 0] = 10.0
    operator.wait(5.0)
    assert np.linalg.norm(arm.world.arm.state().position - before) == pytest.approx(0.020, abs=0.001)


def test_at_rest_the_wrist_feels_nothing_in_any_posture(arm: ArmBench) -> None:
    for point in ((0.4, 0.2, 0.2, 1.0), (0.25, -0.3, 0.4, -2.0)):
        arm.operator.succeed(Verb.GO_TO, *point)
        arm.operator.wait(2.0)
        np.testing.assert_allclose(arm.world.arm.state().wrench, 0.0, atol=0.1)


def test_a_hard_stop_is_pressed_with_the_limit_and_no_more(arm: ArmBench) -> None:
    """The foot of the lever's stand, pressed from the side."""
    operator = arm.operator
    operator.succeed(Verb.GRIP, 0.0)
    operator.succeed(Verb.GO_TO, 0.42, -0.15, 0.06, math.pi / 2)
    key = operator.ask(Verb.GO_TO, 0.42, 0.06, 0.06, math.pi / 2, 0.05)
    operator.until(lambda: abs(arm.world.arm.state().wrench[1]) > 0.9 * FORCE_LIMIT, within=8.0)
    operator.wait(1.0)
    assert np.linalg.norm(arm.world.arm.state().wrench[:3]) == pytest.approx(FORCE_LIMIT, abs=1.0)
    assert operator.end_of(key).reason == Reason.BLOCKED
    operator.wait(1.0)
    assert np.linalg.norm(arm.world.arm.state().wrench[:3]) < 5.0, "a blocked arm lets go of the pressure"
    assert arm.world.arm.state().peak_force < 45.0
