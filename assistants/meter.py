"""How far robots move: the way of each robot that tells its position, summed up while commands run. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

AXES: Final = ("x", "y", "z")
NOISE: Final = 0.0005
"""[m] that a robot which holds still may seem to move between two reports."""
MOST_POINTS: Final = 400
"""Points of a way that is kept; of a longer one every second."""

Point = tuple[float, float, float]


def position_of(readings: Mapping[str, float]) -> Point | None:
    """Return where a robot is, [m]; None: it does not tell. Its third coordinate may be missing."""
    x, y = readings.get("x"), readings.get("y")
    if x is None or y is None:
        return None
    found = (x, y, readings.get("z", 0.0))
    return found if all(map(math.isfinite, found)) else None


class Way:
    """The way of some robots while a command runs."""

    def __init__(self, robots: Iterable[str]) -> None:
        """Take the names of the robots that may move."""
        self.metres = 0.0
        """[m] that all of them have moved."""
        self._at: dict[str, Point | None] = dict.fromkeys(robots)
        self.points: dict[str, list[Point]] = {}

    def take(self, robot: str, readings: Mapping[str, float]) -> None:
        """Take what a robot reads; one that is not meant is left out."""
        if robot not in self._at or (here := position_of(readings)) is None:
            return
        before = self._at[robot]
        if before is not None:
            moved = math.dist(before, here)
            if moved < NOISE:
                return
            self.metres += moved
        self._at[robot] = here
        points = self.points.setdefault(robot, [])
        points.append(here)
        if len(points) > MOST_POINTS:
            del points[1:-1:2]

    @property
    def longest(self) -> tuple[Point, ...]:
        """The way of the robot that has moved through most points."""
        ways = sorted(self.points.values(), key=len)
        return tuple(ways[-1]) if ways else ()
