"""Both halves of ISO 15765-2 between two partners: what a node keeps for each other node. Pure.

>>> near, far = Channel(width=8), Channel(width=8)
>>> [first] = near.send(b"twenty bytes or more", now=0.0)
>>> flow = far.feed(first, now=0.0).reply
>>> rest = near.feed(flow[0], now=0.0).reply
>>> [far.feed(each, now=0.0).payload for each in rest]
[None, b'twenty bytes or more']

**Sending.** A payload that fits one frame is sent at once. A longer one begins with its first frame, waits
for a flow control, and goes on block by block. A receiver that stays silent for `N_BS` seconds, waits too
often or has no room ends the transfer: see `Sender.failed`. There is no acknowledgement of the last frame.

**Receiving.** Nothing that arrives can raise. One receiver hears one sender. It holds at most one payload, of
at most `largest` bytes: a first frame that announces more is answered with OVERFLOW. A missing frame ends the
reassembly; so does silence for `N_CR` seconds, or the beginning of another payload. A frame that comes twice
in a row, as CAN allows when the last bit of a frame is disturbed, is taken once.

What CAN does to frames on their way (loss, repetition at once, never another order) then yields no wrong
payload as long as flow controls do not come twice. ISO-TP itself has no checksum and its frames do not say to
which payload they belong; a receiver that must be certain needs a checksum inside the payload, as MAVLink
has.
"""

from __future__ import annotations

from copy import copy
from enum import Enum
from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import PayloadSize, TransferUnderWay
from robotree.protocol.isotp import frames
from robotree.protocol.isotp.frames import ConsecutiveFrame, FirstFrame, FlowControl, FlowStatus, SingleFrame

if TYPE_CHECKING:
    from collections.abc import Sequence

N_BS = 1.0
"""[s] The longest wait for a flow control (ISO 15765-2, table 18)."""
MOST_WAITS = 10
"""Flow controls in a row that say WAIT (N_WFTmax)."""


class Failure(Enum):
    """Why a transfer was given up."""

    SILENCE = "the receiver sent no flow control"
    OVERFLOW = "the receiver has no room"
    WAITS = "the receiver asked too often to wait"
    INVALID = "the receiver's flow control means nothing"


class SenderStatistics(msgspec.Struct):
    """One reading of a sender's gauges."""

    sent: int = 0
    """Payloads whose last frame went out."""
    failed: int = 0
    """Transfers that were given up."""
    unexpected: int = 0
    """Flow controls that nobody waited for."""


class Sender:
    """Sends one payload after another to one receiver.

    Args:
        width: [bytes] of the longest data field: 8 on classic CAN; 12, 16, 20, 24, 32, 48 or 64 on CAN FD.
        n_bs: [s] the longest wait for a flow control.
        most_waits: flow controls in a row that may say WAIT.
    """

    def __init__(self, width: int = frames.FD, n_bs: float = N_BS, most_waits: int = MOST_WAITS) -> None:
        if width not in frames.SIZES[frames.CLASSIC :]:
            raise ValueError(f"no CAN frame has a data field of {width} bytes; use 8 or a size of CAN FD")
        self.width, self.n_bs, self.most_waits = width, n_bs, most_waits
        self.failed: Failure | None = None
        """Why the latest transfer was given up; None: it was not, or it is under way."""
        self.due = inf
        """When to call `tick` again, [s]."""
        self._single = frames.largest_single(width)
        self._payload = b""
        self._position = self._number = self._block = self._waits = 0
        self._separation = 0.0
        self._waiting = False
        self._gauges = SenderStatistics()

    @property
    def busy(self) -> bool:
        """Whether a transfer is under way."""
        return self.due != inf

    @property
    def statistics(self) -> SenderStatistics:
        """The gauges now."""
        return copy(self._gauges)

    def send(self, payload: bytes, now: float) -> list[bytes]:
        """Begin a transfer; hand back the data fields to send now.

        Raises:
            TransferUnderWay: the one before has not ended.
            PayloadSize: the payload has not 1 to 4095 bytes.
        """
        if self.due != inf:
            raise TransferUnderWay(len(self._payload), self._position)
        self.failed = None
        if 0 < len(payload) <= self._single:
            self._gauges.sent += 1
            return [frames.single(payload, self.width)]
        if not 0 < len(payload) <= frames.LARGEST:
            raise PayloadSize(len(payload), frames.LARGEST)
        self._payload = payload
        self._position, self._number, self._waits = self.width - 2, 1, 0
        self._waiting, self.due = True, now + self.n_bs
        return [frames.first(payload, self.width)]

    def control(self, flow: FlowControl, now: float) -> list[bytes]:
        """Take the receiver's flow control; hand back the data fields to send now."""
        if not self._waiting:
            self._gauges.unexpected += 1
            return []
        if flow.status == FlowStatus.CONTINUE:
            self._waiting, self._waits = False, 0
            self._block = flow.block_size or frames.LARGEST
            self._separation, self.due = flow.separation, now
            return self.tick(now)
        if flow.status == FlowStatus.WAIT:
            self._waits += 1
            self.due = now + self.n_bs
            if self._waits > self.most_waits:
                self._give_up(Failure.WAITS)
        else:
            self._give_up(Failure.OVERFLOW if flow.status == FlowStatus.OVERFLOW else Failure.INVALID)
        return []

    def tick(self, now: float) -> list[bytes]:
        """The data fields that are due now; a receiver that was silent too long ends the transfer."""
        if now < self.due:
            return []
        if self._waiting:
            self._give_up(Failure.SILENCE)
            return []
        out: list[bytes] = []
        step = self.width - 1
        while self.due <= now:
            out.append(
                frames.consecutive(self._number, self._payload[self._position : self._position + step])
            )
            self._position += step
            self._number += 1
            self._block -= 1
            if self._position >= len(self._payload):
                self._gauges.sent += 1
                self._end()
            elif not self._block:
                self._waiting, self.due = True, now + self.n_bs
            elif self._separation:
                self.due = now + self._separation
        return out

    def _give_up(self, failure: Failure) -> None:
        self.failed = failure
        self._gauges.failed += 1
        self._end()

    def _end(self) -> None:
        self._payload, self._waiting, self.due = b"", False, inf


N_CR = 1.0
"""[s] The longest wait for the next consecutive frame (ISO 15765-2, table 18)."""


class ReceiverStatistics(msgspec.Struct):
    """One reading of a receiver's gauges."""

    received: int = 0
    """Payloads handed out."""
    out_of_sequence: int = 0
    """Reassemblies that ended because a frame was missing."""
    interrupted: int = 0
    """Reassemblies that ended because another payload began."""
    silent: int = 0
    """Reassemblies that ended because nothing more came."""
    repeated: int = 0
    """Frames that came twice in a row."""
    unexpected: int = 0
    """Consecutive frames of no payload."""
    refused: int = 0
    """First frames that announced more than we take."""


class Receiver:
    """Reassembles the payloads of one sender.

    Args:
        largest: [bytes] of the longest payload to take.
        n_cr: [s] the longest wait for the next frame.
        block_size: consecutive frames between two flow controls; 0: one flow control for all.
        separation: [s] between two consecutive frames, which we ask the sender to keep.
    """

    def __init__(
        self,
        largest: int = frames.LARGEST,
        n_cr: float = N_CR,
        block_size: int = 0,
        separation: float = 0.0,
    ) -> None:
        self.largest, self.n_cr = largest, n_cr
        self.due = inf
        """When to call `tick` again, [s]."""
        self._go_on = frames.flow_control(FlowControl(FlowStatus.CONTINUE, block_size, separation))
        self._no_room = frames.flow_control(FlowControl(FlowStatus.OVERFLOW))
        self._block_size = block_size
        self._pieces: list[bytes] = []
        self._missing = self._step = self._number = self._block = 0
        self._since = 0.0
        self._gauges = ReceiverStatistics()

    @property
    def statistics(self) -> ReceiverStatistics:
        """The gauges now."""
        return copy(self._gauges)

    def single(self, frame: SingleFrame) -> bytes:
        """Take a single frame: it is the payload."""
        self._interrupt()
        self._gauges.received += 1
        return frame.data

    def first(self, frame: FirstFrame, now: float) -> bytes | None:
        """Take a first frame; hand back the data field of the flow control to send, if one is due."""
        if self._pieces == [frame.data] and now < self._since + self.n_cr / 4:
            self._gauges.repeated += 1  # too early for a sender that lost patience and begins again
            return None
        self._interrupt()
        if frame.length > self.largest:
            self._gauges.refused += 1
            return self._no_room
        self._pieces = [frame.data]
        self._missing = frame.length - len(frame.data)
        self._step = len(frame.data) + 1  # a consecutive frame has one byte of header less
        self._number, self._block = 0, self._block_size
        self._since, self.due = now, now + self.n_cr
        return self._go_on

    def consecutive(self, frame: ConsecutiveFrame, now: float) -> tuple[bytes | None, bytes | None]:
        """Take a consecutive frame.

        Returns:
            The payload, if it is whole now, and the data field of a flow control, if one is due.
        """
        self.tick(now)
        if self.due == inf:
            self._gauges.unexpected += 1
            return None, None
        needed = min(self._missing, self._step)
        if frame.number != self._number + 1 & 0xF or len(frame.data) < needed:
            if frame.number == self._number and self._pieces[-1] == frame.data[: self._step] != b"":
                self._gauges.repeated += 1
            else:
                self._gauges.out_of_sequence += 1
                self._end()
            return None, None
        self._number = frame.number
        self._pieces.append(frame.data[:needed])
        self._missing -= needed
        self.due = now + self.n_cr
        if not self._missing:
            payload = b"".join(self._pieces)
            self._gauges.received += 1
            self._end()
            return payload, None
        self._block -= 1
        if self._block:
            return None, None
        self._block = self._block_size
        return None, self._go_on

    def tick(self, now: float) -> None:
        """Forget the payload whose sender has been silent too long."""
        if now >= self.due:
            self._gauges.silent += 1
            self._end()

    def _interrupt(self) -> None:
        if self.due != inf:
            self._gauges.interrupted += 1
            self._end()

    def _end(self) -> None:
        self._pieces, self.due = [], inf


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
