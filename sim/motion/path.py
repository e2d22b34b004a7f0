"""Jerk-limited paths (ruckig, Berscheid and Kroeger 2021): a line, and an arc about the arm's base.

From rest a path is straight in its own coordinates: one share of the way is moved, not each axis by itself,
which would bend a 0.37 m move by 5 mm (ruckig's phase synchronisation falls back to that in a percent of all
moves).

From a motion the old velocity is braked while the new way, from where that braking ends, begins: the blend
of two segments that fly-by moves have (Taylor, "Planning and execution of straight line manipulator
trajectories", IBM J. Res. Dev. 1979). Both speeds change by the same S-curve, so their sum is never faster
than the faster of the two, and along one line it is steady.

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
    """Bounds of a path, one entry per axis, in the axis' unit per s, s2 and s3.

    Attributes:
        velocity: of each axis.
        acceleration: of each axis.
        jerk: of each axis.
        place: how many of the axes, the first ones, are one place: their bounds hold for the length of its
            velocity, not for each axis, else a tool would be 1.7 times as fast along a diagonal.
    """

    velocity: tuple[float, ...]
    acceleration: tuple[float, ...]
    jerk: tuple[float, ...]
    place: int = 1

    def shares(self, way: Vector) -> "Limits":
        """The bounds of one number that moves all axes along `way` (n,), from 0 to 1."""
        speed, acceleration, jerk = (
            self._share(way, np.array(each)) for each in (self.velocity, self.acceleration, self.jerk)
        )
        return Limits((speed,), (acceleration,), (jerk,))

    def times(self, factor: float) -> "Limits":
        """The same speeds, with accelerations and jerks that are `factor` times as large."""
        acceleration, jerk = (tuple(factor * x for x in each) for each in (self.acceleration, self.jerk))
        return Limits(self.velocity, acceleration, jerk, self.place)

    def _share(self, way: Vector, bounds: Vector) -> float:
        loads = np.where(np.abs(way) > _NOWHERE, np.abs(way) / bounds, 0.0)
        most = max(math.hypot(*loads[: self.place].tolist()), *loads[self.place :].tolist(), 0.0)
        return 1.0 / most if most > 0.0 else 1.0


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

    One number, the share of the way, is moved under the tightest of the limits. From a motion, which may
    lead elsewhere, the way begins where braking ends, and both go on at the same time.

    Args:
        start: where it starts and how fast; a start in motion is continued without a jump in velocity.
        goal: where it ends, at rest.
        limits: what it may not exceed.
    """

    def __init__(self, start: Reference, goal: Vector, limits: Limits) -> None:
        self._goal, self._brakes = goal, list[_Brake]()
        begin, kept, factor = start.pose, limits, 1.0
        while start.velocity.any():
            limits = kept.times(factor)
            self._brakes = _brakes(start.velocity, limits)
            begin = sum((each.way for each in self._brakes), start.pose)
            fits = _shared(start.velocity[: limits.place], (goal - begin)[: limits.place])
            if factor <= 1.01 * fits:
                break
            factor = fits  # the longer it brakes, the more the way from there leads back: down to a half
        self._start, self._way, self._first = begin, goal - begin, start.pose - begin
        shares = limits.shares(self._way)
        wish = ruckig.InputParameter(1)
        wish.target_position, wish.max_velocity = [1.0], list(shares.velocity)
        self._walk = _trajectory(wish, shares)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return max(self._walk.duration, *(each.duration for each in self._brakes), 0.0)

    @property
    def goal(self) -> Vector:
        """Where it ends."""
        return self._goal

    def at(self, time: float) -> Reference:
        """The reference `time` [s] after the start."""
        (share,), (speed,), _ = self._walk.at_time(time)
        way = Reference(self._start + share * self._way, speed * self._way)
        return _braked(way, self._first, self._brakes, time) if self._brakes else way


class _Brake:
    """A velocity that is brought to zero, as one number, in some of the axes.

    Args:
        velocity: (n,) of all axes.
        axes: that it brakes.
        limits: of all axes.
    """

    def __init__(self, velocity: Vector, axes: slice, limits: Limits) -> None:
        self._velocity: Vector = np.zeros(len(velocity))
        self._velocity[axes] = velocity[axes]
        wish = ruckig.InputParameter(1)
        wish.control_interface = ruckig.ControlInterface.Velocity
        wish.current_velocity = [1.0]
        self._share = _trajectory(wish, limits.shares(self._velocity))
        self.duration: float = self._share.duration
        """[s]"""
        self.way: Vector = self.at(self.duration)[0]
        """(n,) how far it goes."""

    def at(self, time: float) -> tuple[Vector, Vector]:
        """How far it has gone (n,), and how fast it still is (n,), `time` [s] after its start."""
        (place,), (share,), _ = self._share.at_time(min(time, self.duration))
        return place * self._velocity, share * self._velocity


def _brakes(velocity: Vector, limits: Limits) -> list[_Brake]:
    """What brings a velocity (n,) to zero: the place as one, and each other axis by itself."""
    axes = [slice(0, limits.place), *(slice(i, i + 1) for i in range(limits.place, len(velocity)))]
    return [_Brake(velocity, each, limits) for each in axes if velocity[each].any()]


def _braked(way: Reference, first: Vector, brakes: Sequence[_Brake], time: float) -> Reference:
    """The sum of the new way and what is left of the old velocity.

    Args:
        way: where the new one is, and how fast.
        first: (n,) from where the new one begins to where the braking does.
        brakes: of the old velocity.
        time: [s] after the start of both.
    """
    pose, velocity = way.pose + first, way.velocity
    for each in brakes:
        moved, rate = each.at(time)
        pose, velocity = pose + moved, velocity + rate
    return Reference(pose, velocity)


def _shared(velocity: Vector, way: Vector) -> float:
    """The share of the acceleration that braking and beginning may each have; at a turn back both add up."""
    speed, length = float(np.linalg.norm(velocity)), float(np.linalg.norm(way))
    if min(speed, length) < _NOWHERE:
        return 1.0
    return 1.0 / max(float(np.linalg.norm(way / length - velocity / speed)), 1.0)


def _trajectory(wish: ruckig.InputParameter, limits: Limits) -> ruckig.Trajectory:
    """The trajectory of one number."""
    wish.max_acceleration, wish.max_jerk = list(limits.acceleration), list(limits.jerk)
    trajectory = ruckig.Trajectory(1)
    ruckig.Ruckig(1).calculate(wish, trajectory)
    return trajectory


class Arc:
    """A path about the arm's base: straight in (radius, azimuth, height, twist) instead of (x, y, z, twist).

    It leads around the base where a straight line would fold the elbow. From a motion the old velocity is
    braked along its straight line, and the arc begins where that ends: kept as a turn about the base, the
    tool would grow faster with its radius.
    """

    def __init__(self, start: Reference, goal: Vector, limits: Limits) -> None:
        self._brakes = list[_Brake]()
        if start.velocity.any():
            limits = limits.times(0.5)  # for each of both: the arc turns, so they may add up
            self._brakes = _brakes(start.velocity, limits)
        x, y, z, twist = sum((each.way for each in self._brakes), start.pose)
        self._first = start.pose - np.array((x, y, z, twist))
        radius = max(math.hypot(x, y), 1e-6)
        begin = Reference(np.array((radius, math.atan2(y, x), z, twist)), np.zeros(4))
        end = np.array((math.hypot(goal[0], goal[1]), math.atan2(goal[1], goal[0]), goal[2], goal[3]))
        widest = max(radius, float(end[0]))
        self._line = Line(
            begin,
            end,
            Limits(
                _azimuth(limits.velocity, widest),
                _azimuth(limits.acceleration, widest),
                _azimuth(limits.jerk, widest),
                limits.place,
            ),
        )
        self._goal = goal

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return max(self._line.duration, *(each.duration for each in self._brakes), 0.0)

    @property
    def goal(self) -> Vector:
        """Where it ends."""
        return self._goal

    def at(self, time: float) -> Reference:
        """The reference `time` [s] after the start."""
        (radius, azimuth, z, twist), (outward, turning, vz, spin) = self._line.at(time)
        c, s = math.cos(azimuth), math.sin(azimuth)
        along = radius * turning
        way = Reference(
            np.array((radius * c, radius * s, z, twist)),
            np.array((outward * c - along * s, outward * s + along * c, vz, spin)),
        )
        return _braked(way, self._first, self._brakes, time) if self._brakes else way


def _azimuth(limits: Sequence[float], radius: float) -> tuple[float, ...]:
    """Bounds in cylindrical coordinates from bounds in Cartesian ones, true at `radius` [m]."""
    return (limits[0], limits[1] / radius, *limits[2:])
