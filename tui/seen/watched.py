"""What people watch of a realm's readings: those that are ticked, over time, and alarms. Pure.

The store gives it each state that comes. Only robots that are watched cost anything.

A reading that passes its threshold is told until a person has acknowledged it. An alarm is raised, then it
is over or acknowledged, in either order; only after both it is calm again (as ISA-18.2 has it). So none is
missed because it was short, and none goes away because nobody looked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal, NamedTuple

import msgspec

from robotree.tui.seen.series import Ticked

HYSTERESIS = 0.02
"""Share of the threshold by which a reading must come back before the alarm is over: noise rings once."""

Sign = Literal[">", "<"]
AlarmState = Literal["calm", "raised", "acknowledged", "over"]
"""over: the reading has come back, and nobody has acknowledged that it was away."""


class Alarm(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A threshold of one reading, and what became of it."""

    robot: str
    reading: str
    sign: Sign
    limit: float
    """In the unit of the reading."""
    unit: str = ""
    by: str = ""
    """The person who set it."""
    since: float = 0.0
    """[s] since 1970 when it was set."""
    raised: float = 0.0
    """[s] since 1970 when the reading passed it last; 0: never."""
    value: float = 0.0
    """The reading at that moment."""
    over: float = 0.0
    """[s] since 1970 when the reading came back after that; 0: it has not."""
    acknowledged: float = 0.0
    """[s] since 1970 when a person acknowledged that; 0: nobody has."""
    acknowledged_by: str = ""

    @property
    def name(self) -> str:
        """The reading as people write it."""
        return f"{self.robot}.{self.reading}"

    @property
    def state(self) -> AlarmState:
        """How it is."""
        if not self.raised or (self.over and self.acknowledged):
            return "calm"
        if self.over:
            return "over"
        return "acknowledged" if self.acknowledged else "raised"

    @property
    def open(self) -> bool:
        """Whether a person must look."""
        return self.state in ("raised", "over")

    @property
    def active(self) -> bool:
        """Whether the reading is beyond the threshold."""
        return bool(self.raised) and not self.over


def beyond(alarm: Alarm, value: float) -> bool:
    """Whether a value raises an alarm, or keeps it raised."""
    room = abs(alarm.limit) * HYSTERESIS if alarm.active else 0.0
    return value > alarm.limit - room if alarm.sign == ">" else value < alarm.limit + room


def judged(alarm: Alarm, value: float, unix: float) -> Alarm:
    """Return the alarm after a value [unit of the reading] that came at this moment [s since 1970]."""
    is_beyond = beyond(alarm, value)
    if is_beyond == alarm.active:
        return alarm
    if not is_beyond:
        return msgspec.structs.replace(alarm, over=unix)
    return msgspec.structs.replace(
        alarm, raised=unix, value=value, over=0.0, acknowledged=0.0, acknowledged_by=""
    )


def acknowledged(alarm: Alarm, by: str, unix: float) -> Alarm:
    """Return the alarm after a person has acknowledged it; one that nobody must look at stays as it is."""
    if not alarm.open:
        return alarm
    return msgspec.structs.replace(alarm, acknowledged=unix, acknowledged_by=by)


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
