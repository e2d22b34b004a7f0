"""A host without robots that waits until another one is away for too long, and then has its robots.

It only looks at the log, never at the network: who cannot write the log must not act, and so is away.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import StandsBy
from robotree.vr.base.requests import Create, DescribeHost, History, HostDescribed, ReadHistory, Reply
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.claim import Declarations, claim, new_address
from robotree.vr.exchange.dispatcher import Dispatcher, not_for
from robotree.vr.journal.store import LogPlace, LogStore, Owner

AFTER = 3.0
"""[s] without a sign of life after which a stand-by host takes over, if nothing else is said."""
SHORTEST_AFTER = 2.5
"""[s] of that at least: until then the children and the callers of a host that hangs know it, too, and an
owner that cannot reach its database does not act any more."""
BEAT = 0.5
"""[s] between two signs of life of an owner."""
LOOK = 0.1
"""[s] between two looks at the log."""

_log = logging.getLogger(__name__)


class Silence:
    """For how long the owner of a log has given no sign of life, as far as this process has watched. Pure."""

    def __init__(self, after: float) -> None:
        """Begin with nothing seen; `after`: [s] of silence that are too long."""
        self._after = after
        self._sign: tuple[int, int] | None = None
        self._looked = self.lasted = 0.0

    def look(self, owner: Owner | None, now: float) -> bool:
        """Take a look.

        Args:
            owner: as it is now; None: there is none, or nobody knows.
            now: [s] on a monotonic clock.

        Returns:
            Whether the owner has been silent for too long.
        """
        sign = None if owner is None else (owner.number, owner.beat)
        if sign is None or sign != self._sign:
            self._sign, self.lasted = sign, 0.0
        else:  # of the time in which this process was paused itself nothing is known
            self.lasted += min(now - self._looked, 2 * LOOK)
        self._looked = now
        return sign is not None and self.lasted >= self._after


class StandBy:
    """See the module. An agent under the name of the host that it will be."""

    def __init__(
        self, transport: Transport, name: str, place: LogPlace, *, of: str, after: float = AFTER
    ) -> None:
        """Prepare.

        Args:
            transport: the way to the others.
            name: of this host.
            place: of the log.
            of: name of the host whose log it is.
            after: [s] of silence after which this one takes over.
        """
        self.address = new_address("host", name)
        self._transport, self._place, self._after = transport, place, after
        self._owner = of
        """Name of the host that has the robots."""
        self._declared = Declarations()

    async def start(self) -> None:
        """Serve, then be there.

        Raises:
            DuplicateName: a living host has this name.
            TransportError: the transport does not work.
        """
        now = asyncio.get_running_loop().time
        here = Here("host", self.address.name, self._transport.gate)
        dispatcher = Dispatcher(
            self.address.name, lambda received, _: self._answer(received), now=now, here=here
        )
        async with Declarations() as declared:
            await declared.keep(self._transport.serve(self.address.key, dispatcher.take))
            await declared.keep(claim(self._transport, self.address))
            self._declared = declared.pop_all()

    async def close(self) -> None:
        """Be gone. Twice is once."""
        await self._declared.aclose()

    async def _answer(self, received: Received) -> Reply:
        match received.request:
            case DescribeHost():
                return HostDescribed(address=self.address, stands_by=self._owner)
            case ReadHistory():
                return History(lines=())
            case Create():
                raise StandsBy(host=self.address.name, owner=self._owner)
            case request:
                raise not_for("host", request)

    async def take_over(self) -> LogStore:
        """Wait until the owner of the log is away for too long; return the log, taken."""
        silence, clock = Silence(self._after), asyncio.get_running_loop().time
        trouble = ""
        while True:
            try:
                owner = await asyncio.to_thread(self._place.look)
                log = await self._taken(owner, silence, clock)
                trouble = ""
            except OSError as error:
                silence.look(None, clock())
                if str(error) != trouble:
                    trouble = str(error)
                    _log.warning("%s cannot be looked at: %s", self._place.where, trouble)
                log = None
            if log is not None:
                return log
            await asyncio.sleep(LOOK)

    async def _taken(
        self, owner: Owner | None, silence: Silence, clock: Callable[[], float]
    ) -> LogStore | None:
        silent = silence.look(owner, clock())
        if owner is None:
            return None
        self._owner = owner.host
        itself = owner.host == self.address.name and not owner.lives
        if not (silent or itself):
            return None
        log = await asyncio.to_thread(self._place.take, self.address.name, owner.number)
        if log is not None and not itself:
            _log.warning(
                "%s was not heard for %.1f s: %s has its robots",
                owner.host,
                silence.lasted,
                self.address.name,
            )
        return log
