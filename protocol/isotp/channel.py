"""Both halves of ISO 15765-2 between two partners: what a node keeps for each other node. Pure.

>>> near, far = Channel(width=8), Channel(width=8)
>>> [first] = near.send(b"twenty bytes or more", now=0.0)
>>> flow = far.feed(first, now=0.0).reply
>>> rest = near.feed(flow[0], now=0.0).reply
>>> [far.feed(each, now=0.0).payload for each in rest]
[None, b'twenty bytes or more']
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.isotp import frames
from robotree.protocol.isotp.frames import ConsecutiveFrame, FirstFrame, SingleFrame
from robotree.protocol.isotp.receiver import N_CR, Receiver, ReceiverStatistics
from robotree.protocol.isotp.sender import N_BS, Failure, Sender, SenderStatistics

if TYPE_CHECKING:
    from collections.abc import Sequence


class Heard(msgspec.Struct, frozen=True, gc=False):
    """The result of one data field."""

    payload: bytes | None = None
    """A payload that is whole now."""
    reply: Sequence[bytes] = ()
    """Data fields to send to the partner."""


_NOTHING = Heard()


class ChannelStatistics(msgspec.Struct, frozen=True):
    """One reading of a channel's gauges."""

    sender: SenderStatistics
    receiver: ReceiverStatistics
    malformed: int
    """Data fields that mean nothing."""


class Channel:
    """A sender and a receiver that share one pair of identifiers.

    Args:
        width: [bytes] of the longest data field we send; see `Sender`. What comes may be of any width.
        largest: [bytes] of the longest payload to take.
        timeout: [s] that the partner may be silent in the middle of a transfer.
        block_size: see `Receiver`.
        separation: see `Receiver`.
    """

    def __init__(
        self,
        width: int = frames.FD,
        *,
        largest: int = frames.LARGEST,
        timeout: float = max(N_BS, N_CR),
        block_size: int = 0,
        separation: float = 0.0,
    ) -> None:
        self._sender = Sender(width, timeout)
        self._receiver = Receiver(largest, timeout, block_size, separation)
        self._malformed = 0

    @property
    def due(self) -> float:
        """When to call `tick` again, [s]."""
        return min(self._sender.due, self._receiver.due)

    @property
    def busy(self) -> bool:
        """Whether a payload is under way to the partner; `send` must wait."""
        return self._sender.busy

    @property
    def failed(self) -> Failure | None:
        """Why the latest payload was given up."""
        return self._sender.failed

    @property
    def statistics(self) -> ChannelStatistics:
        """The gauges now."""
        return ChannelStatistics(self._sender.statistics, self._receiver.statistics, self._malformed)

    def send(self, payload: bytes, now: float) -> Sequence[bytes]:
        """Begin to send a payload; hand back the data fields to send now.

        Raises:
            TransferUnderWay: the one before has not ended.
            PayloadSize: the payload has not 1 to 4095 bytes.
        """
        return self._sender.send(payload, now)

    def feed(self, field: bytes, now: float) -> Heard:
        """Take a data field that the partner sent, whatever it is."""
        frame = frames.decode(field)
        if isinstance(frame, SingleFrame):
            return Heard(self._receiver.single(frame))
        if isinstance(frame, ConsecutiveFrame):
            payload, reply = self._receiver.consecutive(frame, now)
            return (
                _NOTHING if payload is None and reply is None else Heard(payload, (reply,) if reply else ())
            )
        if isinstance(frame, FirstFrame):
            reply = self._receiver.first(frame, now)
            return Heard(None, (reply,) if reply else ())
        if frame is None:
            self._malformed += 1
            return _NOTHING
        return Heard(None, self._sender.control(frame, now))

    def tick(self, now: float) -> Sequence[bytes]:
        """The data fields that are due now; transfers whose partner was silent too long end."""
        self._receiver.tick(now)
        return self._sender.tick(now)
