"""The records that members of a bus exchange: a greeting, and then CAN frames, as bytes. Pure.

::

    greeting   "rtcb", version, greeting or answer (1), id of the channel (4), token (8)
    record     mark, flags, length, 0, identifier (4), timestamp [s] (8), data

All numbers are big-endian. The token is a number that each member draws at random; it distinguishes two
members apart that had the same seat one after the other.
"""

from __future__ import annotations

import struct

import msgspec
from can import Message

VERSION = 2
GREETING_BYTES = 18
LARGEST_RECORD = 80
"""[bytes]"""

_MAGIC = b"rtcb"
_GREETING = struct.Struct(">4sBBIQ")
_RECORD = struct.Struct(">BBBxId")
_MARK = 0xCA
_EXTENDED, _REMOTE, _ERROR, _FD, _SWITCH, _INDICATOR = (1 << bit for bit in range(6))
_LARGEST_STANDARD, _LARGEST_EXTENDED = 0x7FF, 0x1FFFFFFF


class Greeting(msgspec.Struct, frozen=True):
    """The first thing that both ends of a connection say."""

    answer: bool
    """Whether it answers one."""
    channel: int
    """`seats.channel_id` of the sender's channel."""
    token: int
    """Names the sender."""

    def encode(self) -> bytes:
        """As bytes."""
        return _GREETING.pack(_MAGIC, VERSION, self.answer, self.channel, self.token)


def read_greeting(data: bytes) -> Greeting | None:
    """From bytes; None: these are not the words of a member."""
    if len(data) != GREETING_BYTES:
        return None
    magic, version, answer, channel, token = _GREETING.unpack(data)
    if magic != _MAGIC or version != VERSION or answer > 1:
        return None
    return Greeting(bool(answer), channel, token)


def encode(message: Message, timestamp: float) -> bytes:
    """A frame as a record.

    Args:
        message: the frame.
        timestamp: when it is sent, [s] since the epoch.

    Raises:
        ValueError: the frame contradicts itself.
    """
    length, identifier, data = message.dlc, message.arbitration_id, message.data
    flags = (
        (message.is_extended_id and _EXTENDED)
        | (message.is_remote_frame and _REMOTE)
        | (message.is_error_frame and _ERROR)
        | (message.is_fd and _FD)
        | (message.bitrate_switch and _SWITCH)
        | (message.error_state_indicator and _INDICATOR)
    )
    if len(data) != (0 if flags & _REMOTE else length) or not _is_record(_MARK, flags, length, identifier):
        raise ValueError(f"no CAN frame is like this; correct its identifier, length or flags: {message!r}")
    return _RECORD.pack(_MARK, flags, length, identifier, timestamp) + data


class Records:
    """Takes the stream of one connection apart; keeps less than one record between two calls."""

    def __init__(self, channel: str) -> None:
        self._channel = channel
        self._rest = b""
        self.intact = True
        """False: bytes came that are no record. Nothing behind them can be trusted."""

    def feed(self, data: bytes) -> list[Message]:
        """Take some bytes, whatever they are, and hand out the frames that they complete."""
        messages: list[Message] = []
        buffer = self._rest + data if self._rest else data
        i, end = 0, len(buffer)
        while self.intact and end - i >= _RECORD.size:
            mark, flags, length, identifier, timestamp = _RECORD.unpack_from(buffer, i)
            if not _is_record(mark, flags, length, identifier):
                self.intact = False
                break
            start = i + _RECORD.size
            stop = start if flags & _REMOTE else start + length
            if stop > end:
                break
            messages.append(self._message(flags, length, identifier, timestamp, buffer[start:stop]))
            i = stop
        self._rest = buffer[i:] if self.intact else b""
        return messages

    def _message(self, flags: int, length: int, identifier: int, timestamp: float, data: bytes) -> Message:
        return Message(
            timestamp=timestamp,
            arbitration_id=identifier,
            is_extended_id=bool(flags & _EXTENDED),
            is_remote_frame=bool(flags & _REMOTE),
            is_error_frame=bool(flags & _ERROR),
            channel=self._channel,
            dlc=length,
            data=data,
            is_fd=bool(flags & _FD),
            bitrate_switch=bool(flags & _SWITCH),
            error_state_indicator=bool(flags & _INDICATOR),
        )


def _is_record(mark: int, flags: int, length: int, identifier: int) -> bool:
    if mark != _MARK or flags >> 6 or (flags & _FD and flags & _REMOTE):
        return False
    largest = _LARGEST_EXTENDED if flags & _EXTENDED else _LARGEST_STANDARD
    return 0 <= identifier <= largest and 0 <= length <= (64 if flags & _FD else 8)
