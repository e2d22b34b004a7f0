"""From a stream of bytes to frames. No input raises an error; bytes that are no frame are counted.

After a bad checksum or an unknown id the parser steps one byte, never the length that the broken frame
claims: that is what loses no intact frame behind it.
"""

from __future__ import annotations

import re
import struct
from copy import copy
from typing import Protocol

import msgspec
from fastcrc.crc16 import mcrf4xx

from robotree.protocol.codec import MAGIC, SIGNED
from robotree.protocol.frame import (
    CRC_START,
    CRC_START_V1,
    HEADER_BYTES,
    HEADER_BYTES_V1,
    MAGIC_V1,
    PROOF_BYTES,
    SIGNATURE_BYTES,
    Frame,
)
from robotree.protocol.messages.base import CODECS

_OVERHEAD = 12
"""[bytes] of an unsigned frame around its payload."""
_OVERHEAD_V1 = 8
_HEADER = struct.Struct("<BBBxBH3s").unpack_from
"""Magic, length, incompatibility flags, sequence, system and component as one number, id."""
_CHECKSUM = struct.Struct("<H").unpack_from
_MAGICS = (MAGIC, MAGIC_V1)
_MAGIC = re.compile(rb"[\xfd\xfe]")
_LATE = 128
"""A sequence number this far ahead is an old frame that was overtaken, not a gap."""


class Verifier(Protocol):
    """Decides whether a frame with a good checksum may pass."""

    def verify(self, frame: Frame, said: bytes) -> bool:
        """Whether to hand a frame out; an unsigned one is asked for as well.

        Args:
            frame: an intact frame.
            said: what a signature is about: all bytes of the frame but the last six.
        """
        ...


class ParserStatistics(msgspec.Struct):
    """One reading of a parser's gauges."""

    received: int = 0
    """Frames handed out."""
    bad_crc: int = 0
    """Places that began like a frame and had a wrong checksum."""
    unknown: int = 0
    """Places that began like a frame with an id that the dialect does not have."""
    incompatible: int = 0
    """Intact frames with a flag that we do not understand."""
    refused: int = 0
    """Intact frames that the verifier refused."""
    version_1: int = 0
    """Frames of MAVLink 1 among the received ones."""
    lost: int = 0
    """Frames that never came, by the gaps in the sequence numbers; those with an unknown id have come."""
    late: int = 0
    """Frames that came twice or out of order."""
    skipped: int = 0
    """[bytes] that belong to no intact frame."""
    bytes: int = 0
    """[bytes] fed."""


class Parser:
    """One per incoming stream. Keeps less than one frame between two calls.

    Args:
        verifier: asked about every intact frame; None: all pass, signed or not.
    """

    def __init__(self, verifier: Verifier | None = None) -> None:
        self.verifier = verifier
        """Asked from the next call on, if another one is put here."""
        self._rest = b""
        self._speaker = self._next = self._after_late = -1
        self._expected: dict[int, int] = {}
        self._gauges = ParserStatistics()

    @property
    def statistics(self) -> ParserStatistics:
        """The gauges now."""
        return copy(self._gauges)

    def feed(self, data: bytes) -> list[Frame]:
        """Take some bytes, whatever they are, and hand out the frames that they complete."""
        self._gauges.bytes += len(data)
        return self._scan(self._rest + data if self._rest else data)

    def flush(self) -> list[Frame]:
        """The stream ended or paused: what looks like the beginning of a frame is none."""
        frames: list[Frame] = []
        while self._rest:
            self._gauges.skipped += 1
            frames += self._scan(self._rest[1:])
        return frames

    def _scan(self, buffer: bytes) -> list[Frame]:
        frames: list[Frame] = []
        i, before = self._run(buffer, 0, frames), -1
        while before != i < len(buffer):
            before = i
            i = self._run(buffer, self._pass(buffer, i, frames), frames)
        self._gauges.received += len(frames)
        self._rest = buffer[i:]
        return frames

    def _run(self, buffer: bytes, i: int, frames: list[Frame]) -> int:
        """Take the consecutive frames of MAVLink 2 from `i` on; returns where they end."""
        end, take = len(buffer), frames.append
        verify = None if self.verifier is None else self.verifier.verify
        last_speaker, expected = self._speaker, self._next
        while i + _OVERHEAD <= end:
            magic, length, flags, sequence, speaker, key = _HEADER(buffer, i)
            codec = CODECS[key]
            if magic != MAGIC or codec is None:
                break
            crc = i + HEADER_BYTES + length
            stop = crc + 2 + SIGNATURE_BYTES if flags & SIGNED else crc + 2
            if stop > end:
                break
            body = buffer[i:crc]
            (checksum,) = _CHECKSUM(buffer, crc)
            if mcrf4xx(body + codec.crc_extra, CRC_START) != checksum:
                break
            start, i = i, stop
            if flags:
                frame = Frame(body, codec, checksum, buffer[crc + 2 : stop])
                if flags != SIGNED:
                    self._gauges.incompatible += 1
                    continue
            else:
                frame = Frame(body, codec, checksum)
            if verify is not None and not verify(frame, buffer[start : stop - PROOF_BYTES]):
                self._gauges.refused += 1
                continue
            if sequence == expected and speaker == last_speaker:
                expected = sequence + 1 & 0xFF
            else:
                self._next = expected
                self._turn(speaker, sequence)
                last_speaker, expected = speaker, self._next
            take(frame)
        self._next = expected
        return i

    def _pass(self, buffer: bytes, i: int, frames: list[Frame]) -> int:
        """Get past what is no intact frame of MAVLink 2; `i`: it takes more bytes to tell."""
        left = len(buffer) - i
        if not left:
            return i
        if buffer[i] == MAGIC_V1:
            return self._version_1_frame(buffer, i, frames)
        if buffer[i] != MAGIC:
            found = _MAGIC.search(buffer, i)
            start = found.start() if found else len(buffer)
            self._gauges.skipped += start - i
            return start
        if left < _OVERHEAD:
            return i
        signature = SIGNATURE_BYTES if buffer[i + 2] & SIGNED else 0
        if CODECS[buffer[i + 7 : i + 10]] is None:
            _, _, _, sequence, speaker, _ = _HEADER(buffer, i)
            self._pass_by(buffer, i + _OVERHEAD + buffer[i + 1] + signature, speaker, sequence)
            return self._step(i, unknown=True)
        return i if left < _OVERHEAD + buffer[i + 1] + signature else self._step(i)

    def _version_1_frame(self, buffer: bytes, i: int, frames: list[Frame]) -> int:
        if len(buffer) - i < _OVERHEAD_V1:
            return i
        codec = CODECS[buffer[i + 5 : i + 6] + b"\0\0"]
        if codec is None or buffer[i + 1] > codec.length:
            speaker = buffer[i + 3] | buffer[i + 4] << 8
            self._pass_by(buffer, i + _OVERHEAD_V1 + buffer[i + 1], speaker, buffer[i + 2])
            return self._step(i, unknown=True)
        crc = i + HEADER_BYTES_V1 + buffer[i + 1]
        if crc + 2 > len(buffer):
            return i
        body, (checksum,) = buffer[i:crc], _CHECKSUM(buffer, crc)
        if mcrf4xx(body + codec.crc_extra, CRC_START_V1) != checksum:
            return self._step(i)
        frame = Frame(body, codec, checksum)
        if self.verifier is not None and not self.verifier.verify(frame, b""):
            self._gauges.refused += 1
            return crc + 2
        self._gauges.version_1 += 1
        self._turn(frame.system | frame.component << 8, frame.sequence)
        frames.append(frame)
        return crc + 2

    def _pass_by(self, buffer: bytes, end: int, speaker: int, sequence: int) -> None:
        """Count the number of what may be a frame with an id that we do not know: nothing is missing there.

        It cannot be checked, so it counts only if its speaker was heard and if a frame or nothing follows.
        """
        heard = speaker == self._speaker or speaker in self._expected
        if heard and (end >= len(buffer) or buffer[end] in _MAGICS):
            self._turn(speaker, sequence)

    def _step(self, i: int, *, unknown: bool = False) -> int:
        """Skip one byte: these bytes are no frame."""
        self._gauges.skipped += 1
        if unknown:
            self._gauges.unknown += 1
        else:
            self._gauges.bad_crc += 1
        return i + 1

    def _turn(self, speaker: int, sequence: int) -> None:
        """Count gaps where another speaker takes its turn, or the same one's numbers do not follow.

        Two late frames that follow each other are no late ones: the speaker began to count anew.
        """
        if self._next >= 0:
            self._expected[self._speaker] = self._next
        self._speaker = speaker
        expected = self._expected.get(speaker, sequence)
        missing = (sequence - expected) & 0xFF
        follows = sequence + 1 & 0xFF
        if missing < _LATE:
            self._gauges.lost += missing
            self._next = follows
        else:
            self._gauges.late += 1
            self._next = follows if self._after_late == sequence else expected
            self._after_late = follows
