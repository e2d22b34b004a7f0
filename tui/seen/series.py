"""Readings over time: what is ticked is remembered as it came, for some minutes. Pure; `now` is given."""

from __future__ import annotations

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from math import isfinite

KEPT = 6000
"""Values of one reading that are remembered: ten minutes at ten a second."""

Reading = tuple[str, str]
"""A robot's name, and that of one of its readings."""


def named(reading: Reading) -> str:
    """Write a reading as people do: `arm-1.fz`."""
    return ".".join(reading)


class Series:
    """The values of one reading, the oldest first."""

    __slots__ = ("_times", "_values", "count")

    def __init__(self, kept: int = KEPT) -> None:
        """Remember so many values."""
        self._times: deque[float] = deque(maxlen=kept)
        self._values: deque[float] = deque(maxlen=kept)
        self.count = 0
        """How many values have come; it grows with each."""

    def __len__(self) -> int:
        """Count the values."""
        return len(self._times)

    def add(self, now: float, value: float) -> None:
        """Remember a value that came now [s]; what is no number is left out, and so is what came before."""
        if not isfinite(value) or (self._times and now < self._times[-1]):
            return
        self.count += 1
        self._times.append(now)
        self._values.append(value)

    @property
    def latest(self) -> float | None:
        """The newest value; None: none has come."""
        return self._values[-1] if self._values else None

    @property
    def began(self) -> float | None:
        """[s] when the oldest value came that is remembered."""
        return self._times[0] if self._times else None

    def between(self, begin: float, end: float) -> tuple[list[float], list[float]]:
        """Return times and values from `begin` to `end` [s], with the one before for the line to it."""
        times = list(self._times)
        first, last = max(bisect_left(times, begin) - 1, 0), bisect_left(times, end)
        return times[first:last], list(self._values)[first:last]

    def sparkline(self, cells: int) -> str:
        """Draw every tenth of the newest values as bars, the newest on the right."""
        from robotree.tui.seen.instruments import bars

        return bars(list(self._values)[-10 * cells :][::10]).rjust(cells)


class Ticked:
    """The readings that people watch, each with its series."""

    def __init__(self) -> None:
        """Watch nothing."""
        self.series: dict[Reading, Series] = {}
        self.robots: dict[str, dict[str, Series]] = {}
        """The same by robot: asked for each state that comes."""

    def tick(self, reading: Reading) -> None:
        """Watch a reading from now on."""
        if reading not in self.series:
            self.series[reading] = Series()
            self.robots.setdefault(reading[0], {})[reading[1]] = self.series[reading]

    def untick(self, reading: Reading) -> None:
        """Forget a reading, and what came of it."""
        if self.series.pop(reading, None) is not None:
            del self.robots[reading[0]][reading[1]]
            if not self.robots[reading[0]]:
                del self.robots[reading[0]]

    def take(self, robot: str, readings: Mapping[str, float], now: float) -> None:
        """Remember what a watched robot reads now [s]."""
        for name, series in self.robots.get(robot, {}).items():
            if name in readings:
                series.add(now, readings[name])

    def names(self) -> list[str]:
        """Return the readings as people write them, in the order in which they were ticked."""
        return [named(one) for one in self.series]


def reading_of(text: str) -> Reading | None:
    """Read `arm-1.fz`; the robot may have the name of its site before it. None: it is no reading."""
    robot, dot, name = text.partition(".")
    return (robot, name) if robot and dot and name else None
