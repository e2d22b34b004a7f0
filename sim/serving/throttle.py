"""Reads no more than a share of what each client sends, so that a flood slows the flooder and not the arm.

Parsing takes the interpreter from the physics thread: 350 000 frames per second, which one client can send,
left the arm with 44 % of its real-time rate. So the bytes of a link are parsed in small pieces, and beyond
its allowance (a token bucket) they wait: a stream is not read until then, of datagrams the excess is dropped
and counted. The first burst of a new link comes from a store that all links share, so that a client gains
nothing by connecting again and again.

Bytes that wait when their link ends are dropped, except for the stops in them. To parse all of the bytes
would give a client more than its share of processor time, if it connects again and again. So only places that
look like a message which may ask for a stop are parsed, newest first.
"""

import asyncio
import re
from collections.abc import Callable, Iterator
from typing import Final, Protocol

from robotree.protocol.codec import MAGIC, SIGNED
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import HEADER_BYTES, HEADER_BYTES_V1, SIGNATURE_BYTES
from robotree.protocol.links.link import Link, Pausable
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


TOTAL: Final = 512 * 1024.0
"""[bytes/s] that all links together may bring for long."""
BURST: Final = 64 * 1024.0
"""[bytes] that a link may bring at once; a new link only if the store has them."""
STORE: Final = 8 * BURST
"""[bytes] that new links together may bring at once."""
RESTOCK: Final = BURST
"""[bytes/s] that the store grows again; beside `TOTAL` it is little."""
PIECE: Final = 4 * 1024
"""[bytes] that are parsed in one go: about 200 frames, half a millisecond."""
LARGEST_BACKLOG: Final = 512 * 1024
"""[bytes] that wait to be parsed; streams are not read meanwhile, of datagrams the excess is lost."""
KEPT: Final = 0.1
"""[s] after a link is read again in which what the system had kept of it has come."""


class TokenBucket:
    """A token bucket; `now` comes from the caller.

    Args:
        burst: that may be spent at once.
        now: the clock [s].
        credit: that there is at the beginning; None: a whole burst.
    """

    def __init__(self, burst: float, now: float, credit: float | None = None) -> None:
        self._burst, self._since = burst, now
        self._credit = burst if credit is None else credit

    def wait(self, rate: float, now: float) -> float:
        """How long to wait before more may be spent [s], at a `rate` [1/s] at which credit grows."""
        self._credit = min(self._credit + rate * (now - self._since), self._burst)
        self._since = now
        return max(-self._credit / rate, 0.0)

    def take(self, most: float, rate: float, now: float) -> float:
        """Spend at most so much at once, and no more than there is; returns how much."""
        self.wait(rate, now)
        taken = max(min(most, self._credit), 0.0)
        self.spend(taken)
        return taken

    def spend(self, amount: float) -> None:
        """Spend; the last piece may be more than there is."""
        self._credit -= amount


class Receiver(Protocol):
    """Takes the bytes of a link, and the number of stops when they began to wait."""

    def received(self, data: bytes, stops: int | None) -> None:
        """Bytes came.

        Args:
            data: as much as may be parsed in one go.
            stops: how many stops had arrived when they began to wait; None: they did not.
        """

    def closed(self, reason: LinkError) -> None:
        """The link has ended."""


class Throttled:
    """Stands between a link and its hearer.

    Bytes that wait here, or in the system's buffers while the link is not read, may be older than a stop from
    another link. So they are handed on with the number of stops at the time when the link began to lag, until
    the system's buffers have been read, too.

    Args:
        link: whose bytes.
        hearer: takes them.
        share: [bytes/s] that the link may bring for long, now.
        stops: how many stops have arrived, now.
        lose: called each time that something was dropped.
        burst: [bytes] that it may bring at once in the beginning; one piece is always parsed.
    """

    def __init__(
        self,
        link: Link,
        receiver: Receiver,
        share: Callable[[], float],
        stops: Callable[[], int],
        lose: Callable[[], None],
        burst: float = BURST,
    ) -> None:
        self._link, self._receiver, self._share, self._stops, self._lose = link, receiver, share, stops, lose
        self._loop = asyncio.get_running_loop()
        self._bucket = TokenBucket(BURST, self._loop.time(), burst)
        self._backlog = b""
        self._later: asyncio.TimerHandle | None = None
        self._lagging: int | None = None
        self._caught_up = 0.0
        self._over = False

    def received(self, data: bytes) -> None:
        """Bytes came over the link."""
        if self._later is None:
            if self._loop.time() > self._caught_up + KEPT:
                self._lagging = None
            self._backlog = data
            self._feed()
        elif len(self._backlog) + len(data) <= LARGEST_BACKLOG:
            self._backlog += data
        else:
            self._lose()

    def closed(self, reason: LinkError) -> None:
        """The link has ended; a stop among the waiting bytes is still obeyed."""
        self._over = True
        if self._later is not None:
            self._later.cancel()
        data, self._backlog = self._backlog, b""
        if data:
            self._receiver.received(stops_in(data, PIECE), self._lagging)
        if len(data) > LONGEST_FRAME:
            self._lose()
        self._receiver.closed(reason)

    def _feed(self) -> None:
        while self._backlog:  # empty, too, when the link has ended because of what its hearer answered
            wait = self._bucket.wait(self._share(), self._loop.time())
            if wait > 0.0:
                if self._lagging is None:
                    self._lagging = self._stops()
                self._later = self._loop.call_later(wait, self._go_on)
                if isinstance(self._link, Pausable):
                    self._link.pause_reading()
                return
            piece, self._backlog = self._backlog[:PIECE], self._backlog[PIECE:]
            self._bucket.spend(len(piece))
            self._receiver.received(piece, self._lagging)

    def _go_on(self) -> None:
        self._later = None
        self._feed()
        if self._later is None and not self._over:
            self._caught_up = self._loop.time()
            if isinstance(self._link, Pausable):
                self._link.resume_reading()
