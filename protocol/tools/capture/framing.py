"""Where frames lie in bytes, also frames of messages that our dialect does not have. Pure.

The parser returns only frames that it has checked. A recording, or a relay, must pass on what it does not
understand as well: a frame of an unknown message cannot be checked, but it says how long it is.
"""

from __future__ import annotations

import re

import msgspec
from fastcrc.crc16 import mcrf4xx

from robotree.protocol.codec import MAGIC, SIGNED
from robotree.protocol.dialect.table import definitions
from robotree.protocol.frame import (
    CRC_START,
    CRC_START_V1,
    HEADER_BYTES,
    HEADER_BYTES_V1,
    MAGIC_V1,
    SIGNATURE_BYTES,
)

MAGICS = (MAGIC, MAGIC_V1)
find_magic = re.compile(rb"[\xfd\xfe]").search
INCOMPLETE = -1


def claimed_size(buffer: bytes, i: int) -> int:
    """[bytes] that the frame at `i` claims to have; 0: none begins there; INCOMPLETE: more is needed."""
    if i + 3 > len(buffer):
        return 0 if i < len(buffer) and buffer[i] not in MAGICS else INCOMPLETE
    if buffer[i] == MAGIC:
        return HEADER_BYTES + buffer[i + 1] + 2 + (SIGNATURE_BYTES if buffer[i + 2] & SIGNED else 0)
    return HEADER_BYTES_V1 + buffer[i + 1] + 2 if buffer[i] == MAGIC_V1 else 0


def known(raw: bytes) -> bool:
    """Whether the dialect has the message of a frame."""
    return msgid(raw) in definitions()


def intact(raw: bytes) -> bool:
    """Whether a whole frame is of a known message and its checksum is right."""
    definition = definitions().get(msgid(raw))
    if definition is None:
        return False
    header, start = (HEADER_BYTES, CRC_START) if raw[0] == MAGIC else (HEADER_BYTES_V1, CRC_START_V1)
    if raw[0] == MAGIC_V1 and raw[1] > definition.length:
        return False
    end = header + raw[1]
    checksum = int.from_bytes(raw[end : end + 2], "little")
    return mcrf4xx(raw[:end] + bytes((definition.crc_extra,)), start) == checksum


def msgid(raw: bytes) -> int:
    """The id of a frame's message."""
    return int.from_bytes(raw[7:10], "little") if raw[0] == MAGIC else raw[5]


class Piece(msgspec.Struct, frozen=True, gc=False):
    """A part of a stream; all pieces together are the stream."""

    data: bytes
    framed: bool
    """Whether it is a frame: an intact one, or one of an unknown message where a frame may be."""


class Splitter:
    """Cuts a stream at its frames and loses nothing. Keeps less than one frame between two calls."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Piece]:
        """Take some bytes and hand out the pieces that are complete."""
        buffer = self._rest + data
        pieces, i, noise = list[Piece](), 0, 0
        while i < len(buffer):
            size = self._frame(buffer, i)
            if size == INCOMPLETE:
                break
            if size:
                pieces += self._noise(buffer[noise:i])
                pieces.append(Piece(buffer[i : i + size], framed=True))
                i = noise = i + size
            else:
                found = find_magic(buffer, i + 1)
                i = found.start() if found else len(buffer)
        pieces += self._noise(buffer[noise:i])
        self._rest = buffer[i:]
        return pieces

    def flush(self) -> list[Piece]:
        """The stream ended or paused: hand out the rest."""
        rest, self._rest = self._rest, b""
        return self._noise(rest)

    @staticmethod
    def _noise(data: bytes) -> list[Piece]:
        return [Piece(data, framed=False)] if data else []

    @staticmethod
    def _frame(buffer: bytes, i: int) -> int:
        """The size of the frame at `i`; 0: there is none; INCOMPLETE: it takes more bytes to tell."""
        size = claimed_size(buffer, i)
        if size <= 0:
            return size
        end = i + size
        if end > len(buffer):
            return INCOMPLETE
        raw = buffer[i:end]
        if intact(raw):
            return size
        followed = end == len(buffer) or buffer[end] in MAGICS
        return size if followed and not known(raw) else 0
