"""How much of a bad stream the parser saves, and what ten million bytes of chance do to it."""

from __future__ import annotations

import random
from typing import NamedTuple

from bench.wire.codec import messages
from robotree.protocol import Parser
from robotree.protocol.frame import encode

BURST = 40
"""[bytes] of a noise burst."""
PIECE = 64 * 1024
"""[bytes]"""


class Recovery(NamedTuple):
    """The frames that were found in a damaged stream."""

    intact: int
    """Frames that were sent whole."""
    found: int
    """Those among them that were handed out."""
    invented: int
    """Frames that were handed out and never sent."""


def recovery(frames: int = 10_000, share: float = 0.1, seed: int = 0) -> Recovery:
    """Read a stream in which a share of the frames is corrupted and a share of the bytes is noise."""
    chance, stream, intact = random.Random(seed), list[bytes](), list[bytes]()
    every = messages()
    for number in range(frames):
        raw = encode(chance.choice(every), sequence=number, system=1, component=1)
        if chance.random() < share:
            place = chance.randrange(len(raw))
            raw = raw[:place] + bytes((raw[place] ^ chance.randint(1, 255),)) + raw[place + 1 :]
        else:
            intact.append(raw)
        stream.append(raw)
        if chance.random() < share * len(raw) / BURST:
            stream.append(chance.randbytes(BURST))
    parser = Parser()
    found = [frame.raw for frame in [*parser.feed(b"".join(stream)), *parser.flush()]]
    sent, handed = set(intact), set(found)
    return Recovery(len(intact), sum(raw in handed for raw in intact), sum(raw not in sent for raw in found))


def chance_bytes(count: int = 10_000_000, seed: int = 0) -> int:
    """Feed bytes of chance, and hand back how many of them were accounted for."""
    chance, parser, size = random.Random(seed), Parser(), 0
    for begin in range(0, count, PIECE):
        frames = parser.feed(chance.randbytes(min(PIECE, count - begin)))
        size += sum(len(frame.raw) for frame in frames)
    size += sum(len(frame.raw) for frame in parser.flush())
    return size + parser.statistics.skipped
