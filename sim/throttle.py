"""Not reading more than a share of what clients send, so that a flood costs the flooder and not the arm.

Parsing takes the interpreter from the thread of the physics: 350 000 frames in a second, as one client can
send, left the arm with 44 % of its real-time rate. So what a link brings is parsed in small pieces, and
beyond its allowance it waits: on a stream the client is not read until then, of datagrams the excess is lost.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Handler, Link, Pausable

TOTAL: Final = 512 * 1024.0
"""[bytes/s] that all links together may bring for long."""
BURST: Final = 64 * 1024.0
"""[bytes] that a link may bring at once."""
PIECE: Final = 4 * 1024
"""[bytes] that are parsed in one go: about 200 frames, half a millisecond."""
LARGEST_BACKLOG: Final = 512 * 1024
"""[bytes] that wait to be parsed; streams are not read meanwhile, of datagrams the excess is lost."""


class Allowance:
    """What may be spent, and when: a token bucket. Pure; `now` comes from the caller.

    Args:
        now: the clock [s].
    """

    def __init__(self, now: float) -> None:
        self._credit, self._since = BURST, now

    def wait(self, rate: float, now: float) -> float:
        """How long to wait before more may be spent, at a `rate` [bytes/s] at which credit grows [s]."""
        self._credit = min(self._credit + rate * (now - self._since), BURST)
        self._since = now
        return max(-self._credit / rate, 0.0)

    def spend(self, amount: int) -> None:
        """Spend [bytes]; the last piece may be more than there is."""
        self._credit -= amount


class Throttled:
    """Stands between a link and its handler.

    Args:
        link: whose bytes.
        handler: hears them.
        share: [bytes/s] that the link may bring for long, now.
    """

    def __init__(self, link: Link, handler: Handler, share: Callable[[], float]) -> None:
        self._link, self._handler, self._share = link, handler, share
        self._loop = asyncio.get_running_loop()
        self._allowance = Allowance(self._loop.time())
        self._backlog = b""
        self._later: asyncio.TimerHandle | None = None

    def received(self, data: bytes) -> None:
        """The link tells: bytes came."""
        if self._later is None:
            self._feed(data)
        elif len(self._backlog) + len(data) <= LARGEST_BACKLOG:
            self._backlog += data

    def closed(self, reason: LinkError) -> None:
        """The link tells: it has ended."""
        if self._later is not None:
            self._later.cancel()
        self._handler.closed(reason)

    def _feed(self, data: bytes) -> None:
        while data:
            wait = self._allowance.wait(self._share(), self._loop.time())
            if wait > 0.0:
                self._backlog = data
                self._later = self._loop.call_later(wait, self._go_on)
                if isinstance(self._link, Pausable):
                    self._link.pause_reading()
                return
            piece, data = data[:PIECE], data[PIECE:]
            self._allowance.spend(len(piece))
            self._handler.received(piece)

    def _go_on(self) -> None:
        self._later = None
        data, self._backlog = self._backlog, b""
        self._feed(data)
        if self._later is None and isinstance(self._link, Pausable):
            self._link.resume_reading()
