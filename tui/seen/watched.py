"""What people watch of a realm's readings: those that are ticked, over time, and alarms. Pure.

The store gives it each state that comes. Only robots that are watched cost anything.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import NamedTuple

from robotree.tui.seen.alarms import Alarm, beyond, judged
from robotree.tui.seen.series import Ticked


class Passed(NamedTuple):
    """A reading has passed the threshold of an alarm, or come back."""

    name: str
    """Of the alarm."""
    value: float
    at: float
    """[s] on the store's clock."""


@dataclass(slots=True)
class WatchedReadings:
    """Readings over time, and the alarms of the realm."""

    ticked: Ticked = field(default_factory=Ticked)
    alarms: dict[str, Alarm] = field(default_factory=dict[str, Alarm])
    """By name, as they are kept."""
    passed: list[Passed] = field(default_factory=list[Passed])
    """What is to be kept of them."""
    rung: int = 0
    """How often one was raised: then the terminal rings."""
    _of: dict[str, list[Alarm]] = field(default_factory=dict[str, list[Alarm]])
    """Alarms by robot: asked for each state that comes."""
    _told: set[tuple[str, bool]] = field(default_factory=set[tuple[str, bool]])
    """What was put into `passed` since the alarms were taken."""

    def take(self, robot: str, readings: Mapping[str, float], now: float) -> None:
        """Look at what a robot reads now [s]."""
        if robot in self.ticked.robots:
            self.ticked.take(robot, readings, now)
        for alarm in self._of.get(robot, ()):
            value = readings.get(alarm.reading)
            if value is None or not isfinite(value):
                continue
            is_beyond = beyond(alarm, value)
            if is_beyond != alarm.active and (alarm.name, is_beyond) not in self._told:
                self._told.add((alarm.name, is_beyond))
                self.passed.append(Passed(alarm.name, value, now))

    def take_alarms(self, alarms: Iterable[Alarm]) -> tuple[list[Alarm], list[Alarm]]:
        """Take the alarms as they are kept; returns which were raised, and which were acknowledged."""
        found = {alarm.name: alarm for alarm in alarms}
        before, self.alarms = self.alarms, found
        self._of, self._told = {}, set()
        for alarm in found.values():
            self._of.setdefault(alarm.robot, []).append(alarm)
        raised = [
            one for one in found.values() if one.open and not _same(before.get(one.name), one, "raised")
        ]
        acknowledged = [
            one
            for one in found.values()
            if one.name in before
            and one.acknowledged
            and not _same(before.get(one.name), one, "acknowledged")
        ]
        self.rung += bool(raised)
        return raised, acknowledged

    def open(self, robot: str = "") -> list[Alarm]:
        """Return the alarms at which a person must look, of a robot or of all."""
        return [one for one in (self._of.get(robot, ()) if robot else self.alarms.values()) if one.open]


def judging(passed: Iterable[Passed], since: float) -> Callable[[dict[str, Alarm]], None]:
    """Return what changes kept alarms as readings have passed them.

    Args:
        passed: which, the oldest first.
        since: [s] since 1970 when the clock of `passed` was 0.
    """

    def change(alarms: dict[str, Alarm]) -> None:
        for name, value, at in passed:
            if name in alarms:
                alarms[name] = judged(alarms[name], value, at + since)

    return change


def _same(before: Alarm | None, now: Alarm, moment: str) -> bool:
    return before is not None and getattr(before, moment) == getattr(now, moment)
