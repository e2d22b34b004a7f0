"""The receiving half of ISO 15765-2: frames become a payload again. Pure; nothing that arrives can raise.

One receiver hears one sender. It holds at most one payload, of at most `largest` bytes: a first frame that
announces more is answered with OVERFLOW. A missing frame ends the reassembly; so does silence for `N_CR`
seconds, or the beginning of another payload. A frame that comes twice in a row, as CAN allows when the last
bit of a frame is disturbed, is taken once.

What CAN does to frames on their way (loss, repetition at once, never another order) then yields no wrong
payload as long as flow controls do not come twice. ISO-TP itself has no checksum and its frames do not say to
which payload they belong; a receiver that must be certain needs a checksum inside the payload, as MAVLink
has.
"""

from __future__ import annotations

from copy import copy
from math import inf

import msgspec

from robotree.protocol.isotp import frames
from robotree.protocol.isotp.frames import ConsecutiveFrame, FirstFrame, FlowControl, FlowStatus, SingleFrame

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
