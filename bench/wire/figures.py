"""The promises of the wire, each with what measures it."""

from __future__ import annotations

import asyncio
import random
from typing import TYPE_CHECKING, NamedTuple

from bench.wire.codec import messages
from robotree.protocol import Parser
from robotree.protocol.frame import encode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


class Promise(NamedTuple):
    """A promised figure."""

    name: str
    bound: float
    at_least: bool
    """Whether the bound is the least that is allowed, not the most."""
    unit: str = "x"


class Figure(NamedTuple):
    """A measured figure."""

    promise: Promise
    value: float
    detail: str = ""

    @property
    def kept(self) -> bool:
        """Whether the promise holds here and now."""
        promise = self.promise
        return self.value >= promise.bound if promise.at_least else self.value <= promise.bound


CODEC = {
    "encode": Promise("encode, beside pymavlink", 3.5, at_least=True),
    "decode to frames": Promise("decode, beside pymavlink", 7.0, at_least=True),
    "encode signed": Promise("encode signed, beside pymavlink", 2.5, at_least=True),
    "decode signed to frames": Promise("decode signed, beside pymavlink", 3.5, at_least=True),
}
IDENTICAL = Promise("bytes identical to pymavlink's", 100.0, at_least=True, unit="% of frames")
TCP = Promise("PING over TCP, beside a bare echo", 1.5, at_least=False)
CAN_FD = Promise("PING over CAN FD, beside a bare echo", 3.0, at_least=False)
RECOVERED = Promise("intact frames found in a bad stream", 100.0, at_least=True, unit="% of frames")
CHANCE = Promise("bytes of chance accounted for", 10_000_000, at_least=True, unit="bytes")


def codec(rounds: int = 60) -> Iterable[Figure]:
    """Speed on a telemetry message of 40 bytes, and identity on all messages."""
    from bench.wire import codec as contest
    from robotree.protocol.testing import check_codec

    mavgen = contest.generate()
    for signed in (False, True):
        for each in contest.contests(contest.telemetry_40(), mavgen, signed=signed):
            if each.name in CODEC:
                outcome = contest.compare(each, rounds)
                detail = f"{outcome.ours:.2f} us, pymavlink {outcome.theirs:.2f} us"
                if not outcome.sure:
                    typical = f"mostly {outcome.ours_typical:.2f} us and {outcome.theirs_typical:.2f} us"
                    detail += f" at best, {typical}; unsure, for the machine is busy: measure again"
                yield Figure(CODEC[each.name], outcome.ratio, detail)
    try:
        count = check_codec(contest.encoder(mavgen))
    except AssertionError as difference:
        yield Figure(IDENTICAL, 0.0, str(difference)[:200])
    else:
        yield Figure(IDENTICAL, 100.0, f"{count} frames of {len(mavgen.mavlink_map)} messages")


def round_trips(rounds: int = 500) -> Iterable[Figure]:
    """Round trips between two processes, one at a time; for comparison 50 of them back to back."""
    from bench.wire.round_trips import compare

    bare, tcp, fd, classic = asyncio.run(compare(rounds))
    _, tcp_50, fd_50, _ = asyncio.run(compare(rounds // 50, turn=50))
    aside = f"; classic CAN {classic.median * 1e6:.0f} us, {classic.ratio:.1f} x"
    for promise, way, turned, also in ((TCP, tcp, tcp_50, ""), (CAN_FD, fd, fd_50, aside)):
        low, high = way.usual
        detail = f"{way.median * 1e6:.0f} us, bare echo {bare.median * 1e6:.0f} us"
        detail += f"; half of the rounds {low:.2f} to {high:.2f}; back to back {turned.ratio:.2f}"
        yield Figure(promise, way.ratio, detail + also)


def noise() -> Iterable[Figure]:
    """Bad streams."""
    saved = recovery()
    share = 100.0 * saved.found / saved.intact if not saved.invented else 0.0
    detail = f"{saved.found} of {saved.intact}; 10 % of frames corrupted, 10 % noise"
    yield Figure(RECOVERED, share, detail)
    yield Figure(CHANCE, chance_bytes(), "nothing was raised")


FIGURES: dict[str, Callable[[], Iterable[Figure]]] = {
    "codec": codec,
    "trips": round_trips,
    "noise": noise,
}
"""Every measurement, by the name of its part."""


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
