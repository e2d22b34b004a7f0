"""Jerk-limited paths (ruckig, Berscheid and Kroeger 2021): a line, and an arc about the arm's base.

From rest a path is straight in its own coordinates: one share of the way is moved, not each axis by itself,
which would bend a 0.37 m move by 5 mm (ruckig's phase synchronisation falls back to that in a percent of all
moves).

Pure: positions and seconds in, references out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

import numpy as np
import ruckig

from robotree.sim.physics.vectors import Vector

_NOWHERE: Final = 1e-9
"""[m, rad] that an axis may move without limiting the others."""


class Reference(NamedTuple):
    """Where something should be and how fast it should move: `pose` and `velocity`, one entry per axis."""

    pose: Vector
    velocity: Vector


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of a path, one entry per axis, in the axis' unit per s, s2 and s3."""

    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]


class Path(Protocol):
    """A way to `goal` that takes `duration` [s] when nothing is in the way."""

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        ...

    @property
    def goal(self) -> Vector:
        """Where it ends."""
        ...

    def at(self, time: float) -> Reference:
        """The reference `time` [s] after the start."""
        ...


class Line:
    """A jerk-limited path, straight in its own coordinates when it starts from rest.

    From rest one number, the share of the way, is moved under the tightest of the limits. From a motion,
    which may lead elsewhere, the axes are moved together, each under its own.

    Args:
        start: where it starts and how fast; a start in motion is continued without a jump in velocity.
        goal: where it ends, at rest.
        limits: what it may not exceed.
    """

    def __init__(self, start: Reference, goal: Vector, limits: Limits) -> None:
        self._start, self._goal, self._way = start.pose, goal, goal - start.pose
        self._straight = not start.velocity.any()
        if self._straight:
            origin, speed, target = [0.0], [0.0], [1.0]
            shares = map(self._tightest, (limits.velocity, limits.acceleration, limits.jerk))
            bounds = Limits(*shares)
        else:
            origin, speed, target = start.pose.tolist(), start.velocity.tolist(), goal.tolist()
            bounds = limits
        self._trajectory = _trajectory(origin, speed, target, bounds)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self._trajectory.duration

    @property
    def goal(self) -> Vector:
        """Where it ends."""
        return self._goal

    def at(self, time: float) -> Reference:
        """The reference `time` [s] after the start."""
        place, speed, _ = self._trajectory.at_time(time)
        if self._straight:
            return Reference(self._start + place[0] * self._way, speed[0] * self._way)
        return Reference(np.array(place), np.array(speed))

    def _tightest(self, limits: Sequence[float]) -> tuple[float]:
        """The bound on the share of the way, from those of the axes."""
        shares = [
            limit / abs(way)
            for limit, way in zip(limits, self._way.tolist(), strict=True)
            if abs(way) > _NOWHERE
        ]
        return (min(shares, default=1.0),)


def _trajectory(
    origin: list[float], speed: list[float], target: list[float], limits: Limits
) -> ruckig.Trajectory:
    axes = len(target)
    wish = ruckig.InputParameter(axes)
    wish.current_position, wish.current_velocity, wish.target_position = origin, speed, target
    wish.max_velocity, wish.max_acceleration = list(limits.velocity), list(limits.acceleration)
    wish.max_jerk = list(limits.jerk)
    trajectory = ruckig.Trajectory(axes)
    ruckig.Ruckig(axes).calculate(wish, trajectory)
    return trajectory


class Arc:
    """A path about the arm's base: straight in (radius, azimuth, height, twist) instead of (x, y, z, twist).

    It leads around the base where a straight line would fold the elbow.
    """

    def __init__(self, start: Reference, goal: Vector, limits: Limits) -> None:
        x, y, z, twist = start.pose
        vx, vy, vz, spin = start.velocity
        radius = max(math.hypot(x, y), 1e-6)
        begin = Reference(
            np.array((radius, math.atan2(y, x), z, twist)),
            np.array(((x * vx + y * vy) / radius, (x * vy - y * vx) / radius**2, vz, spin)),
        )
        end = np.array((math.hypot(goal[0], goal[1]), math.atan2(goal[1], goal[0]), goal[2], goal[3]))
        widest = max(radius, float(end[0]))
        self._line = Line(
            begin,
            end,
            Limits(
                _azimuth(limits.velocity, widest),
                _azimuth(limits.acceleration, widest),
                _azimuth(limits.jerk, widest),
            ),
        )
        self._goal = goal

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self._line.duration

    @property
    def goal(self) -> Vector:
        """Where it ends."""
        return self._goal

    def at(self, time: float) -> Reference:
        """The reference `time` [s] after the start."""
        (radius, azimuth, z, twist), (outward, turning, vz, spin) = self._line.at(time)
        c, s = math.cos(azimuth), math.sin(azimuth)
        along = radius * turning
        return Reference(
            np.array((radius * c, radius * s, z, twist)),
            np.array((outward * c - along * s, outward * s + along * c, vz, spin)),
        )


def _azimuth(limits: Sequence[float], radius: float) -> tuple[float, ...]:
    """Bounds in cylindrical coordinates from bounds in Cartesian ones, true at `radius` [m]."""
    return (limits[0], limits[1] / radius, *limits[2:])
