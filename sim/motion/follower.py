"""The leash on which the attractor follows a path.

The leash stretches a path's time: as the spring between tool and attractor fills from 60 % to 100 % of its
limit, the path slows from full speed to a stop, so an arm that is blocked or pushed away resumes where it is
instead of jumping after a reference that has run ahead. The attractor's velocity is scaled likewise (unscaled
it would add its damping force, 28 N instead of 15 N at the table).

Pure: seconds and loads in, references out.
"""

from typing import Final

import numpy as np

from robotree.sim.motion.path import Path, Reference
from robotree.sim.motion.pursuit import Pursuit
from robotree.sim.physics.vectors import Vector

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
