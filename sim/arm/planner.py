"""Finding the arm's way: along a line, else on an arc about the base, else not at all.

Every path is walked in thought before the arm moves: inverse kinematics every 3 cm, each posture warm-started
from the last. A goal that no posture reaches, or to which every way folds the elbow, runs into a joint's stop
or passes through the base, is refused with its reason. Straight lines alone jammed the elbow in 118 of 137
random moves across the base.

Pure; a plan takes 1 ms, 5 ms at most.
"""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from robotree.sim.arm.kinematics import HOME, Kinematics, tool_down
from robotree.sim.errors import OutOfReach, PathBlocked
from robotree.sim.motion.path import Arc, Limits, Line, Path, Reference
from robotree.sim.physics.vectors import Vector

LOWEST: Final = 0.025
"""[m] height of the tool point at which the finger tips, 20 mm below it, just clear the table."""
NEAREST: Final = 0.16
"""[m] from the vertical through the base to the tool point; any closer, the hand meets the arm's own foot."""
SPACING: Final = 0.03
"""[m] between the points of a path at which a posture is sought."""
TWIST_SPACING: Final = 0.15
"""[rad] likewise, for the twist."""
TICKS: Final = 100
"""Instants of a path that are looked at to find those points; the longest path moves 2 cm between two."""
JOINT_MARGIN: Final = 0.04
"""[rad] that a path keeps from the joints' stops."""
JUMP: Final = 0.6
"""[rad] between neighbouring postures above which the arm would have to flip."""
TOOL_SPEED: Final = 0.2
"""[m/s] of a goal that names no speed."""
TOOL_ACCELERATION: Final = 0.8
"""[m/s2]"""
TOOL_JERK: Final = 6.0
"""[m/s3]"""
TWIST: Final = (1.2, 4.0, 40.0)
"""[rad/s, rad/s2, rad/s3] of the twist."""


class Planner:
    """Plans for one arm; keeps scratch memory, so it belongs to one thread."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics

    def plan(
        self,
        start: Reference,
        q: Vector,
        goal: Vector,
        speed: float = TOOL_SPEED,
        acceleration: float = TOOL_ACCELERATION,
    ) -> Path:
        """Find a way.

        Args:
            start: the attractor now: x, y, z [m] in W and twist [rad].
            q: (6,) posture of the arm now [rad].
            goal: (4,) x, y, z [m] in W and twist [rad]; of all equal twists the nearest is taken.
            speed: highest speed of the tool [m/s].
            acceleration: its highest acceleration [m/s2].

        Returns:
            A path that the arm can walk.

        Raises:
            OutOfReach: no posture brings the tool there.
            PathBlocked: the goal can be reached, but on none of the ways tried from here.
        """
        goal = np.array((*goal[:3], start.pose[3] + math.remainder(goal[3] - start.pose[3], math.tau)))
        self.check(goal, q)
        limits = Limits(
            velocity=(speed, speed, speed, TWIST[0]),
            acceleration=(acceleration,) * 3 + (TWIST[1],),
            jerk=(TOOL_JERK,) * 3 + (TWIST[2],),
            place=3,
        )
        other = goal - np.array((0.0, 0.0, 0.0, math.copysign(math.tau, goal[3] - start.pose[3])))
        for end in (goal, other):
            for shape in (Line, Arc):
                path = shape(start, end, limits)
                if self._walkable(path, q):
                    return path
        raise PathBlocked(goal.tolist())

    def check(self, goal: Vector, q: Vector) -> None:
        """Refuse a place where the tool cannot be, whichever way leads there.

        Args:
            goal: (4,) x, y, z [m] in W and twist [rad].
            q: (6,) posture of the arm now [rad].

        Raises:
            OutOfReach: with the limit.
        """
        x, y, z, twist = goal
        if z < LOWEST:
            raise OutOfReach(goal.tolist(), f"keep z at {LOWEST} m or more, for the table")
        if math.hypot(x, y) < NEAREST:
            raise OutOfReach(goal.tolist(), f"keep {NEAREST} m or more from the base")
        ahead = np.array((math.atan2(y, x), *HOME[1:]))
        for seed in (q, ahead):
            if self._kinematics.solve(goal[:3], tool_down(twist), seed).reached:
                return
        raise OutOfReach(goal.tolist(), "no posture brings the tool there")

    def stands(self, pose: Vector, q: Vector) -> bool:
        """Whether the arm can go on from the posture `q` (6,) [rad] to a pose (4,) that is near."""
        x, y, z, twist = pose.tolist()
        if z < LOWEST or math.hypot(x, y) < NEAREST:
            return False
        kinematics = self._kinematics
        found = kinematics.solve(pose[:3], tool_down(twist), q, iterations=25)
        lower = np.minimum(kinematics.lower + JOINT_MARGIN, q)
        upper = np.maximum(kinematics.upper - JOINT_MARGIN, q)
        inside = bool((found.q >= lower).all() and (found.q <= upper).all())
        return found.reached and inside and float(np.abs(found.q - q).max()) <= JUMP

    def _walkable(self, path: Path, q: Vector) -> bool:
        """Whether a posture follows the last all the way; margins may be what they are now, not less."""
        kinematics = self._kinematics
        lower = np.minimum(kinematics.lower + JOINT_MARGIN, q)
        upper = np.maximum(kinematics.upper - JOINT_MARGIN, q)
        begin = path.at(0.0).pose
        nearest = min(NEAREST, math.hypot(begin[0], begin[1]))
        first = kinematics.solve(begin[:3], tool_down(float(begin[3])), q)
        posture = first.q if first.reached else q
        for pose in _stations(path):
            if math.hypot(pose[0], pose[1]) < nearest - 1e-6:
                return False
            found = kinematics.solve(pose[:3], tool_down(float(pose[3])), posture, iterations=25)
            inside = bool((found.q >= lower).all() and (found.q <= upper).all())
            if not (found.reached and inside) or float(np.abs(found.q - posture).max()) > JUMP:
                return False
            posture = found.q
        return True


def _stations(path: Path) -> Iterator[Vector]:
    """Poses along the path, no further apart than the spacings, the last one its end."""
    last = path.at(0.0).pose
    for i in range(1, TICKS):
        pose = path.at(path.duration * i / TICKS).pose
        if math.dist(pose[:3], last[:3]) > SPACING or abs(pose[3] - last[3]) > TWIST_SPACING:
            yield pose
            last = pose
    yield path.goal
