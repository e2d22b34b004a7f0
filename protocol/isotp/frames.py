"""The four frames of ISO 15765-2, as values and as the data field of a CAN frame. Pure.

The first half byte is the kind::

    0 L              single frame, L bytes (1 to 7), in a data field of at most 8 bytes
    0 0  LL          single frame, LL bytes, in a longer data field (CAN FD)
    1 LLL            first frame of LLL bytes (up to 4095)
    1 000  LLLLLLLL  first frame of more than 4095 bytes
    2 N              consecutive frame number N modulo 16; the first frame is number 0
    3 S  BS ST       flow control: status, block size, separation time

>>> decode(single(b"hello", 8))
SingleFrame(data=b'hello')
>>> single(b"0123456789", 64).hex(" ")
'00 0a 30 31 32 33 34 35 36 37 38 39'
"""

from __future__ import annotations

from bisect import bisect_left
from enum import IntEnum

import msgspec

CLASSIC = 8
"""[bytes] in the data field of a classic frame, at most."""
FD = 64
"""[bytes] in the data field of a CAN FD frame, at most."""
SIZES = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
"""[bytes] The sizes of a data field, by its length code (ISO 11898-1)."""
PADDING = b"\xcc"
"""Alternating bits, which need no stuff bits on a real bus."""
LARGEST = 4095
"""[bytes] A payload whose length fits the first frame's 12 bits."""

_PADDED = tuple(SIZES[bisect_left(SIZES, size)] for size in range(FD + 1))
_SINGLE, _FIRST, _CONSECUTIVE, _FLOW = range(4)
_ESCAPED_HEADER = 6
"""[bytes] before the data of a first frame whose length needs 32 bits."""


class FlowStatus(IntEnum):
    """The receiver's answer to the first frame, and after each block."""

    CONTINUE = 0
    WAIT = 1
    OVERFLOW = 2


class SingleFrame(msgspec.Struct, frozen=True, gc=False):
    """A whole payload."""

    data: bytes


class FirstFrame(msgspec.Struct, frozen=True, gc=False):
    """The beginning of a longer payload."""

    length: int
    """[bytes] of the whole payload."""
    data: bytes


class ConsecutiveFrame(msgspec.Struct, frozen=True, gc=False):
    """The next piece of a payload, perhaps with padding behind it."""

    number: int
    """0 to 15."""
    data: bytes


class FlowControl(msgspec.Struct, frozen=True, gc=False):
    """The receiver's leave to go on."""

    status: int
    """A `FlowStatus`, or a number that the standard reserves."""
    block_size: int = 0
    """Consecutive frames until the next flow control; 0: all of them."""
    separation: float = 0.0
    """[s] between two consecutive frames, at least."""


Pci = SingleFrame | FirstFrame | ConsecutiveFrame | FlowControl
"""The content of a data field (protocol control information, and the data with it)."""


def pad(data: bytes) -> bytes:
    """Lengthen a data field to the next size that CAN FD can carry; up to 8 bytes every size can be."""
    return data.ljust(_PADDED[len(data)], PADDING)


def largest_single(width: int) -> int:
    """[bytes] that a single frame carries in a data field of at most `width` bytes."""
    return width - 1 if width <= CLASSIC else width - 2


def single(payload: bytes, width: int) -> bytes:
    """The data field of a single frame; `payload` has 1 to `largest_single(width)` bytes."""
    if len(payload) < CLASSIC:
        return bytes((len(payload),)) + payload
    return pad(bytes((0, len(payload))) + payload[: width - 2])


def first(payload: bytes, width: int) -> bytes:
    """The data field of the first frame; it is always full."""
    head = (_FIRST << 12 | len(payload)).to_bytes(2, "big")
    return head + payload[: width - 2]


def consecutive(number: int, piece: bytes) -> bytes:
    """The data field of a consecutive frame."""
    return pad(bytes((_CONSECUTIVE << 4 | number & 0xF,)) + piece)


def flow_control(control: FlowControl) -> bytes:
    """The data field of a flow control."""
    return bytes((_FLOW << 4 | control.status, control.block_size, encode_separation(control.separation)))


def is_flow_control(field: bytes) -> bool:
    """Whether a data field of ours is a flow control."""
    return field[0] >> 4 == _FLOW


def encode_separation(seconds: float) -> int:
    """Separation time as its byte, rounded up: whole milliseconds to 127, or 100 to 900 microseconds."""
    microseconds = round(seconds * 1e6)
    if microseconds <= 0:
        return 0
    if microseconds <= 900:
        return 0xF0 + -(-microseconds // 100)
    return min(-(-microseconds // 1000), 0x7F)


def decode_separation(code: int) -> float:
    """Separation time in seconds; reserved codes mean the longest one, as the standard says."""
    if code <= 0x7F:
        return code / 1e3
    return (code - 0xF0) / 1e4 if 0xF1 <= code <= 0xF9 else 0.127


def decode(field: bytes) -> Pci | None:
    """Decode a data field; None: nothing that the standard allows. Never raises."""
    if not field:
        return None
    kind, low = field[0] >> 4, field[0] & 0xF
    if kind == _CONSECUTIVE:
        return ConsecutiveFrame(low, field[1:]) if len(field) > 1 else None
    if kind == _SINGLE:
        return _decode_single(field, low)
    if kind == _FIRST:
        return _decode_first(field, low)
    if kind == _FLOW and len(field) >= 3:
        return FlowControl(low, field[1], decode_separation(field[2]))
    return None


def _decode_single(field: bytes, low: int) -> SingleFrame | None:
    if len(field) <= CLASSIC:
        return SingleFrame(field[1 : 1 + low]) if 0 < low < len(field) else None
    length = field[1]
    if low or not CLASSIC <= length <= len(field) - 2:
        return None
    return SingleFrame(field[2 : 2 + length])


def _decode_first(field: bytes, low: int) -> FirstFrame | None:
    if len(field) < CLASSIC:
        return None
    if length := low << 8 | field[1]:
        return FirstFrame(length, field[2:]) if length > largest_single(len(field)) else None
    length = int.from_bytes(field[2:_ESCAPED_HEADER], "big")
    return FirstFrame(length, field[_ESCAPED_HEADER:]) if length > LARGEST else None
