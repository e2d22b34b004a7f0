"""The .tlog of MAVLink tools: before each frame the time at which it came. Pure.

::

    8 bytes   time [us] since 1970, big-endian; MAVProxy keeps the number of a link in its lowest two bits
    frame     of MAVLink 1 or 2, as it came

There is no header, no length and no checksum but the frame's own. So a reader that has lost its place looks
for the next intact frame and believes the 8 bytes before it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.tools.capture.framing import (
    INCOMPLETE,
    MAGICS,
    claimed_size,
    find_magic,
    intact,
)
from robotree.protocol.tools.capture.records import Captured

if TYPE_CHECKING:
    from typing import BinaryIO

STAMP_BYTES = 8
_LINK = 0b11
"""The bits of a stamp that tell links apart; ours is link 0."""
_DAYS_3 = 3 * 24 * 3600 * 1_000_000
"""[us] that two neighbours may be apart where nothing else speaks for a frame; pymavlink allows as much."""


def encode(time: int, frame: bytes) -> bytes:
    """One record.

    Args:
        time: [us] since 1970; written in steps of 4 us.
        frame: one whole frame.
    """
    return (time & ~_LINK).to_bytes(STAMP_BYTES, "big") + frame


def plausible(head: bytes) -> bool:
    """Whether these first bytes look like a recording made between the years 2000 and 2100."""
    if len(head) <= STAMP_BYTES or head[STAMP_BYTES] not in MAGICS:
        return False
    return 946_684_800 <= int.from_bytes(head[:STAMP_BYTES], "big") / 1e6 < 4_102_444_800


class TlogWriter:
    """Writes records to a stream."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def write(self, time: int, frame: bytes) -> None:
        """Append one frame that came at `time`, [us] since 1970."""
        self._stream.write(encode(time, frame))

    def flush(self) -> None:
        """Nothing is kept."""

    def close(self) -> None:
        """Nothing more follows; a tlog has no end mark."""


class TlogReader:
    """Takes a recording apart, whatever it is. Keeps less than two records between two calls."""

    def __init__(self) -> None:
        self._rest = b""
        self.skipped = 0
        """[bytes] that belong to no record."""

    def feed(self, data: bytes) -> list[Captured]:
        """Take some bytes and hand out the records that they complete."""
        return self._scan(self._rest + data, ended=False)

    def flush(self) -> list[Captured]:
        """The file ended."""
        return self._scan(self._rest, ended=True)

    def _scan(self, buffer: bytes, *, ended: bool) -> list[Captured]:
        records, i = list[Captured](), 0
        while i + STAMP_BYTES < len(buffer):
            frame = i + STAMP_BYTES
            size = self._frame(buffer, frame, ended=ended)
            if size == INCOMPLETE:
                break
            if size:
                records.append(Captured(buffer[frame : frame + size], int.from_bytes(buffer[i:frame], "big")))
                i = frame + size
            else:
                found = find_magic(buffer, frame + 1)
                after = (found.start() if found else len(buffer)) - STAMP_BYTES
                self.skipped += after - i
                i = after
        if ended:
            self.skipped += len(buffer) - i
            i = len(buffer)
        self._rest = buffer[i:]
        return records

    @staticmethod
    def _frame(buffer: bytes, i: int, *, ended: bool) -> int:
        """The size of the frame at `i`; 0: there is none; INCOMPLETE: it takes more bytes to tell."""
        size = claimed_size(buffer, i)
        if size <= 0:
            return 0 if ended else size
        end = i + size
        if end > len(buffer):
            return 0 if ended else INCOMPLETE
        if intact(buffer[i:end]):
            return size
        following = end + STAMP_BYTES
        if following >= len(buffer):
            return (size if end == len(buffer) else 0) if ended else INCOMPLETE
        ours = int.from_bytes(buffer[i - STAMP_BYTES : i], "big")
        next_one = int.from_bytes(buffer[end:following], "big")
        return size if buffer[following] in MAGICS and abs(next_one - ours) < _DAYS_3 else 0
