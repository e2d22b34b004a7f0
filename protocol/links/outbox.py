"""Frames that wait while the far end reads slower than we send, and statistics of those sent. Pure.

Telemetry is superseded: the newest frame of a topic replaces an older one. Frames without a topic wait in
order and are never dropped; a far end that lets too many wait is disconnected (`overrun`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.errors import LinkOverrun
from robotree.protocol.links.link import LinkStatistics, encoded

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.links.link import Unsent

BOUND = 1024 * 1024
"""[bytes] that may wait."""


class Outbox:
    """A queue in which telemetry is replaced instead of piling up.

    Args:
        bound: [bytes] that may wait.
    """

    def __init__(self, bound: int = BOUND) -> None:
        self._frames: dict[Hashable, bytes | Unsent] = {}
        self._bound, self._count = bound, 0
        self.waiting = 0
        """[bytes] in the queue."""
        self.sent = self.received = 0
        """[bytes]"""
        self.superseded = self.dropped = 0
        """Frames that were replaced, and frames that nobody wants any longer."""

    def put(self, frame: bytes | Unsent, topic: Hashable | None) -> None:
        """Queue a frame, or put it in the place of the waiting one of the same topic."""
        self._count += 1
        key = (self._count,) if topic is None else (topic, None)
        if (older := self._frames.get(key)) is not None:
            self.superseded += 1
            self.waiting -= len(older)
        self._frames[key] = frame
        self.waiting += len(frame)

    def pop(self) -> bytes | None:
        """The frame that has waited longest, sealed, which counts as sent; None: nothing waits."""
        for key in self._frames:
            frame = self._frames.pop(key)
            self.waiting -= len(frame)
            return self.leave(frame)
        return None

    def leave(self, frame: bytes | Unsent) -> bytes:
        """Seal and count a frame that leaves now; what waits must not be overtaken."""
        data = encoded(frame)
        self.sent += len(data)
        return data

    def overrun(self, address: str) -> LinkOverrun | None:
        """Why the link to an address must be cut now; None: what waits is within the bound."""
        return LinkOverrun(address, self.waiting) if self.waiting > self._bound else None

    def statistics(self, under_way: int = 0) -> LinkStatistics:
        """The gauges of the link now.

        Args:
            under_way: [bytes] that have left the queue and wait elsewhere.
        """
        return LinkStatistics(
            sent=self.sent,
            received=self.received,
            waiting=self.waiting + under_way,
            superseded=self.superseded,
            dropped=self.dropped,
        )
