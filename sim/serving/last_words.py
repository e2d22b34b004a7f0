"""What is heard of bytes that nobody has parsed when their link ends: the stops in them.

To parse all of them would let a client have much more than its share parsed, by going and coming again. So
only what has the id of a message that may ask for a stop, where a frame has it, is looked at, newest first.
Pure.
"""

import re
from collections.abc import Iterator
from typing import Final

from robotree.protocol.codec import MAGIC, SIGNED
from robotree.protocol.frame import HEADER_BYTES, HEADER_BYTES_V1, SIGNATURE_BYTES
from robotree.protocol.messages import CommandInt, CommandLong, SetMode
from robotree.protocol.parser import Parser
from robotree.sim.firmware.stops import stop_asked_by

LONGEST: Final = HEADER_BYTES + 255 + 2 + SIGNATURE_BYTES
"""[bytes] of the longest frame."""
_IDS: Final = [kind.codec.definition.id for kind in (SetMode, CommandLong, CommandInt)]
"""Of the messages that may ask for a stop."""


def _any(width: int) -> bytes:
    """A pattern for any of the ids, in so many bytes."""
    return b"|".join(re.escape(each.to_bytes(width, "little")) for each in _IDS if each < 256**width)


_PLACES: Final = re.compile(rb"\xfd(?=.{6}(?:%b))|\xfe(?=.{4}(?:%b))" % (_any(3), _any(1)), re.DOTALL)
"""Where a frame of one of these kinds may begin."""


def last_words(data: bytes, most: int) -> bytes:
    """What to hand to a parser in place of what waited.

    Args:
        data: that waited; the parser may have the beginning of its first frame.
        most: [bytes] that it may be, three times `LONGEST` at least.

    Returns:
        What completes that first frame, the newest stops, and zeros for which the parser waits for nothing.
    """
    left, stops = most - 2 * LONGEST, list[bytes]()
    for candidate in _candidates(data):
        left -= len(candidate)
        if left < 0:
            break
        frames = Parser().feed(candidate)
        if frames and stop_asked_by(frames[0].message):
            stops.append(candidate)
    return b"".join((data[:LONGEST], *reversed(stops), bytes(LONGEST)))


def _candidates(data: bytes) -> Iterator[bytes]:
    """What may be frames that ask for a stop, newest first; not those that are in the beginning anyway."""
    for place in reversed([match.start() for match in _PLACES.finditer(data)]):
        if data[place] == MAGIC:
            signature = SIGNATURE_BYTES if data[place + 2] & SIGNED else 0
            end = place + HEADER_BYTES + data[place + 1] + 2 + signature
        else:
            end = place + HEADER_BYTES_V1 + data[place + 1] + 2
        if LONGEST < end <= len(data):
            yield data[place:end]
