"""Ways of an arm: a chain of postures that is walked smoothly under one speed. Pure.

Between postures the joints follow a Catmull-Rom spline (Catmull and Rom, "A class of local interpolating
splines", 1974) over the length of the way, and one number, the length walked, is moved under a limit of
speed, acceleration and jerk. The length of a piece is the larger of what the hand moves and of what the
joints turn times `LEVER`, so that neither a hand nor an elbow is quicker than the speed asked for.
"""

from typing import Final

import numpy as np

from robotree.sim.motion.path import Limits, Line, Reference
from robotree.sim.physics.vectors import Matrix, Vector

LEVER: Final = 0.2
"""[m] of hand's way that a radian of a joint counts for."""
JERK: Final = 12.0
"""[m/s3]"""


class Way:
    """A chain of postures.

    Args:
        postures: (n, 6) from where the arm is to where it goes [rad].
        hands: (n, 3) where the hand is at each [m].
        speed: of the hand, at most [m/s].
        acceleration: [m/s2].
    """

    def __init__(self, postures: Matrix, hands: Matrix, speed: float, acceleration: float) -> None:
        self._postures, self.speed = postures, speed
        moved = np.linalg.norm(np.diff(hands, axis=0), axis=1)
        turned = LEVER * np.abs(np.diff(postures, axis=0)).max(axis=1)
        steps = np.maximum(np.maximum(moved, turned), 1e-6)
        self._at = np.concatenate(((0.0,), np.cumsum(steps)))
        slopes = np.zeros_like(postures)
        if len(postures) > 2:
            span = (self._at[2:] - self._at[:-2])[:, None]
            slopes[1:-1] = (postures[2:] - postures[:-2]) / span
        slopes[0] = (postures[1] - postures[0]) / steps[0]
        slopes[-1] = (postures[-1] - postures[-2]) / steps[-1]
        self._slopes = slopes
        self.length = float(self._at[-1])
        start = Reference(np.zeros(1), np.zeros(1))
        limits = Limits((speed,), (acceleration,), (JERK,))
        self._walk = Line(start, np.array((self.length,)), limits)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self._walk.duration

    @property
    def goal(self) -> Vector:
        """(6,) where it ends [rad]."""
        end: Vector = self._postures[-1]
        return end

    def at(self, time: float) -> Reference:
        """Joints and their velocities `time` [s] after the start."""
        place, speed = self._walk.at(time)
        return self._here(float(place[0]), float(speed[0]))

    def ahead(self, time: float) -> Vector:
        """(6,) joints `time` [s] after the start, or at the end."""
        return self.goal if time >= self.duration else self.at(max(time, 0.0)).pose

    def _here(self, s: float, speed: float) -> Reference:
        i = int(np.searchsorted(self._at, s, side="right")) - 1
        i = min(max(i, 0), len(self._at) - 2)
        h = float(self._at[i + 1] - self._at[i])
        u = min(max((s - float(self._at[i])) / h, 0.0), 1.0)
        a, b = self._postures[i], self._postures[i + 1]
        m, n = h * self._slopes[i], h * self._slopes[i + 1]
        u2, u3 = u * u, u * u * u
        pose = (2 * u3 - 3 * u2 + 1) * a + (u3 - 2 * u2 + u) * m + (3 * u2 - 2 * u3) * b + (u3 - u2) * n
        rate = (6 * u2 - 6 * u) * (a - b) + (3 * u2 - 4 * u + 1) * m + (3 * u2 - 2 * u) * n
        return Reference(pose, rate * (speed / h))
