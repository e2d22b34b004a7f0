"""The sending half of ISO 15765-2: a payload becomes frames, as fast as the receiver allows. Pure.

A payload that fits one frame is sent at once. A longer one begins with its first frame, waits for a flow
control, and goes on block by block. A receiver that stays silent for `N_BS` seconds, waits too often or has
no room ends the transfer: see `Sender.failed`. There is no acknowledgement of the last frame.
"""

from __future__ import annotations

from copy import copy
from enum import Enum
from math import inf

import msgspec

from robotree.protocol.errors import PayloadSize, TransferUnderWay
from robotree.protocol.isotp import frames
from robotree.protocol.isotp.frames import FlowControl, FlowStatus

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
