"""Keeps the agents of one process listed in every lookup service that runs.

One registrar serves all agents of a process. For each service it has one keeper, which holds one lease there,
on which all listings of the process depend: it enters, changes and withdraws listings, many in one request,
renews the lease with an empty one, and repeats whatever was not acknowledged. So a service that hangs delays
no other, and one that returns learns everything anew, withdrawals included.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from itertools import islice

import msgspec

from robotree.vr.base.address import Address, everyone
from robotree.vr.base.chance import fraction, token
from robotree.vr.base.description import Listing
from robotree.vr.base.errors import VrError
from robotree.vr.base.presence import Undo
from robotree.vr.base.requests import Register, Registered
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.lookup.table import MOST_REMEMBERED, REMEMBERED

TERM = 10.0
"""[s] of a lease. Presence shows deaths at once, so this covers only what presence misses."""

RENEWALS_PER_TERM = 3
"""Two renewals may get lost before a lease runs out."""

REGISTER_WITHIN = 2.0
"""[s] to wait for a service's answer."""

RETRY = 0.5
"""[s] before a service that did not answer is asked again."""

PORTION = 200
"""Most listings and withdrawals in one request."""

FIRST_ANSWER, OTHER_ANSWERS = 1.0, 0.05
"""[s] that `enter` and `leave` wait for the first service to acknowledge, and then for all others."""


class _Wanted(msgspec.Struct, frozen=True):
    """How an agent's entry should be, everywhere."""

    revision: int
    listing: Listing | None
    """None: withdrawn."""


class Registrar:
    """Enters agents, and keeps them entered."""

    def __init__(self, transport: Transport, *, chance: Callable[[], float] = fraction) -> None:
        """Prepare.

        Args:
            transport: the way to the services.
            chance: 0 to 1; spreads renewals, so that they do not all come at once.
        """
        self.transport, self.chance = transport, chance
        self.wanted: dict[Address, _Wanted] = {}
        self._withdrawn: dict[Address, float] = {}
        """Since when [s] which of these are withdrawn, the oldest first."""
        self._keepers: dict[str, _Keeper] = {}
        self._unwatch: Undo | None = None

    async def enter(self, listing: Listing) -> None:
        """List an agent, or change its listing. Returns when the services have it, or as many as answer.

        Args:
            listing: how it should be listed; its revision is the registrar's business.
        """
        known = self.wanted.get(listing.address)
        if known is not None and known.listing is not None and _same(known.listing, listing):
            return
        revision = max(listing.revision, known.revision + 1 if known is not None else 1)
        await self._want(listing.address, revision, msgspec.structs.replace(listing, revision=revision))

    async def leave(self, address: Address) -> None:
        """Take an agent out. Returns when the services know, or as many as answer."""
        known = self.wanted.get(address)
        if known is not None and known.listing is not None:
            await self._want(address, known.revision + 1, None)

    async def close(self) -> None:
        """Renew nothing any more. Twice is once."""
        if self._unwatch is not None:
            self._unwatch()
        keepers = list(self._keepers.values())
        self._keepers.clear()
        await asyncio.gather(*(keeper.stop() for keeper in keepers), return_exceptions=True)

    # -- inside -----------------------------------------------------------------------------------

    async def _want(self, address: Address, revision: int, listing: Listing | None) -> None:
        now = asyncio.get_running_loop().time()
        self.wanted[address] = _Wanted(revision, listing)
        self._withdrawn.pop(address, None)
        if listing is None:
            self._withdrawn[address] = now
        self._forget_withdrawals(now)
        if self._unwatch is None:
            self._unwatch = self.transport.presence.watch(everyone("lookup"), self._service_seen)
        await _first_and_others([keeper.bring(address) for keeper in self._keepers.values()])

    def _service_seen(self, service: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        if there:
            self._keepers[service] = _Keeper(self, service)
        else:
            self._keepers.pop(service).stop()

    def raise_revision(self, address: Address, known: int) -> None:
        """A service knows a later revision; what is wanted here is what counts, everywhere."""
        wanted = self.wanted.get(address)
        if wanted is not None and wanted.listing is not None and wanted.revision <= known:
            listing = msgspec.structs.replace(wanted.listing, revision=known + 1)
            self.wanted[address] = _Wanted(known + 1, listing)
            for keeper in self._keepers.values():
                keeper.bring(address)

    def _forget_withdrawals(self, now: float) -> None:
        """Forget those that no service can remember the listing of, and the oldest if there are too many.

        A service that has not heard of one of these by then holds what is not wanted: `_Keeper` sees that by
        the number, and begins anew.
        """
        while self._withdrawn:
            address, since = next(iter(self._withdrawn.items()))
            if since + REMEMBERED >= now and len(self._withdrawn) <= MOST_REMEMBERED:
                return
            del self._withdrawn[address], self.wanted[address]
            for keeper in self._keepers.values():
                keeper.forget(address)


class _Keeper:
    """Holds the process's lease in one service, with the listings that are wanted."""

    def __init__(self, registrar: Registrar, service: str) -> None:
        self._registrar, self._service = registrar, service
        self._holder = token()
        self._due: dict[Address, None] = dict.fromkeys(registrar.wanted)
        """Listings that the service has not acknowledged as they are wanted, the oldest change first."""
        self._held: set[Address] = set()
        """Listings that the service has acknowledged under the lease."""
        self._waiting: dict[Address, asyncio.Future[None]] = {}
        self._changed = asyncio.Event()
        """Whether it has something to send."""
        self._loop = asyncio.get_running_loop()
        self._task = asyncio.create_task(self._run(), name=f"lease in {service}")

    def bring(self, address: Address) -> asyncio.Future[None]:
        """Have the service know what is wanted of an agent; the future is done when it does."""
        self._due[address] = None
        self._changed.set()
        return self._waiting.setdefault(address, asyncio.get_running_loop().create_future())

    def forget(self, address: Address) -> None:
        """Nothing is wanted of an agent any more."""
        self._due.pop(address, None)
        self._held.discard(address)
        self._acknowledge(address)

    def stop(self) -> asyncio.Task[None]:
        """Keep nothing any longer: the service is gone, or the process ends. Returns what ends soon."""
        self._task.cancel()
        for address in list(self._waiting):
            self._acknowledge(address)
        return self._task

    async def _run(self) -> None:
        while True:
            self._changed.clear()
            try:
                pause = await self._speak()
            except VrError:
                pause = RETRY
            timer = None if pause is None else self._loop.call_later(pause, self._changed.set)
            await self._changed.wait()
            if timer is not None:
                timer.cancel()

    async def _speak(self) -> float | None:
        """Send what is due and renew the lease. Returns when the service must hear again [s], None: never."""
        wanted = self._registrar.wanted
        sent = {address: wanted[address] for address in islice(self._due, PORTION)}
        if not sent and not self._held:
            return None
        request = Register(
            holder=self._holder,
            term=TERM,
            listings=tuple(each.listing for each in sent.values() if each.listing is not None),
            withdrawn=tuple((a, each.revision) for a, each in sent.items() if each.listing is None),
        )
        answer = await ask(
            self._registrar.transport, self._service, request, Registered, timeout=REGISTER_WITHIN
        )
        outdated = dict(answer.outdated)
        for address, each in sent.items():
            if address in outdated:
                self._registrar.raise_revision(address, outdated[address])
                continue
            (self._held.add if each.listing is not None else self._held.discard)(address)
            if wanted.get(address) is each:
                self._due.pop(address, None)
                self._acknowledge(address)
        if answer.count != len(self._held) and not outdated:  # it lost the lease, or holds what is not wanted
            self._holder = token()  # another lease: what the present one holds runs out
            self._due = dict.fromkeys(self._registrar.wanted)
            self._held.clear()
            return RETRY if sent else 0.0
        return 0.0 if self._due else answer.term / RENEWALS_PER_TERM * (1 - 0.2 * self._registrar.chance())

    def _acknowledge(self, address: Address) -> None:
        if (waiting := self._waiting.pop(address, None)) is not None and not waiting.done():
            waiting.set_result(None)


def _same(one: Listing, other: Listing) -> bool:
    return msgspec.structs.replace(one, revision=other.revision) == other


async def _first_and_others(answers: list[asyncio.Future[None]]) -> None:
    """Wait for the first answer, and a moment for the others."""
    if answers:
        _, late = await asyncio.wait(answers, timeout=FIRST_ANSWER, return_when=asyncio.FIRST_COMPLETED)
        if late:
            await asyncio.wait(late, timeout=OTHER_ANSWERS)
