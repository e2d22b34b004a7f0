"""Not reading more than a share of what clients send, so that a flood costs the flooder and not the arm.

Parsing takes the interpreter from the thread of the physics: 350 000 frames in a second, as one client can
send, left the arm with 44 % of its real-time rate. So what a link brings is parsed in small pieces, and
beyond its allowance it waits: on a stream the client is not read until then, of datagrams the excess is lost
and counted.
"""

import asyncio
from collections.abc import Callable
from typing import Final, Protocol

from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link, Pausable
from robotree.sim.serving.allowance import Allowance

TOTAL: Final = 512 * 1024.0
"""[bytes/s] that all links together may bring for long."""
BURST: Final = 64 * 1024.0
"""[bytes] that a link may bring at once."""
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
    """

    def __init__(
        self,
        link: Link,
        hearer: Hearer,
        share: Callable[[], float],
        stops: Callable[[], int],
        lose: Callable[[], None],
    ) -> None:
        self._link, self._hearer, self._share, self._stops, self._lose = link, hearer, share, stops, lose
        self._loop = asyncio.get_running_loop()
        self._allowance = Allowance(BURST, self._loop.time())
        self._backlog = b""
        self._later: asyncio.TimerHandle | None = None
        self._lagging: int | None = None
        self._caught_up = 0.0

    def received(self, data: bytes) -> None:
        """The link tells: bytes came."""
        if self._later is None:
            if self._loop.time() > self._caught_up + KEPT:
                self._lagging = None
            self._feed(data)
        elif len(self._backlog) + len(data) <= LARGEST_BACKLOG:
            self._backlog += data
        else:
            self._lose()

    def closed(self, reason: LinkError) -> None:
        """The link tells: it has ended; what it said before, a stop perhaps, is heard nevertheless."""
        if self._later is not None:
            self._later.cancel()
        data, self._backlog = self._backlog, b""
        for begin in range(0, len(data), PIECE):
            self._hearer.received(data[begin : begin + PIECE], self._lagging)
        self._hearer.closed(reason)

    def _feed(self, data: bytes) -> None:
        while data:
            wait = self._allowance.wait(self._share(), self._loop.time())
            if wait > 0.0:
                self._backlog = data
                if self._lagging is None:
                    self._lagging = self._stops()
                self._later = self._loop.call_later(wait, self._go_on)
                if isinstance(self._link, Pausable):
                    self._link.pause_reading()
                return
            piece, data = data[:PIECE], data[PIECE:]
            self._allowance.spend(len(piece))
            self._hearer.received(piece, self._lagging)

    def _go_on(self) -> None:
        self._later = None
        data, self._backlog = self._backlog, b""
        self._feed(data)
        if self._later is None:
            self._caught_up = self._loop.time()
            if isinstance(self._link, Pausable):
                self._link.resume_reading()
