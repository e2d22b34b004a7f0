"""The twin: the last values that a robot reported, with their age. Pure: `now` comes from the caller.

Every value is kept with the time when it arrived. An old one is still shown; the reading `age` says how old.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

from robotree.protocol.messages import AnyMessage
from robotree.proxy.translate import READERS, MessageReaders, readings_of

T = TypeVar("T")


@dataclass(slots=True)
class Twin:
    """The last known state of one robot."""

    readers: MessageReaders = field(default_factory=lambda: READERS)
    """How its telemetry is read."""
    heard_at: float = -math.inf
    """[s] when the last telemetry came."""
    _readings: dict[str, float] = field(default_factory=dict[str, float])
    _latest: dict[type[Any], tuple[AnyMessage, float]] = field(
        default_factory=dict[type[Any], tuple[AnyMessage, float]]
    )

    def update(self, message: AnyMessage, now: float) -> None:
        """Keep a message, and its readings if it is telemetry."""
        self._latest[type(message)] = (message, now)
        if type(message) in self.readers:
            self.heard_at = now
            self._readings.update(readings_of(message, self.readers))

    def latest(self, kind: type[T]) -> T | None:
        """The last message of a kind, however old, or None."""
        entry = self._latest.get(kind)
        return None if entry is None else cast("T", entry[0])

    def after(self, kind: type[T], moment: float) -> T | None:
        """The last message of a kind if it was heard after a moment, else None."""
        entry = self._latest.get(kind)
        return None if entry is None or entry[1] <= moment else cast("T", entry[0])

    def age(self, now: float) -> float:
        """[s] since the last telemetry; infinite when there never was any."""
        return now - self.heard_at

    def readings(self, now: float) -> dict[str, float]:
        """Every reading by name, and `age` [s]. Empty before the first telemetry."""
        return {**self._readings, "age": max(0.0, self.age(now))} if self._readings else {}
