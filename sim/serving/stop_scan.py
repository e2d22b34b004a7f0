"""The stops among bytes that nobody has parsed when their link ends.

To parse all of the bytes would give a client more than its share of processor time, if it connects again and
again. So only places that look like a message which may ask for a stop are parsed, newest first. Pure.
"""

import re
from collections.abc import Iterator
from typing import Final

from robotree.protocol.codec import MAGIC, SIGNED
from robotree.protocol.frame import HEADER_BYTES, HEADER_BYTES_V1, SIGNATURE_BYTES
from robotree.protocol.messages import CommandInt, CommandLong, SetMode
from robotree.protocol.parser import Parser
from robotree.sim.firmware.stops import stop_asked_by

LONGEST_FRAME: Final = HEADER_BYTES + 255 + 2 + SIGNATURE_BYTES
"""[bytes] of the longest frame."""
_IDS: Final = [kind.codec.definition.id for kind in (SetMode, CommandLong, CommandInt)]
"""Of the messages that may ask for a stop."""


def _any(width: int) -> bytes:
    """A pattern for any of the ids, in so many bytes."""
    return b"|".join(re.escape(each.to_bytes(width, "little")) for each in _IDS if each < 256**width)


_PLACES: Final = re.compile(rb"\xfd(?=.{6}(?:%b))|\xfe(?=.{4}(?:%b))" % (_any(3), _any(1)), re.DOTALL)
"""Where a frame of one of these kinds may begin."""


def stops_in(data: bytes, most: int) -> bytes:
    """Reduce waiting bytes to what a parser needs to find the stops in them.

    Args:
        data: the waiting bytes; the parser may have the beginning of their first frame.
        most: [bytes] to return, at least three times `LONGEST_FRAME` at least.

    Returns:
        The rest of that first frame, the newest stops, and zeros, so that the parser waits for nothing more.
    """
    left, stops = most - 2 * LONGEST_FRAME, list[bytes]()
    for candidate in _candidates(data):
        left -= len(candidate)
        if left < 0:
            break
        frames = Parser().feed(candidate)
        if frames and stop_asked_by(frames[0].message):
            stops.append(candidate)
    return b"".join((data[:LONGEST_FRAME], *reversed(stops), bytes(LONGEST_FRAME)))


def _candidates(data: bytes) -> Iterator[bytes]:
    """Possible frames that ask for a stop, newest first; without those in the first LONGEST_FRAME bytes."""
    for place in reversed([match.start() for match in _PLACES.finditer(data)]):
        if data[place] == MAGIC:
            signature = SIGNATURE_BYTES if data[place + 2] & SIGNED else 0
            end = place + HEADER_BYTES + data[place + 1] + 2 + signature
        else:
            end = place + HEADER_BYTES_V1 + data[place + 1] + 2
        if LONGEST_FRAME < end <= len(data):
            yield data[place:end]
