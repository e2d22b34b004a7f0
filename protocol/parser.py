"""From a stream of bytes to frames. Nothing that arrives can raise; whatever is no frame is counted.

After a bad checksum or an unknown id the parser steps one byte, never the length that the broken frame
claims: that is what loses no intact frame behind it.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

import msgspec
from fastcrc.crc16 import mcrf4xx

from robotree.protocol.dialect.table import definitions
from robotree.protocol.frame import MAGIC, MAGIC_V1, SIGNATURE_BYTES, SIGNED, Frame, decode_v1
from robotree.protocol.messages.base import codec_of

if TYPE_CHECKING:
    from robotree.protocol.codec import Codec

_OVERHEAD = 12
"""[bytes] of an unsigned frame around its payload."""
_OVERHEAD_V1 = 8
_MAGIC = re.compile(rb"[\xfd\xfe]")
_LATE = 128
"""A sequence number this far ahead is an old frame that was overtaken, not a gap."""


class Verifier(Protocol):
    """Decides whether a frame with a good checksum may pass."""

    def verify(self, frame: Frame) -> bool:
        """Whether to hand the frame out; an unsigned one is asked for as well."""
        ...


class ParserStatistics(msgspec.Struct, frozen=True):
    """One reading of a parser's gauges."""

    received: int
    """Frames handed out."""
    bad_crc: int
    """Places that began like a frame and had a wrong checksum."""
    unknown: int
    """Places that began like a frame with an id that the dialect does not have."""
    incompatible: int
    """Intact frames with a flag that we do not understand."""
    refused: int
    """Intact frames that the verifier refused."""
    version_1: int
    """Frames of MAVLink 1 among the received ones."""
    lost: int
    """Frames that never came, by the gaps in the sequence numbers."""
    late: int
    """Frames that came twice or out of order."""
    skipped: int
    """[bytes] that belong to no intact frame."""
    bytes: int
    """[bytes] fed."""


class _Codecs(dict[bytes, "Codec | None"]):
    """Codecs by the three bytes of the id on the wire, compiled when first met."""

    def __missing__(self, key: bytes) -> Codec | None:
        msgid = int.from_bytes(key, "little")
        if msgid not in definitions():
            return None  # not remembered: a stream may hold 16 million of them
        found = self[key] = codec_of(msgid)
        return found


_CODECS = _Codecs()


class Parser:
    """One per incoming stream. Keeps less than one frame between two calls.

    Args:
        verifier: asked about every intact frame; None: all pass, signed or not.
    """

    def __init__(self, verifier: Verifier | None = None) -> None:
        self._verifier = verifier
        self._rest = b""
        self._system = self._component = self._next = -1
        self._expected: dict[tuple[int, int], int] = {}
        self._received = self._bad_crc = self._unknown = self._incompatible = self._refused = 0
        self._version_1 = self._lost = self._late = self._skipped = self._bytes = 0

    @property
    def statistics(self) -> ParserStatistics:
        """The gauges now."""
        return ParserStatistics(
            received=self._received,
            bad_crc=self._bad_crc,
            unknown=self._unknown,
            incompatible=self._incompatible,
            refused=self._refused,
            version_1=self._version_1,
            lost=self._lost,
            late=self._late,
            skipped=self._skipped,
            bytes=self._bytes,
        )

    def feed(self, data: bytes) -> list[Frame]:
        """Take some bytes, whatever they are, and hand out the frames that they complete."""
        self._bytes += len(data)
        return self._scan(self._rest + data if self._rest else data)

    def flush(self) -> list[Frame]:
        """The stream ended or paused: what looks like the beginning of a frame is none."""
        frames: list[Frame] = []
        while self._rest:
            self._skipped += 1
            frames += self._scan(self._rest[1:])
        return frames

    def _scan(self, buffer: bytes) -> list[Frame]:
        frames: list[Frame] = []
        i, end = 0, len(buffer)
        while i < end:
            if buffer[i] != MAGIC:
                i, start = self._other(buffer, i, frames), i
                if i == start:
                    break
                continue
            if end - i < _OVERHEAD:
                break
            codec = _CODECS[buffer[i + 7 : i + 10]]
            if codec is None:
                self._unknown += 1
                self._skipped += 1
                i += 1
                continue
            crc = i + 10 + buffer[i + 1]
            stop = crc + (2 + SIGNATURE_BYTES if buffer[i + 2] & SIGNED else 2)
            if stop > end:
                break
            body = buffer[i + 1 : crc]
            if mcrf4xx(body + codec.crc_extra) != buffer[crc] | buffer[crc + 1] << 8:
                self._bad_crc += 1
                self._skipped += 1
                i += 1
                continue
            if crc - i <= codec.size:  # zeros were left out
                body = body.ljust(codec.size, b"\0")
            frame = Frame(buffer[i:stop], codec, codec.unpack(body))
            i = stop
            if (body[1] or self._verifier is not None) and not self._admits(frame):
                continue
            if body[3] != self._next or body[4] != self._system or body[5] != self._component:
                self._turn(frame)
            else:
                self._next = body[3] + 1 & 0xFF
            frames.append(frame)
        self._received += len(frames)
        self._rest = buffer[i:]
        return frames

    def _other(self, buffer: bytes, i: int, frames: list[Frame]) -> int:
        """Where to go on after a byte that does not begin a frame of MAVLink 2; `i`: it takes more bytes."""
        if buffer[i] != MAGIC_V1:
            found = _MAGIC.search(buffer, i)
            start = found.start() if found else len(buffer)
            self._skipped += start - i
            return start
        if len(buffer) - i < _OVERHEAD_V1:
            return i
        codec = _CODECS[buffer[i + 5 : i + 6] + b"\0\0"]
        if codec is None or buffer[i + 1] > codec.definition.minimum:
            self._unknown += 1
            self._skipped += 1
            return i + 1
        crc = i + 6 + buffer[i + 1]
        if crc + 2 > len(buffer):
            return i
        if mcrf4xx(buffer[i + 1 : crc] + codec.crc_extra) != buffer[crc] | buffer[crc + 1] << 8:
            self._bad_crc += 1
            self._skipped += 1
            return i + 1
        frame = decode_v1(buffer[i : crc + 2], codec)
        if self._admits(frame):
            self._version_1 += 1
            self._turn(frame)
            frames.append(frame)
        return crc + 2

    def _admits(self, frame: Frame) -> bool:
        """Whether an intact frame may be handed out."""
        if frame.flags & ~SIGNED:
            self._incompatible += 1
            return False
        if self._verifier is not None and not self._verifier.verify(frame):
            self._refused += 1
            return False
        return True

    def _turn(self, frame: Frame) -> None:
        """Count gaps where another speaker takes its turn, or the same one's numbers do not follow."""
        if self._next >= 0:
            self._expected[self._system, self._component] = self._next
        self._system, self._component = speaker = frame.system, frame.component
        expected = self._expected.get(speaker, frame.sequence)
        missing = (frame.sequence - expected) & 0xFF
        if missing >= _LATE:
            self._late += 1
            self._next = expected
        else:
            self._lost += missing
            self._next = frame.sequence + 1 & 0xFF
