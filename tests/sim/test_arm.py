"""What the arm promises, from its law to its fingers.

Force is bounded at any error, 10 N yield 20 mm and no more, the sensor is right, fingers go where they are
sent or say what stopped them; and of random goals all over the workspace each is reached or refused.
"""

from __future__ import annotations

import collections
import math
import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import GoalState, Reason, Verb
from robotree.sim.arm.compliance import FORCE_LIMIT, TORQUE_LIMIT, NaturalAdmittance, pointing_down
from robotree.sim.arm.hand import SPEED, Grip, Gripper
from robotree.sim.arm.kinematics import HOME, Kinematics
from robotree.sim.firmware.device import WIDEST
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
    operator.wait(2.5)
    pushed = arm.world.arm.state()
    assert np.linalg.norm(pushed.position - before) == pytest.approx(0.020, abs=0.001)
    assert (pushed.position - before) @ push == pytest.approx(0.020, abs=0.001), "it yields along the push"
    np.testing.assert_allclose(pushed.wrench[:3], 10.0 * push, atol=0.05)
    data.xfrc_applied[hand, :3] = 0.0
    operator.wait(2.5)
    assert np.linalg.norm(arm.world.arm.state().position - before) < 0.0005


def test_friction_does_not_spoil_the_compliance(arm: ArmBench) -> None:
    arm.world.cell.model.dof_frictionloss[:] *= 5.0
    operator, hand = arm.operator, arm.world.cell.model.body("arm/hand").id
    operator.wait(1.0)
    before = arm.world.arm.state().position
    arm.world.cell.data.xfrc_applied[hand, 0] = 10.0
    operator.wait(3.0)
    assert np.linalg.norm(arm.world.arm.state().position - before) == pytest.approx(0.020, abs=0.001)


def test_at_rest_the_wrist_feels_nothing_in_any_posture(arm: ArmBench) -> None:
    for point in ((0.4, 0.2, 0.2, 1.0), (0.25, -0.3, 0.4, -2.0)):
        arm.operator.succeed(Verb.GO_TO, *point)
        arm.operator.wait(1.0)
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


DT = 0.001


def lead(gripper: Gripper, seconds: float, width: float, *, obstacle: float = 0.0) -> float:
    """Ideal fingers that follow at once, down to an obstacle."""
    for _ in range(round(seconds / DT)):
        before = width
        width = max(gripper.advance(DT, width, 0.0), obstacle)
        gripper.advance(0.0, width, (width - before) / DT)
    return width


@given(first=st.floats(0, WIDEST), then=st.floats(0, WIDEST))
def test_free_fingers_arrive_at_the_width(first: float, then: float) -> None:
    gripper = Gripper(first)
    gripper.move(then)
    assert abs(lead(gripper, 1.0, first) - then) < 1e-9
    assert gripper.state is Grip.AT_WIDTH


def test_they_do_not_jump_but_travel() -> None:
    gripper = Gripper(0.06)
    gripper.move(0.0)
    width = lead(gripper, 0.1, 0.06)
    assert gripper.state is Grip.MOVING
    assert abs(width - (0.06 - 0.1 * SPEED)) < 1e-6


def test_stopped_by_an_object_they_hold_it() -> None:
    gripper = Gripper(0.06)
    gripper.move(0.0)
    lead(gripper, 1.0, 0.06, obstacle=0.024)
    assert gripper.state is Grip.HOLDING


def test_a_hand_that_is_shaken_still_holds_what_stands_between_its_fingers() -> None:
    gripper = Gripper(0.08)
    gripper.move(0.0)
    lead(gripper, 1.0, 0.08, obstacle=0.062)
    for speed in (0.003, -0.003):
        gripper.advance(DT, 0.062 + speed * DT, speed)
        assert gripper.state is Grip.HOLDING, "the base has begun to drive: a tenth of a millimetre"


def test_what_slips_out_is_held_no_longer() -> None:
    gripper = Gripper(0.08)
    gripper.move(0.0)
    lead(gripper, 1.0, 0.08, obstacle=0.062)
    lead(gripper, 0.05, 0.062, obstacle=0.058)
    assert gripper.state is Grip.MOVING
    lead(gripper, 0.5, 0.058)
    assert gripper.state is Grip.AT_WIDTH


def test_a_halt_keeps_what_is_held_and_stops_what_moves() -> None:
    holding = Gripper(0.06)
    holding.move(0.0)
    lead(holding, 1.0, 0.06, obstacle=0.024)
    holding.halt(0.024)
    assert (holding.state, holding.commanded) == (Grip.HOLDING, 0.0)
    moving = Gripper(0.06)
    moving.move(0.0)
    width = lead(moving, 0.1, 0.06)
    moving.halt(width)
    assert lead(moving, 1.0, width) == width


@given(width=st.floats(-1, 1))
def test_no_width_beyond_the_mechanism_is_asked_of_it(width: float) -> None:
    gripper = Gripper(0.06)
    gripper.move(width)
    assert 0.0 <= gripper.commanded <= WIDEST


HONEST = {Reason.OUT_OF_REACH, Reason.PATH_BLOCKED}


def random_goal(chance: random.Random, azimuth: float) -> tuple[float, ...]:
    radius = chance.uniform(0.2, 0.6)
    x, y = radius * math.cos(azimuth), radius * math.sin(azimuth)
    return x, y, chance.uniform(0.05, 0.5), chance.uniform(-math.pi, math.pi), 0.25


def visit(seed: int, count: int, *, lever: bool) -> collections.Counter[tuple[GoalState, Reason]]:
    arm = ArmBench()
    if not lever:
        arm.world.cell.model.body("lever/stand").pos[:] = (3.0, 0.0, 0.0)
    chance = random.Random(seed)
    ends: collections.Counter[tuple[GoalState, Reason]] = collections.Counter()
    azimuth = 0.0
    for i in range(count):
        # Mostly near the last one, to spare simulated time; every tenth anywhere, across the base too.
        step = math.pi if i % 10 == 0 else 0.8
        azimuth = math.remainder(azimuth + chance.uniform(-step, step), math.tau)
        goal = random_goal(chance, azimuth)
        status = arm.operator.do(Verb.GO_TO, *goal, within=40.0)
        ends[GoalState(status.state), Reason(status.reason)] += 1
        if status.state == GoalState.SUCCEEDED and not status.text:
            assert np.linalg.norm(arm.world.arm.state().position - goal[:3]) < 0.004, goal
        arm.operator.heard.clear()
    return ends


@pytest.mark.timeout(300)
def test_of_six_goals_on_a_bare_table_none_gets_stuck() -> None:
    """The soak test visits a thousand."""
    ends = visit(seed=5, count=6, lever=False)
    reached = ends.pop((GoalState.SUCCEEDED, Reason.NONE))
    assert reached >= 4
    assert {state for state, _ in ends} <= {GoalState.REFUSED}
    assert {reason for _, reason in ends} <= HONEST


@pytest.mark.timeout(300)
def test_with_a_lever_in_the_way_every_goal_still_ends_with_a_reason() -> None:
    ends = visit(seed=7, count=4, lever=True)
    assert sum(ends.values()) == 4
    assert set(ends) <= {
        (GoalState.SUCCEEDED, Reason.NONE),
        (GoalState.FAILED, Reason.BLOCKED),
        *((GoalState.REFUSED, reason) for reason in HONEST),
    }


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(5))
def test_of_many_hundred_goals_none_gets_stuck(seed: int) -> None:
    ends = visit(seed=100 + seed, count=200, lever=False)
    assert {state for state, _ in ends} <= {GoalState.SUCCEEDED, GoalState.REFUSED}
    assert ends[GoalState.SUCCEEDED, Reason.NONE] >= 150
