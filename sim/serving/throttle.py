"""Not reading more than a share of what clients send, so that a flood costs the flooder and not the arm.

Parsing takes the interpreter from the thread of the physics: 350 000 frames in a second, as one client can
send, left the arm with 44 % of its real-time rate. So what a link brings is parsed in small pieces, and
beyond its allowance it waits: on a stream the client is not read until then, of datagrams the excess is lost
and counted. What waits when its link ends is lost, too, but for the stops in it. What a new link may bring at
once comes from a store that all share, so that nobody has more of it by coming again and again.
"""

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link, Pausable
from robotree.sim.serving.allowance import Allowance
from robotree.sim.serving.last_words import LONGEST, last_words

TOTAL: Final = 512 * 1024.0
"""[bytes/s] that all links together may bring for long."""
BURST: Final = 64 * 1024.0
"""[bytes] that a link may bring at once; a new one, if the store has them."""
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


class Hearer(Protocol):
    """Takes what a link brings, and is told how long it has waited."""

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

    What waits here, or in the system's buffers while the link is not read, may be older than a stop that
    somebody else asks for meanwhile. So it is handed on with the number of stops at the moment from which
    on the link lags behind, until what the system had kept was read, too.

    Args:
        link: whose bytes.
        hearer: takes them.
        share: [bytes/s] that the link may bring for long, now.
        stops: how many stops have arrived, now.
        lose: told each time that something was lost.
        burst: [bytes] that it may bring at once in the beginning; one piece is always parsed.
    """

    def __init__(
        self,
        link: Link,
        hearer: Hearer,
        share: Callable[[], float],
        stops: Callable[[], int],
        lose: Callable[[], None],
        burst: float = BURST,
    ) -> None:
        self._link, self._hearer, self._share, self._stops, self._lose = link, hearer, share, stops, lose
        self._loop = asyncio.get_running_loop()
        self._allowance = Allowance(BURST, self._loop.time(), burst)
        self._backlog = b""
        self._later: asyncio.TimerHandle | None = None
        self._lagging: int | None = None
        self._caught_up = 0.0
        self._over = False

    def received(self, data: bytes) -> None:
        """The link tells: bytes came."""
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
        """The link tells: it has ended; a stop among what waited is heard nevertheless."""
        self._over = True
        if self._later is not None:
            self._later.cancel()
        data, self._backlog = self._backlog, b""
        if data:
            self._hearer.received(last_words(data, PIECE), self._lagging)
        if len(data) > LONGEST:
            self._lose()
        self._hearer.closed(reason)

    def _feed(self) -> None:
        while self._backlog:  # empty, too, when the link has ended because of what its hearer answered
            wait = self._allowance.wait(self._share(), self._loop.time())
            if wait > 0.0:
                if self._lagging is None:
                    self._lagging = self._stops()
                self._later = self._loop.call_later(wait, self._go_on)
                if isinstance(self._link, Pausable):
                    self._link.pause_reading()
                return
            piece, self._backlog = self._backlog[:PIECE], self._backlog[PIECE:]
            self._allowance.spend(len(piece))
            self._hearer.received(piece, self._lagging)

    def _go_on(self) -> None:
        self._later = None
        self._feed()
        if self._later is None and not self._over:
            self._caught_up = self._loop.time()
            if isinstance(self._link, Pausable):
                self._link.resume_reading()
