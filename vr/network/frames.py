"""What the processes of one machine say to each other, as bytes.

A frame is four bytes of length, little-endian, and as many bytes of MessagePack: an array whose first item
says which of the classes below it is. A process that says anything else is not one of ours, or of another
version: its connection is closed.

Pure: bytes in, frames out.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

import msgspec

VERSION = 1
"""Of these frames. Two processes whose versions differ do not talk; `robotree doctor` names them."""

LONGEST_FRAME = 64 << 20
"""[bytes] A longer one is nonsense: pictures have 10 kB, the source of a virtual robot less."""

_LENGTH = 4


class Channel(IntEnum):
    """Two processes have two connections, so that a stop waits behind nothing that is large or plenty."""

    URGENT = 0
    BULK = 1


class Topic(IntEnum):
    """What a process lets the others know of itself."""

    HOLDS = 0
    """It is present under a key."""
    SERVES = 1
    """It answers requests to a key."""
    HEARS = 2
    """It wants the samples published under a pattern."""


class Hello(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """The first frame on each connection, in both directions."""

    version: int
    member: str
    """Who speaks: the name of its socket in the realm's folder."""
    channel: Channel
    known: dict[Topic, list[str]]
    """All that it lets others know; empty on the bulk channel."""


class News(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """One change of what a process lets others know."""

    topic: Topic
    key: str
    there: bool


class Ask(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """A request."""

    number: int
    """Of the request, among those of the asker."""
    key: str
    latest: float
    """[s] CLOCK_MONOTONIC, which all processes of a machine have in common: when nobody waits any more."""
    body: bytes


class Reply(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """One of the replies to a request."""

    number: int
    body: bytes


class End(msgspec.Struct, frozen=True, array_like=True, tag=4):
    """The last word on a request."""

    number: int


class Sample(msgspec.Struct, frozen=True, array_like=True, tag=5):
    """Something published."""

    key: str
    body: bytes


class Awake(msgspec.Struct, frozen=True, array_like=True, tag=6):
    """Said by a process that has slept: the others need not wait for its next beat."""


Frame = Hello | News | Ask | Reply | End | Sample | Awake

_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[Frame] = msgspec.msgpack.Decoder(Frame)


class NotAFrame(ValueError):
    """What came is no frame."""


def pack(frame: Frame) -> bytes:
    """Return a frame's bytes, its length first."""
    body = _encode(frame)
    return len(body).to_bytes(_LENGTH, "little") + body


class Unpacker:
    """Cuts a stream into frames."""

    def __init__(self) -> None:
        """Begin at the start of a stream."""
        self._rest = bytearray()

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Take the next piece of the stream; read the iterator to its end.

        Yields:
            The frames that are complete now, in their order.

        Raises:
            NotAFrame: what came is none; nothing that follows can be read either.
        """
        self._rest += data
        begin = 0
        try:
            while len(self._rest) - begin >= _LENGTH:
                length = int.from_bytes(self._rest[begin : begin + _LENGTH], "little")
                if length > LONGEST_FRAME:
                    raise NotAFrame(f"a frame of {length} bytes")
                end = begin + _LENGTH + length
                if len(self._rest) < end:
                    return
                body = bytes(self._rest[begin + _LENGTH : end])
                begin = end
                yield _read(body)
        finally:
            del self._rest[:begin]


def _read(body: bytes) -> Frame:
    try:
        return _decoder.decode(body)
    except msgspec.MsgspecError as error:
        raise NotAFrame(str(error)) from None
