"""Set-points: a stream that says where to be now, and that ends by itself when it dries up.

A set-point lives for its time to live, counted in controller time from the moment at which it was made, so
that one that was delayed in a queue is dropped instead of obeyed. Who does not know the controller's time
sends 0, and it counts from arrival. An older epoch or a smaller number is dropped; what was dropped is
counted.
"""

from __future__ import annotations

from math import isinf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Setpoint, SetpointKind

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

LONGEST_TTL = 2.0
"""[s] that a set-point lives at most, whatever it says."""
_HALF = 1 << 31


class SetpointStatistics(msgspec.Struct, frozen=True):
    """One reading of a receiver's gauges."""

    obeyed: int
    late: int
    """Made too long ago, or in the future."""
    stale: int
    """From an epoch that is over."""
    overtaken: int
    """Older than one already obeyed."""
    refused: int
    """Of an unknown kind, infinite, or without a time to live."""


class SetpointReceiver:
    """The set-points of one controller.

    Args:
        kinds: what this controller can follow.
        fence: obeys an epoch from now on, or says that it is over; `GoalServer.fence`.
    """

    def __init__(self, kinds: Collection[SetpointKind], fence: Callable[[int], bool]) -> None:
        self._kinds, self._fence = frozenset(kinds), fence
        self._current: Setpoint | None = None
        self._until = float("-inf")
        self._newest: tuple[int, int] | None = None
        self._obeyed = self._late = self._stale = self._overtaken = self._refused = 0

    @property
    def statistics(self) -> SetpointStatistics:
        """The gauges now."""
        return SetpointStatistics(
            obeyed=self._obeyed,
            late=self._late,
            stale=self._stale,
            overtaken=self._overtaken,
            refused=self._refused,
        )

    def receive(self, setpoint: Setpoint, now: float) -> bool:
        """Take a set-point that is addressed to this controller; whether it is obeyed.

        Args:
            setpoint: the set-point.
            now: controller time, [s].
        """
        if setpoint.kind not in self._kinds or any(map(isinf, setpoint.args)) or not setpoint.ttl_ms:
            self._refused += 1
            return False
        ttl = min(setpoint.ttl_ms / 1000, LONGEST_TTL)
        made = setpoint.time_boot_ms / 1000 if setpoint.time_boot_ms else now
        if not now - ttl < made <= now + LONGEST_TTL:
            self._late += 1
            return False
        if not self._fence(setpoint.epoch):
            self._stale += 1
            return False
        if self._is_overtaken(setpoint):
            self._overtaken += 1
            return False
        self._newest = setpoint.epoch, setpoint.number
        self._current, self._until = setpoint, min(made, now) + ttl
        self._obeyed += 1
        return True

    def active(self, now: float) -> Setpoint | None:
        """The set-point to follow now; None: there is none (any more)."""
        if self._current is not None and now >= self._until:
            self._current = None
        return self._current

    def drop(self) -> None:
        """Follow none any more, because of a stop or a goal."""
        self._current = None

    def _is_overtaken(self, setpoint: Setpoint) -> bool:
        if self._newest is None or self._newest[0] != setpoint.epoch:
            return False
        ahead = (setpoint.number - self._newest[1]) & 0xFFFFFFFF
        return not 0 < ahead < _HALF
