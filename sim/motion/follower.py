"""Following a path, or set-points that may come at any moment and say anything; the attractor is on a leash.

The leash stretches a path's time: as the spring between tool and attractor fills from 60 % to 100 % of its
limit, the path slows from full speed to a stop, so an arm that is blocked or pushed away resumes where it is
instead of jumping after a reference that has run ahead. The attractor's velocity is scaled likewise (unscaled
it would add its damping force, 28 N instead of 15 N at the table).

Set-points are pursued smoothly, and never out of the limits. Each group of axes (the tool's place, its twist)
has a speed and an acceleration that it does not exceed. A target is approached at a speed from which it can
still be braked, v = sqrt(2 a (d - a / 2 g^2)), and nearer than a / g^2 at v = g d, where that braking curve
and the straight line have the same slope. Every `LOOK` the place where braking would end, and `MARGIN` beyond
it, is looked at; when nothing can stand there, the pursuit brakes, so that the limits hold whatever is asked
for.

Pure: targets, seconds and loads in, references out.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from robotree.sim.motion.path import Path, Reference
from robotree.sim.physics.vectors import Vector

GAIN: Final = 8.0
"""[1/s] of the approach near its end: g."""
LOOK: Final = 0.01
"""[s] between two looks ahead."""
MARGIN: Final = 0.01
"""[m, rad] beyond the place where braking ends that must be free, too."""
_STILL: Final = 1e-9


class Group(NamedTuple):
    """Axes that share a speed and an acceleration, in their unit per s and s2."""

    axes: slice
    speed: float
    acceleration: float


class Pursuit:
    """Leads an attractor after targets.

    Args:
        start: where it is and how fast; carried on without a jump.
        groups: of axes, with their limits; together all axes.
        stands: whether the robot can be at a pose.
    """

    def __init__(self, start: Reference, groups: Sequence[Group], stands: Callable[[Vector], bool]) -> None:
        self._pose, self._velocity = np.array(start.pose), np.array(start.velocity)
        self._groups, self._stands = tuple(groups), stands
        self._target: Vector | None = None
        self._rate: Vector = np.zeros(len(start.pose))
        self._clear = False
        self._look_in = 0.0

    @property
    def rate(self) -> Vector:
        """(n,) the velocity that is wanted, where no place is."""
        return self._rate

    def limit(self, groups: Sequence[Group]) -> None:
        """Obey other limits from now on."""
        self._groups = tuple(groups)

    def toward(self, target: Vector) -> None:
        """Go to a place (n,) and stay."""
        self._target, self._look_in = np.array(target), 0.0

    def along(self, rate: Vector) -> None:
        """Go on with a velocity (n,); more than the limits is scaled down, the direction kept."""
        self._target, self._rate, self._look_in = None, np.array(rate), 0.0

    def advance(self, dt: float, pace: float) -> Reference:
        """Lead on for `dt` [s].

        Args:
            dt: control period [s].
            pace: share of the full pace, for the leash.

        Returns:
            The reference for this period.
        """
        wanted = self._wanted()
        self._look_in -= dt
        if self._look_in <= 0.0:
            self._look_in = LOOK
            self._clear = self._stands(self._ahead(wanted))
        if not self._clear:
            wanted = np.zeros(len(wanted))
        for axes, _, acceleration in self._groups:
            change = wanted[axes] - self._velocity[axes]
            size, most = math.hypot(*change.tolist()), acceleration * dt
            self._velocity[axes] += change if size <= most else change * (most / size)
        velocity = self._velocity * pace
        self._pose = self._pose + velocity * dt
        return Reference(self._pose, velocity)

    def _wanted(self) -> Vector:
        wanted = np.array(self._rate if self._target is None else self._target - self._pose)
        for axes, speed, acceleration in self._groups:
            size = math.hypot(*wanted[axes].tolist())
            if size < _STILL:
                wanted[axes] = 0.0
            elif self._target is None:
                wanted[axes] *= min(speed / size, 1.0)
            else:
                wanted[axes] *= min(_approach(size, acceleration), speed) / size
        return wanted

    def _ahead(self, wanted: Vector) -> Vector:
        """The place to look at: where braking from now on would end, and a little beyond."""
        ahead = np.array(self._pose)
        for axes, _, acceleration in self._groups:
            size = math.hypot(*wanted[axes].tolist())
            if size < _STILL:
                continue
            speed = math.hypot(*self._velocity[axes].tolist())
            reach = speed * speed / (2.0 * acceleration) + MARGIN
            if self._target is not None:
                reach = min(reach, math.hypot(*(self._target[axes] - self._pose[axes]).tolist()))
            ahead[axes] += wanted[axes] * (reach / size)
        return ahead


def _approach(distance: float, acceleration: float) -> float:
    """The speed at which to approach a target at a distance."""
    near = acceleration / GAIN**2
    return GAIN * distance if distance < near else math.sqrt(2.0 * acceleration * (distance - 0.5 * near))


LEASH_SLACK: Final = 0.6
"""Load of the spring, as a share of its limit, at which a path begins to wait."""
BLOCKED_AFTER: Final = 2.0
"""[s] at a standstill with the leash taut after which the way counts as blocked."""
_STANDSTILL: Final = 0.02
"""Share of the path's own pace below which it stands."""


class Follower:
    """The attractor on its leash.

    Args:
        at: where it rests at first.
    """

    def __init__(self, at: Vector) -> None:
        self.reference = Reference(np.array(at), np.zeros(len(at)))
        self._path: Path | None = None
        self._chase: Pursuit | None = None
        self._time = 0.0
        self._taut = 0.0

    @property
    def moving(self) -> bool:
        """Whether a path or a chase is being followed."""
        return self._path is not None or self._chase is not None

    @property
    def progress(self) -> float:
        """Share of the path's time that has been walked, 1 at rest."""
        if self._path is None or self._path.duration <= 0.0:
            return 1.0
        return min(self._time / self._path.duration, 1.0)

    @property
    def blocked(self) -> bool:
        """Whether the path has been held up for `BLOCKED_AFTER`."""
        return self._taut >= BLOCKED_AFTER

    def follow(self, path: Path) -> None:
        """Leave whatever is being followed and begin `path`."""
        self._path, self._chase, self._time, self._taut = path, None, 0.0, 0.0

    def chase(self, chase: Pursuit) -> None:
        """Leave whatever is being followed and be led by `chase`."""
        self._path, self._chase, self._taut = None, chase, 0.0

    def rest(self, at: Vector) -> None:
        """Drop the path and rest at `at`."""
        self._path, self._chase, self._taut = None, None, 0.0
        self.reference = Reference(np.array(at), np.zeros(len(at)))

    def advance(self, dt: float, load: float) -> Reference:
        """Walk on for `dt` [s] with the spring at `load` (1: at its limit).

        Args:
            dt: control period [s].
            load: share of the spring's limit.

        Returns:
            The reference for this period.
        """
        pace = min(max((1.0 - load) / (1.0 - LEASH_SLACK), 0.0), 1.0)
        if self._chase is not None:
            self.reference = self._chase.advance(dt, pace)
            return self.reference
        if self._path is None:
            return self.reference
        self._taut = self._taut + dt if pace < _STANDSTILL else 0.0
        self._time += dt * pace
        if self._time >= self._path.duration:
            self.rest(self._path.goal)
        else:
            pose, velocity = self._path.at(self._time)
            self.reference = Reference(pose, velocity * pace)
        return self.reference
