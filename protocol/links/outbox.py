"""What waits for a far end that does not read as fast as we speak. Pure.

Telemetry is superseded: the newest frame of a topic takes the place of an older one. What has no topic
waits in order and is never dropped; whoever owns the outbox must cut the link when it outgrows its bound.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Hashable


class Outbox:
    """A queue in which telemetry is replaced instead of piling up."""

    def __init__(self) -> None:
        self._frames: dict[Hashable, bytes] = {}
        self._count = 0
        self.waiting = 0
        """[bytes] in the queue."""
        self.superseded = 0
        """Frames that were replaced."""

    def put(self, frame: bytes, topic: Hashable | None) -> None:
        """Queue a frame, or put it in the place of the waiting one of the same topic."""
        self._count += 1
        key = (self._count,) if topic is None else (topic, None)
        if (older := self._frames.get(key)) is not None:
            self.superseded += 1
            self.waiting -= len(older)
        self._frames[key] = frame
        self.waiting += len(frame)

    def pop(self) -> bytes | None:
        """The frame that has waited longest; None: nothing waits."""
        for key in self._frames:
            frame = self._frames.pop(key)
            self.waiting -= len(frame)
            return frame
        return None
