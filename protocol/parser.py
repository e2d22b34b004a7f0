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
from robotree.protocol.frame import MAGIC, MAGIC_V1, SIGNATURE_BYTES, SIGNED, Frame, decode, decode_v1
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
        self._expected: dict[int, int] = {}
        self._received = self._bad_crc = self._unknown = self._incompatible = self._refused = 0
        self._version_1 = self._lost = self._late = self._framed = self._bytes = 0

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
            skipped=self._bytes - self._framed - len(self._rest),
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
                i += 1
                continue
            crc = i + 10 + buffer[i + 1]
            stop = crc + (2 + SIGNATURE_BYTES if buffer[i + 2] & SIGNED else 2)
            if stop > end:
                break
            if mcrf4xx(buffer[i + 1 : crc] + codec.crc_extra) != buffer[crc] | buffer[crc + 1] << 8:
                self._bad_crc += 1
                i += 1
                continue
            if buffer[i + 2] & ~SIGNED:
                self._incompatible += 1
            else:
                self._take(decode(buffer[i:stop], codec), frames)
            self._framed += stop - i
            i = stop
        self._rest = buffer[i:]
        return frames

    def _take(self, frame: Frame, frames: list[Frame]) -> None:
        """Hand out an intact frame, unless the verifier objects."""
        if self._verifier is not None and not self._verifier.verify(frame):
            self._refused += 1
            return
        self._received += 1
        sender, sequence = frame.system << 8 | frame.component, frame.sequence
        if (missing := (sequence - self._expected.get(sender, sequence)) & 0xFF) >= _LATE:
            self._late += 1
        else:
            self._lost += missing
            self._expected[sender] = sequence + 1
        frames.append(frame)

    def _other(self, buffer: bytes, i: int, frames: list[Frame]) -> int:
        """Where to go on after a byte that does not begin a frame of MAVLink 2; `i`: it takes more bytes."""
        if buffer[i] != MAGIC_V1:
            found = _MAGIC.search(buffer, i)
            return found.start() if found else len(buffer)
        if len(buffer) - i < _OVERHEAD_V1:
            return i
        codec = _CODECS[buffer[i + 5 : i + 6] + b"\0\0"]
        if codec is None or buffer[i + 1] > codec.definition.minimum:
            self._unknown += 1
            return i + 1
        crc = i + 6 + buffer[i + 1]
        if crc + 2 > len(buffer):
            return i
        if mcrf4xx(buffer[i + 1 : crc] + codec.crc_extra) != buffer[crc] | buffer[crc + 1] << 8:
            self._bad_crc += 1
            return i + 1
        self._version_1 += 1
        self._take(decode_v1(buffer[i : crc + 2], codec), frames)
        self._framed += crc + 2 - i
        return crc + 2
