"""A host, or a lookup service, as a process: up until it is cancelled, and then down in order."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import sys
from collections.abc import Callable

from robotree.vr.agents.host import Host
from robotree.vr.base.address import check_name
from robotree.vr.core.bonds import DEFAULT_TERM
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.running.heard import listening

Ready = Callable[[str], None]
"""Called with the key of an agent that runs."""


TURN = 0.001
"""[s] after which a thread that computes lets the others have a turn (CPython's own value is 0.005).

Authors' commands run in threads beside the loop that keeps the leases. With one that never pauses, a
neighbour's call takes 4 ms instead of 15 ms; with four, 25 ms instead of 84 ms (docs/decisions/0006).
"""


ARRIVAL = 60.0
"""[s] for the one robot of a host to come: who has started the host may have been killed since."""


def _nobody(_: str) -> None:
    """Hear that it is ready, and do nothing."""


async def run_host(
    name: str,
    *,
    realm: str | None = None,
    term: float = DEFAULT_TERM,
    only: str = "",
    ready: Ready = _nobody,
) -> None:
    """Be a host in a realm until cancelled; one that runs one robot alone: until that has ended.

    Args:
        name: of the host, unique in the realm.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        term: [s] of the leases that its robots grant and ask for.
        only: name of the one robot that it runs; empty: it runs any number.
        ready: told the key once robots can be made.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living host has the name.
        TransportError: the realm cannot be joined.
    """
    for one in (name, only or name):
        check_name(one)
    sys.setswitchinterval(TURN)
    gc.freeze()  # what is imported never goes: no collection needs to look at it again
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(listening())
        transport = await join(realm)
        stack.push_async_callback(transport.close)
        registrar = Registrar(transport)
        stack.push_async_callback(registrar.close)
        host = Host(transport, name, registrar=registrar, term=term, only=only)
        stack.push_async_callback(host.close)
        await host.start()
        ready(host.address.key)
        if only:
            await host.deserted(ARRIVAL)
        else:
            await asyncio.get_running_loop().create_future()


async def run_lookup(name: str, *, realm: str | None = None, ready: Ready = _nobody) -> None:
    """Be a lookup service in a realm until cancelled.

    Args:
        name: of the service, unique in the realm.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        ready: told the key once it answers.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living lookup service has the name.
        TransportError: the realm cannot be joined.
    """
    check_name(name)
    async with contextlib.AsyncExitStack() as stack:
        transport = await join(realm)
        stack.push_async_callback(transport.close)
        service = LookupService(transport, name)
        stack.push_async_callback(service.close)
        await service.start()
        ready(service.address.key)
        await asyncio.get_running_loop().create_future()
