"""Pinocchio computes what MuJoCo simulates; paths keep their limits, and what cannot be walked is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from robotree.sim.arm import model as arm
from robotree.sim.arm.kinematics import HOME, ROLL, Kinematics, tool_down, twist_of
from robotree.sim.arm.planner import JOINT_MARGIN, NEAREST, Planner
from robotree.sim.errors import GoalRefused, OutOfReach, PathBlocked
from robotree.sim.motion.follower import BLOCKED_AFTER, Follower
from robotree.sim.motion.path import Arc, Limits, Line, Path, Reference
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


PLANNER = Planner(KINEMATICS)


def posture(*pose: float) -> Vector:
    ahead = np.array((math.atan2(pose[1], pose[0]), *HOME[1:]))
    found = KINEMATICS.solve(np.array(pose[:3]), tool_down(pose[3]), ahead)
    assert found.reached
    return found.q


def plan(start: tuple[float, ...], goal: tuple[float, ...]) -> Path:
    return PLANNER.plan(Reference(np.array(start), np.zeros(4)), posture(*start), np.array(goal))


def test_where_nothing_is_in_the_way_the_path_is_a_line() -> None:
    assert isinstance(plan((0.4, -0.1, 0.3, 0.0), (0.3, 0.3, 0.2, 0.5)), Line)


def test_across_the_base_the_path_is_an_arc_around_it() -> None:
    path = plan((0.3, -0.3, 0.2, 0.0), (-0.3, 0.3, 0.2, 0.0))
    assert isinstance(path, Arc)
    for part in np.linspace(0.0, path.duration, 100):
        assert math.hypot(*path.at(part).pose[:2]) > NEAREST


@pytest.mark.parametrize(
    ("goal", "why"),
    [
        ((0.9, 0.0, 0.2, 0.0), "no posture"),
        ((0.3, 0.0, 0.9, 0.0), "no posture"),
        ((0.4, 0.0, -0.05, 0.0), "table"),
        ((0.4, 0.0, 0.01, 0.0), "table"),
        ((0.05, 0.05, 0.3, 0.0), "base"),
    ],
)
def test_out_of_reach_is_refused_with_the_reason(goal: tuple[float, ...], why: str) -> None:
    with pytest.raises(OutOfReach, match=why):
        plan((0.4, 0.0, 0.3, 0.0), goal)


@pytest.mark.parametrize(
    ("goal", "elbow"), [((0.161, 0.0, 0.17, 0.0), "folded"), ((0.6455, 0.0, 0.2, 0.0), "stretched")]
)
def test_a_posture_with_the_elbow_at_its_stop_is_refused(goal: tuple[float, ...], elbow: str) -> None:
    assert posture(*goal)[2] == pytest.approx(2.7 if elbow == "folded" else 0.2, abs=JOINT_MARGIN)
    with pytest.raises(PathBlocked, match="go by another point"):
        plan((0.4, 0.0, 0.3, 0.0), goal)


@pytest.mark.parametrize(
    "refusal",
    [OutOfReach((-0.123456,) * 3, "no posture brings the tool there"), PathBlocked((-0.123456,) * 3)],
)
def test_a_refusal_fits_the_text_of_a_status(refusal: GoalRefused) -> None:
    assert len(str(refusal)) <= 80


def test_an_arm_that_was_pushed_to_a_stop_can_leave_it() -> None:
    start = np.array((0.6455, 0.0, 0.2, 0.0))
    path = PLANNER.plan(Reference(start, np.zeros(4)), posture(*start), np.array((0.4, 0.1, 0.3, 0.0)))
    assert path.duration > 0.0


def test_of_equal_twists_the_nearest_is_taken() -> None:
    path = plan((0.4, 0.0, 0.3, 3.0), (0.4, 0.1, 0.3, -3.0))
    assert path.goal[3] == pytest.approx(2 * math.pi - 3.0)


def test_a_planned_path_keeps_away_from_the_stops() -> None:
    path = plan((0.3, -0.3, 0.2, 0.0), (-0.3, 0.3, 0.2, 0.0))
    q = posture(0.3, -0.3, 0.2, 0.0)
    for part in np.linspace(0.0, path.duration, 60):
        pose = path.at(part).pose
        found = KINEMATICS.solve(pose[:3], tool_down(float(pose[3])), q)
        assert found.reached
        assert (found.q >= KINEMATICS.lower + JOINT_MARGIN - 0.02).all()
        assert (found.q <= KINEMATICS.upper - JOINT_MARGIN + 0.02).all()
        q = found.q


LIMITS = Limits((0.2, 0.2, 0.2, 1.2), (0.8, 0.8, 0.8, 4.0), (6.0, 6.0, 6.0, 40.0), place=3)
DT = 0.001


def poses() -> st.SearchStrategy[Vector]:
    """Around the base, not closer than 0.2 m."""

    def place(radius: float, azimuth: float, z: float, twist: float) -> Vector:
        return np.array((radius * math.cos(azimuth), radius * math.sin(azimuth), z, twist))

    return st.builds(place, st.floats(0.2, 0.6), st.floats(-3, 3), st.floats(0.05, 0.5), st.floats(-3, 3))


def velocities() -> st.SearchStrategy[Vector]:
    return st.tuples(*[st.floats(-0.15, 0.15)] * 3, st.floats(-1, 1)).map(np.array)


def at_rest(pose: Vector) -> Reference:
    return Reference(pose, np.zeros(4))


def samples(path: Path, count: int = 200) -> list[Reference]:
    return [path.at(path.duration * i / count) for i in range(count + 1)]


@pytest.mark.parametrize("shape", [Line, Arc])
@given(start=poses(), goal=poses(), velocity=velocities())
def test_a_path_leads_from_the_start_as_it_moves_to_the_goal_at_rest(
    shape: type[Line | Arc], start: Vector, goal: Vector, velocity: Vector
) -> None:
    path = shape(Reference(start, velocity), goal, LIMITS)
    begin, end = path.at(0.0), path.at(path.duration)
    np.testing.assert_allclose(begin.pose, start, atol=1e-9)
    np.testing.assert_allclose(begin.velocity, velocity, atol=1e-9)
    np.testing.assert_allclose(end.pose, goal, atol=1e-6)
    np.testing.assert_allclose(end.velocity, 0.0, atol=1e-6)


@pytest.mark.parametrize("shape", [Line, Arc])
@given(start=poses(), goal=poses())
def test_the_velocity_is_the_pose_differentiated(
    shape: type[Line | Arc], start: Vector, goal: Vector
) -> None:
    path = shape(at_rest(start), goal, LIMITS)
    assume(path.duration > 0.1)
    h = 1e-5
    for time in np.linspace(h, path.duration - h, 9):
        slope = (path.at(time + h).pose - path.at(time - h).pose) / (2 * h)
        np.testing.assert_allclose(path.at(time).velocity, slope, atol=1e-3)


@given(start=poses(), goal=poses())
def test_a_line_from_rest_is_straight_and_keeps_its_speed(start: Vector, goal: Vector) -> None:
    path = Line(at_rest(start), goal, LIMITS)
    chord = goal - start
    for setpoint in samples(path):
        along = (setpoint.pose - start) @ chord / max(float(chord @ chord), 1e-12)
        np.testing.assert_allclose(setpoint.pose, start + along * chord, atol=1e-9)
        assert (np.abs(setpoint.velocity) <= np.array(LIMITS.velocity) + 1e-6).all()


@pytest.mark.parametrize("shape", [Line, Arc])
@given(start=poses(), goal=poses(), velocity=velocities() | st.just(np.zeros(4)))
def test_the_tool_is_never_faster_than_its_limit_or_its_start(
    shape: type[Line | Arc], start: Vector, goal: Vector, velocity: Vector
) -> None:
    path = shape(Reference(start, velocity), goal, LIMITS)
    fastest = max(LIMITS.velocity[0], float(np.linalg.norm(velocity[:3])))
    turning = max(LIMITS.velocity[3], abs(float(velocity[3])))
    for setpoint in samples(path):
        assert np.linalg.norm(setpoint.velocity[:3]) <= fastest + 1e-6
        assert abs(float(setpoint.velocity[3])) <= turning + 1e-6


@given(start=poses(), goal=poses(), velocity=velocities())
def test_a_change_of_direction_keeps_the_acceleration(start: Vector, goal: Vector, velocity: Vector) -> None:
    path, step = Line(Reference(start, velocity), goal, LIMITS), 0.002
    for time in np.linspace(0.0, max(path.duration - step, 0.0), 200):
        change = (path.at(time + step).velocity - path.at(time).velocity) / step
        assert np.linalg.norm(change[:3]) <= LIMITS.acceleration[0] * 1.02 + 1e-6


def test_a_new_goal_straight_ahead_changes_no_speed() -> None:
    start = Reference(np.array((0.3, 0.0, 0.3, 0.0)), np.array((0.2, 0.0, 0.0, 0.0)))
    path = Line(start, np.array((0.6, 0.0, 0.3, 0.0)), LIMITS)
    for setpoint in samples(path)[:100]:
        assert setpoint.velocity[0] == pytest.approx(0.2, abs=1e-6)


@given(start=poses(), goal=poses())
def test_an_arc_never_comes_closer_to_the_base_than_its_ends(start: Vector, goal: Vector) -> None:
    nearest = min(math.hypot(*start[:2]), math.hypot(*goal[:2]))
    for setpoint in samples(Arc(at_rest(start), goal, LIMITS)):
        assert math.hypot(*setpoint.pose[:2]) >= nearest - 1e-6


def test_a_slack_leash_changes_nothing() -> None:
    path = Line(at_rest(np.array((0.3, 0.0, 0.3, 0.0))), np.array((0.3, 0.2, 0.3, 0.5)), LIMITS)
    follower = Follower(path.at(0.0).pose)
    follower.follow(path)
    steps = 0
    while follower.moving:
        follower.advance(DT, load=0.5)
        steps += 1
    assert steps * DT == pytest.approx(path.duration, abs=2 * DT)
    np.testing.assert_allclose(follower.reference.pose, path.goal)


def test_a_taut_leash_stands_still_and_after_a_while_counts_as_blocked() -> None:
    path = Line(at_rest(np.array((0.3, 0.0, 0.3, 0.0))), np.array((0.3, 0.2, 0.3, 0.0)), LIMITS)
    follower = Follower(path.at(0.0).pose)
    follower.follow(path)
    for _ in range(300):
        follower.advance(DT, load=0.0)
    before = follower.reference.pose.copy()
    for _ in range(round(BLOCKED_AFTER / DT) - 1):
        setpoint = follower.advance(DT, load=1.2)
    np.testing.assert_allclose(setpoint.pose, before, atol=1e-12)
    np.testing.assert_allclose(setpoint.velocity, 0.0)
    assert not follower.blocked
    follower.advance(DT, load=1.2)
    follower.advance(DT, load=1.2)
    assert follower.blocked


@given(loads=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=400))
def test_however_the_leash_is_pulled_the_set_point_never_jumps(loads: list[float]) -> None:
    path = Line(at_rest(np.array((0.3, 0.0, 0.3, 0.0))), np.array((0.3, 0.2, 0.4, 1.0)), LIMITS)
    follower = Follower(path.at(0.0).pose)
    follower.follow(path)
    last, progress = follower.reference.pose, follower.progress
    for load in loads:
        setpoint = follower.advance(DT, load)
        assert (np.abs(setpoint.pose - last) <= np.array(LIMITS.velocity) * DT + 1e-9).all()
        assert follower.progress >= progress
        last, progress = setpoint.pose, follower.progress


@given(start=poses(), goal=poses(), other=poses(), when=st.floats(0.05, 0.95))
def test_a_new_path_continues_the_motion_of_the_old(
    start: Vector, goal: Vector, other: Vector, when: float
) -> None:
    path = Line(at_rest(start), goal, LIMITS)
    assume(path.duration > 0.2)
    follower = Follower(start)
    follower.follow(path)
    for _ in range(int(when * path.duration / DT)):
        follower.advance(DT, load=0.0)
    before = follower.reference
    follower.follow(Line(before, other, LIMITS))
    after = follower.advance(DT, load=0.0)
    assert (
        np.abs(after.velocity - before.velocity) <= np.array(LIMITS.acceleration) * DT * 1.01 + 1e-6
    ).all()
