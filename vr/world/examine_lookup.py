"""Everything that a lookup service promises, as checks for any implementation of it over any transport."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Awaitable, Callable
from typing import Protocol

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, Template
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import (
    DescribeHost,
    Found,
    HostDescribed,
    Listed,
    Query,
    Register,
    Registered,
    Unlisted,
    decode_event,
)
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.lookup.service import NEWS_PATTERN
from robotree.vr.world.promises import Join, promise, until


class LookupLike(Protocol):
    """A lookup service under examination."""

    @property
    def address(self) -> Address:
        """Where it serves."""
        ...

    async def close(self) -> None:
        """End it."""
        ...


Open = Callable[[Transport, str], Awaitable[LookupLike]]
"""Opens a lookup service of a name on a transport and returns it when it serves."""

ARM = Listing(
    address=Address("robot", "arm", "1"),
    kinds=("Arm", "Robot"),
    commands=("go_to", "grip"),
    attributes={"place": "lab"},
    revision=1,
)
ROVER = msgspec.structs.replace(ARM, address=Address("robot", "rover", "1"))
OTHER = msgspec.structs.replace(ARM, address=Address("robot", "other", "1"))
MATCHING = (
    Template(),
    Template(role="robot", name="arm", kind="Robot", command="grip", attributes={"place": "lab"}),
)
OTHERS = (
    Template(role="view"),
    Template(name="arms"),
    Template(kind="Rover"),
    Template(command="move"),
    Template(attributes={"place": "hall"}),
)


class _Asker:
    """Asks one service, as an agent or a supervisor does."""

    def __init__(self, transport: Transport, service: LookupLike) -> None:
        self.transport, self.key = transport, service.address.key
        self.news: list[Listed | Unlisted] = []

    async def listen(self) -> None:
        def hear(key: str, body: bytes) -> None:
            event = decode_event(body, key=key)
            if isinstance(event, Listed | Unlisted):
                self.news.append(event)

        await self.transport.subscribe(NEWS_PATTERN, hear)
        await asyncio.sleep(0.1)  # until the service knows of the listener

    async def register(
        self,
        *listings: Listing,
        term: float = 10.0,
        holder: str = "process-1",
        withdrawn: tuple[tuple[Address, int], ...] = (),
    ) -> Registered:
        request = Register(holder=holder, term=term, listings=listings, withdrawn=withdrawn)
        return await ask(self.transport, self.key, request, Registered, timeout=5)

    async def withdraw(self, address: Address, revision: int) -> None:
        await self.register(withdrawn=((address, revision),))

    async def find(self, template: Template | None = None) -> list[Listing]:
        request = Query(template=template or Template())
        found = await ask(self.transport, self.key, request, Found, timeout=5)
        return [listing for listing, _ in found.listings]


@contextlib.asynccontextmanager
async def _service_of(join: Join, open_service: Open) -> AsyncGenerator[_Asker]:
    """Open a service and yield who asks it, from another member of the network."""
    far, near = await join(), await join()
    service = await open_service(near, "lookup-1")
    await _until_seen(far, service)
    yield _Asker(far, service)
    await _close(service, far, near)


async def what_is_registered_is_found(join: Join, open_service: Open) -> None:
    """By every template that it matches, and by no other, until it is withdrawn."""
    async with _service_of(join, open_service) as asker:
        await asker.transport.announce(ARM.address.key)
        granted = (await asker.register(ARM)).term
        promise(0 < granted <= 10, "a lease is granted for at most what was asked for")
        for template in MATCHING:
            promise(await asker.find(template) == [ARM], f"{template} finds what matches it")
        for template in OTHERS:
            promise(await asker.find(template) == [], f"{template} finds nothing else")
        await asker.withdraw(ARM.address, 2)
        promise(await asker.find() == [], "what was withdrawn is not found")
        refused = (await asker.register(ARM)).outdated
        promise(refused == ((ARM.address, 2),), "a late request is refused, with the revision that is known")
        promise(await asker.find() == [], "a late request does not bring back what was withdrawn")


async def changes_are_told(join: Join, open_service: Open) -> None:
    """Arrival, change and withdrawal, each once; who is dead, presence tells."""
    async with _service_of(join, open_service) as asker:
        await asker.listen()
        changed = msgspec.structs.replace(ARM, revision=2, doc="changed")
        for listing in (ARM, ARM, changed):
            await asker.register(listing)
        await until(
            lambda: asker.news == [Listed(listing=ARM), Listed(listing=changed)], "renewals are no news"
        )
        await asker.withdraw(ARM.address, 3)
        withdrawn = Unlisted(address=ARM.address, revision=3)
        await until(lambda: asker.news[2:] == [withdrawn], "a withdrawal is told with its revision")


async def silence_ends_a_lease(join: Join, open_service: Open) -> None:
    """Also of an agent whose presence nobody sees."""
    async with _service_of(join, open_service) as asker:
        await asker.listen()
        term = (await asker.register(ARM, term=0.01)).term
        promise(await asker.find() == [ARM], "a lease lasts for a while, whatever was asked for")
        await asyncio.sleep(term + 0.2)
        promise(await asker.find() == [], "a lease that nobody renews ends")
        lost = Unlisted(address=ARM.address, revision=0)
        await until(lambda: asker.news[1:] == [lost], "the end of a lease is told")


async def all_listings_of_a_process_depend_on_one_lease(join: Join, open_service: Open) -> None:
    """An empty request renews it; the answer says how many listings depend on it."""
    async with _service_of(join, open_service) as asker:
        count = (await asker.register(ARM, ROVER, term=1.0)).count
        promise(count == 2, "the answer counts all that depend on the lease")
        promise((await asker.register(term=60.0)).count == 2, "a renewal names none of them")
        await asker.register(OTHER, term=0.01, holder="process-2")
        await asyncio.sleep(1.2)
        promise(await asker.find() == [ARM, ROVER], "a renewal holds all of its process, and nobody else's")
        lost = (await asker.register(holder="process-2")).count
        promise(lost == 0, "who has lost its lease sees it by the count")
        answer = await asker.register(withdrawn=((ARM.address, 2),))
        promise(answer.count == 1, "a withdrawal takes one listing from the lease")
        promise(await asker.find() == [ROVER], "and leaves the others")


async def a_late_one_fills_itself(join: Join, open_service: Open) -> None:
    """From those who are there, before anybody can see it."""
    async with _service_of(join, open_service) as asker:
        late = await join()
        await asker.transport.announce(ARM.address.key)
        await asker.register(ARM, term=5)
        latecomer = await open_service(late, "lookup-2")
        await _until_seen(asker.transport, latecomer)
        found = await ask(asker.transport, latecomer.address.key, Query(), Found, timeout=5)
        promise([listing for listing, _ in found.listings] == [ARM], "a late one has what the others have")
        promise(0 < found.listings[0][1] <= 5, "and for no longer than they")
        await _close(latecomer, late)


async def nonsense_is_refused(join: Join, open_service: Open) -> None:
    """With an error that travels; the service goes on."""
    async with _service_of(join, open_service) as asker:
        try:
            await ask(asker.transport, asker.key, DescribeHost(), HostDescribed, timeout=5)
        except VrError:
            pass
        else:
            promise(False, "what it cannot answer is refused")
        replies = [body async for body in asker.transport.request(asker.key, b"\xff nonsense", timeout=5)]
        promise(len(replies) == 1, "what cannot be read is refused too")
        promise(await asker.find() == [], "it goes on")


LOOKUP_CHECKS: tuple[Callable[[Join, Open], Awaitable[None]], ...] = (
    what_is_registered_is_found,
    changes_are_told,
    silence_ends_a_lease,
    all_listings_of_a_process_depend_on_one_lease,
    a_late_one_fills_itself,
    nonsense_is_refused,
)


async def check_lookup(join: Join, open_service: Open) -> None:
    """Examine a lookup service.

    Args:
        join: returns the transport of a new member of one and the same network.
        open_service: opens a service.

    Raises:
        AssertionError: a promise is broken.
    """
    for check in LOOKUP_CHECKS:
        await check(join, open_service)


async def _until_seen(who: Transport, service: LookupLike) -> None:
    seen: list[str] = []
    watch = who.presence.watch("lookup/*/*", lambda key, _: seen.append(key))
    await until(lambda: service.address.key in seen, "a lookup service is seen")
    watch()


async def _close(*closing: LookupLike | Transport) -> None:
    for each in closing:
        await each.close()
