"""What cannot be walked is refused with its reason, before anything moves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from robotree.sim.arm.kinematics import HOME, Kinematics, tool_down
from robotree.sim.arm.planner import JOINT_MARGIN, NEAREST, Planner
from robotree.sim.errors import GoalRefused, OutOfReach, PathBlocked
from robotree.sim.motion.path import Arc, Line, Path, Reference
from robotree.sim.physics.vectors import Vector

KINEMATICS = Kinematics()
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
