"""Keeps the agents of one process listed in every lookup service that lives.

One registrar serves all agents of a process. For each service and agent it has one keeper, which enters the
listing, renews its lease, and repeats whatever was not acknowledged; so a service that hangs delays nobody
else, and one that returns learns everything anew, withdrawals included.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterable

import msgspec

from robotree.vr.address import Address, everyone
from robotree.vr.description import Listing
from robotree.vr.errors import VrError
from robotree.vr.exchange.asking import ask
from robotree.vr.lookup.table import REMEMBERED
from robotree.vr.requests import Done, Register, Registered, Withdraw
from robotree.vr.running.chance import fraction
from robotree.vr.transport import Registration, Transport

TERM = 10.0
"""[s] of a listing's lease. Presence tells of the dead at once, so this covers only what presence misses."""

RENEWALS_PER_TERM = 3
"""Two renewals may get lost before a lease runs out."""

PATIENCE = 2.0
"""[s] to wait for a service's answer."""

RETRY = 0.5
"""[s] before a service that did not answer is asked again."""

FIRST_ANSWER, OTHER_ANSWERS = 1.0, 0.05
"""[s] that `enter` and `leave` wait for the first service to acknowledge, and then for all others."""


class _Wanted(msgspec.Struct):
    """How an agent's entry should be, everywhere."""

    revision: int
    listing: Listing | None
    """None: withdrawn."""
    since: float


class Registrar:
    """Enters agents, and keeps them entered."""

    def __init__(
        self, transport: Transport, *, term: float = TERM, chance: Callable[[], float] = fraction
    ) -> None:
        """Prepare.

        Args:
            transport: the way to the services.
            term: [s] of the leases to ask for.
            chance: 0 to 1; spreads renewals, so that they do not all come at once.
        """
        self.term, self.chance = term, chance
        self.transport = transport
        self.wanted: dict[Address, _Wanted] = {}
        self._keepers: dict[str, dict[Address, _Keeper]] = {}
        self._watch: asyncio.Future[Registration] | None = None
        self._closed = False

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
        self._closed = True
        keepers = [keeper for group in self._keepers.values() for keeper in group.values()]
        self._keepers.clear()
        if self._watch is not None:
            with contextlib.suppress(VrError):
                await (await self._watch).close()
        await asyncio.gather(*(keeper.close() for keeper in keepers))

    # -- inside -----------------------------------------------------------------------------------

    async def _want(self, address: Address, revision: int, listing: Listing | None) -> None:
        now = asyncio.get_running_loop().time()
        self.wanted[address] = _Wanted(revision, listing, now)
        self._forget_withdrawals(now)
        if self._watch is None:
            self._watch = asyncio.ensure_future(self.transport.watch(everyone("lookup"), self._service_seen))
        await asyncio.shield(self._watch)
        await _acknowledged([self._keep(service, address) for service in list(self._keepers)])

    def _service_seen(self, service: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        if there and not self._closed:
            self._keepers.setdefault(service, {})
            for address in self.wanted:
                self._keep(service, address)
        else:
            for keeper in self._keepers.pop(service, {}).values():
                keeper.stop()

    def _keep(self, service: str, address: Address) -> _Keeper:
        keepers = self._keepers[service]
        if address not in keepers:
            keepers[address] = _Keeper(self, service, address)
        keepers[address].look()
        return keepers[address]

    def _forget_withdrawals(self, now: float) -> None:
        """Forget those that no service can remember the listing of."""
        old = [
            address
            for address, wanted in self.wanted.items()
            if wanted.listing is None and wanted.since + REMEMBERED < now
        ]
        for address in old:
            del self.wanted[address]
            for keepers in self._keepers.values():
                if address in keepers:
                    keepers.pop(address).stop()


class _Keeper:
    """Keeps one agent's entry in one service as it should be."""

    def __init__(self, registrar: Registrar, service: str, address: Address) -> None:
        self._registrar, self._service, self._address = registrar, service, address
        self._changed = asyncio.Event()
        self._acknowledged = 0
        self.settled = asyncio.Event()
        """Set while the service has what is wanted."""
        self._task = asyncio.create_task(self._run(), name=f"{address.name} in {service}")

    def look(self) -> None:
        """Compare what is wanted with what the service has."""
        if self._registrar.wanted[self._address].revision != self._acknowledged:
            self.settled.clear()
            self._changed.set()

    def stop(self) -> None:
        """Keep it no longer: the service is gone, or nothing is to be kept."""
        self._task.cancel()
        self.settled.set()

    async def close(self) -> None:
        """Stop, and wait for the end."""
        self.stop()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        while True:
            self._changed.clear()
            wanted = self._registrar.wanted[self._address]
            try:
                pause = await self._bring(wanted)
            except VrError:
                pause = RETRY
            else:
                self._acknowledged = wanted.revision
                if self._registrar.wanted[self._address].revision == wanted.revision:
                    self.settled.set()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(pause):
                    await self._changed.wait()

    async def _bring(self, wanted: _Wanted) -> float | None:
        """Tell the service what is wanted. Returns when it must hear it again [s], None: never."""
        transport, service = self._registrar.transport, self._service
        if wanted.listing is None:
            request = Withdraw(address=self._address, revision=wanted.revision)
            await ask(transport, service, request, Done, timeout=PATIENCE)
            return None
        register = Register(listing=wanted.listing, term=self._registrar.term)
        granted = await ask(transport, service, register, Registered, timeout=PATIENCE)
        if granted.term <= 0:  # it holds something newer; what is wanted here is what counts
            wanted.revision += 1
            wanted.listing = msgspec.structs.replace(wanted.listing, revision=wanted.revision)
            return 0.0
        return granted.term / RENEWALS_PER_TERM * (1 - 0.2 * self._registrar.chance())


def _same(one: Listing, other: Listing) -> bool:
    return msgspec.structs.replace(one, revision=other.revision) == other


async def _acknowledged(keepers: Iterable[_Keeper]) -> None:
    waiting = {asyncio.create_task(keeper.settled.wait()) for keeper in keepers}
    if not waiting:
        return
    try:
        _, waiting = await asyncio.wait(waiting, timeout=FIRST_ANSWER, return_when=asyncio.FIRST_COMPLETED)
        if waiting:
            await asyncio.wait(waiting, timeout=OTHER_ANSWERS)
    finally:
        for task in waiting:
            task.cancel()
