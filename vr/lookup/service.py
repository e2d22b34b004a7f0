"""A lookup service: one table, which processes keep up with their leases; its changes are published.

Any number of them run side by side, independent of each other. One that starts late asks the others once for
what they have; from then on every process registers with it too.
"""

from __future__ import annotations

import asyncio
import contextlib
import time

from robotree.vr.base.address import everyone
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import AnyRequest, Found, History, Query, ReadHistory, Register, Reply, encode
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.claim import Declarations, claim, new_address
from robotree.vr.exchange.dispatcher import Dispatcher, not_for
from robotree.vr.lookup.chronicle import Chronicle
from robotree.vr.lookup.table import SHORTEST_TERM, LookupTable, Update

FILL_LIMIT = 1.0
"""[s] to wait for the others when it starts; one that hangs must not keep a newcomer from its work."""

NEWS_PATTERN = f"{everyone('lookup')}/news"
"""Under which lookup services publish what changes."""


class LookupService:
    """Serves one table on a transport."""

    def __init__(self, transport: Transport, name: str) -> None:
        """Prepare a service.

        Args:
            transport: where it serves.
            name: under which people know it.

        Raises:
            BadName: the name cannot be one.
        """
        self.address = new_address("lookup", name)
        self.table = LookupTable()
        self.chronicle = Chronicle(transport.presence, time.time)
        self._transport = transport
        self._clock = asyncio.get_running_loop().time
        self._declared = Declarations()

    async def start(self) -> None:
        """Fill the table from the others, then be there.

        Raises:
            DuplicateName: another lookup service has this name.
        """
        transport = self._transport
        async with Declarations() as declared:
            dispatcher = Dispatcher(
                self.address.name,
                lambda received, _: self._answer(received.request),
                now=self._clock,
                here=Here("lookup", self.address.name, transport.gate),
            )
            declared.callback(self.chronicle.begin())
            await declared.keep(transport.serve(self.address.key, dispatcher.take))
            await self._fill()
            declared.work(self._sweep(), f"{self.address.name} sweeps")
            await declared.keep(claim(transport, self.address))
            self._declared = declared.pop_all()

    async def close(self) -> None:
        """End it. Twice is once."""
        await self._declared.aclose()

    # -- requests ---------------------------------------------------------------------------------

    def _answer(self, request: AnyRequest) -> Reply:
        now = self._clock()
        match request:
            case Register():
                answer, news = self.table.register(request, now)
                self._tell(news)
                return answer
            case Query(template=template):
                return Found(listings=self.table.find(template, now))
            case ReadHistory():
                return History(lines=self.chronicle.lines)
            case _:
                raise not_for("lookup service", request)

    def _tell(self, news: list[Update]) -> None:
        for item in news:
            with contextlib.suppress(VrError):  # the transport is closing
                self._transport.publish(f"{self.address.key}/news", encode(item))

    # -- beginning and end of leases --------------------------------------------------------------

    async def _fill(self) -> None:
        others = [key for key in self._transport.presence.keys(everyone("lookup")) if key != self.address.key]
        if others:
            asking = [asyncio.create_task(self._fill_from(key)) for key in others]
            await asyncio.wait(asking, timeout=FILL_LIMIT)

    async def _fill_from(self, key: str) -> None:
        with contextlib.suppress(VrError):  # one of the others that is just dying, or hangs
            found = await ask(self._transport, key, Query(), Found, timeout=FILL_LIMIT)
            for listing, remaining in found.listings:
                self._tell(self.table.fill(listing, remaining, self._clock()))

    async def _sweep(self) -> None:
        while True:
            expiry = self.table.next_expiry()
            now = self._clock()
            # no lease that begins meanwhile is shorter, so none is over before the next look
            left = SHORTEST_TERM if expiry is None else min(SHORTEST_TERM, max(0.0, expiry - now))
            await asyncio.sleep(left)
            self._tell(self.table.expire(self._clock()))
            self.chronicle.look()
