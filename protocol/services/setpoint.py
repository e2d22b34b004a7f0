"""Set-points: a stream of targets that ends by itself when no new one arrives.

A set-point has a time to live, counted in controller time from the time when it was made, so that a set-point
that was delayed in a queue is dropped. A sender that does not know the controller's time sends 0, and the
time to live counts from arrival. The time on the wire wraps every 49.7 days: it means the time nearest to the
arrival. A set-point with an older epoch or a smaller number is dropped and counted. A sender that begins to
count anew is obeyed after a pause in which no set-point could be valid. One sender is followed at a time:
another one must wait until the stream has ended, or bring a newer epoch. A stream that was ended by a stop or
a goal stays ended: its sender begins a new one with a newer epoch or after a pause, so that nothing moves
again by itself when the stop is released.
"""

from __future__ import annotations

from copy import copy
from math import isinf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Setpoint, SetpointKind

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Hashable

LONGEST_TTL = 2.0
"""[s] that a set-point lives at most, whatever it says."""
PAUSE = LONGEST_TTL
"""[s] without a set-point that could be obeyed, after which a sender's next one begins a new stream.

It is numbered anew. As long as a set-point lives: what was sent with an earlier one is over by then.
"""
MAX_PEERS = 64
"""Senders whose ended streams are remembered."""
_TURN = 1 << 32
"""After so many numbers, or [ms], the wire begins anew."""
_HALF = _TURN // 2


class SetpointStatistics(msgspec.Struct):
    """One reading of a receiver's gauges."""

    obeyed: int = 0
    late: int = 0
    """Made too long ago, or in the future."""
    stale: int = 0
    """From an epoch that is over or not honest, or made for another life of the controller."""
    overtaken: int = 0
    """Setpoints that are older than one already obeyed."""
    refused: int = 0
    """Of an unknown kind, infinite, without a time to live, or out of the robot's limits."""
    ended: int = 0
    """Of a stream that is over, or beside the stream of another sender."""


class _Stream(msgspec.Struct):
    """The stream that was obeyed last."""

    sender: Hashable
    epoch: int
    number: int
    obeyed: float
    """[s] Its last set-point that was; one that was overtaken does not keep it alive."""
    heard: float
    """[s] Its last set-point."""


class _ShutOut(msgspec.Struct):
    """A sender whose stream is over."""

    epoch: int
    heard: float
    """[s] Its last set-point."""


class SetpointReceiver:
    """The set-points of one controller.

    Args:
        kinds: what this controller can follow.
        fence: obeys an epoch from now on, or says that it is over; `GoalServer.fence`.
        life: of this controller; set-points made for another one are dropped. 0: none is.
    """

    def __init__(self, kinds: Collection[SetpointKind], fence: Callable[[int], bool], life: int = 0) -> None:
        self._kinds, self._fence, self._life = frozenset(kinds), fence, life
        self._current: Setpoint | None = None
        self._until = float("-inf")
        self._stream: _Stream | None = None
        self._shut_out: dict[Hashable, _ShutOut] = {}
        self._gauges = SetpointStatistics()

    @property
    def statistics(self) -> SetpointStatistics:
        """The gauges now."""
        return copy(self._gauges)

    def receive(
        self, setpoint: Setpoint, now: float, sender: Hashable = None, *, arrived: float | None = None
    ) -> bool:
        """Take a set-point that is addressed to this controller; whether it is obeyed.

        Args:
            setpoint: the set-point.
            now: controller time, [s].
            sender: whose stream it belongs to.
            arrived: when it arrived, if it waited since, [s].
        """
        if setpoint.kind not in self._kinds or any(map(isinf, setpoint.args)) or not setpoint.ttl_ms:
            self._gauges.refused += 1
            return False
        ttl = min(setpoint.ttl_ms / 1000, LONGEST_TTL)
        made = _made(setpoint.time_boot_ms, now if arrived is None else arrived)
        if not now - ttl < made <= now + LONGEST_TTL:
            self._gauges.late += 1
            return False
        elsewhere = bool(self._life) and setpoint.life not in {0, self._life}
        if elsewhere or not self._fence(setpoint.epoch):
            self._gauges.stale += 1
            return False
        stream = self._continued(setpoint, sender, now)
        if self._is_shut_out(setpoint, sender, now) or (stream is None and self._is_beside(setpoint, now)):
            self._gauges.ended += 1
            return False
        if stream is not None and not 0 < (setpoint.number - stream.number) % _TURN < _HALF:
            self._gauges.overtaken += 1
            return False
        self._stream = _Stream(sender, setpoint.epoch, setpoint.number, obeyed=now, heard=now)
        self._current, self._until = setpoint, min(made, now) + ttl
        self._gauges.obeyed += 1
        return True

    def refuse(self, setpoint: Setpoint, now: float, sender: Hashable = None, *, over: bool = False) -> None:
        """Count a set-point that the robot's limits or its rules do not allow.

        Args:
            setpoint: the set-point.
            now: controller time, [s].
            sender: whose stream it belongs to.
            over: that stream is over, as after `drop`: a stop is in force, or a goal runs.
        """
        self._gauges.refused += 1
        if over:
            self._shut(sender, setpoint.epoch, now)

    def active(self, now: float) -> Setpoint | None:
        """The set-point to follow now; None: there is none (any more)."""
        if self._current is not None and now >= self._until:
            self._current = None
        return self._current

    def drop(self) -> None:
        """Follow none any more, because of a stop or a goal; the stream is over."""
        self._current = None
        if self._stream is not None:
            self._shut(self._stream.sender, self._stream.epoch, self._stream.heard)

    def _shut(self, sender: Hashable, epoch: int, heard: float) -> None:
        """End a sender's stream; a straggler of an older epoch does not give back the newer one."""
        before = self._shut_out.pop(sender, None)
        if before is not None and heard - before.heard < PAUSE:
            epoch, heard = max(epoch, before.epoch), max(heard, before.heard)
        if len(self._shut_out) >= MAX_PEERS:
            del self._shut_out[next(iter(self._shut_out))]
        self._shut_out[sender] = _ShutOut(epoch, heard)

    def _continued(self, setpoint: Setpoint, sender: Hashable, now: float) -> _Stream | None:
        """The stream that was obeyed last, if a set-point belongs to it; it is heard by that."""
        stream = self._stream
        if stream is None or (stream.sender, stream.epoch) != (sender, setpoint.epoch):
            return None
        stream.heard = now
        return stream if now - stream.obeyed < PAUSE else None

    def _is_shut_out(self, setpoint: Setpoint, sender: Hashable, now: float) -> bool:
        """Whether a set-point belongs to a stream that is over; its pause begins anew by that."""
        if (shut := self._shut_out.get(sender)) is None:
            return False
        if setpoint.epoch > shut.epoch or now - shut.heard >= PAUSE:
            del self._shut_out[sender]
            return False
        shut.heard = now
        return True

    def _is_beside(self, setpoint: Setpoint, now: float) -> bool:
        """Whether a set-point comes beside the stream of another sender, whose lease is as new."""
        held = self.active(now) is not None
        return held and self._stream is not None and setpoint.epoch <= self._stream.epoch


def _made(time_boot_ms: int, arrived: float) -> float:
    """When a set-point was made by its time on the wire [s of controller time]; 0: when it arrived."""
    if not time_boot_ms:
        return arrived
    arrived_ms = round(1000 * arrived)
    ahead = (time_boot_ms - arrived_ms + _HALF) % _TURN - _HALF
    return (arrived_ms + ahead) / 1000
