"""Alarms: a reading that passes its threshold is told until a person has acknowledged it. Pure.

An alarm is raised, then it is over or acknowledged, in either order; only after both it is calm again (as
ISA-18.2 has it). So none is missed because it was short, and none goes away because nobody looked.
"""

from __future__ import annotations

from typing import Literal

import msgspec

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
