"""A lookup service passes its examination over both transports."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest

from robotree.vr.base.errors import BadName, DuplicateName
from robotree.vr.base.transport import Transport
from robotree.vr.lookup.service import LookupService
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import LOOKUP_CHECKS, Join, Open, in_virtual_time, run_in_virtual_time

Check = Callable[[Join, Open], Awaitable[None]]


async def open_service(transport: Transport, name: str) -> LookupService:
    service = LookupService(transport, name)
    await service.start()
    return service


@pytest.mark.parametrize("check", LOOKUP_CHECKS, ids=lambda check: check.__name__)
def test_in_memory(check: Check) -> None:
    async def examine() -> None:
        network = MemoryNetwork()

        async def join() -> Transport:
            return network.join()

        await check(join, open_service)

    run_in_virtual_time(examine())


@in_virtual_time
async def test_two_of_one_name_cannot_be() -> None:
    network = MemoryNetwork()
    first = await open_service(network.join(), "lookup-1")
    with pytest.raises(DuplicateName, match="a lookup named 'lookup-1' is already running"):
        await open_service(network.join(), "lookup-1")
    await first.close()
    again = await open_service(network.join(), "lookup-1")
    await again.close()


@in_virtual_time
async def test_a_name_that_breaks_addresses_is_refused() -> None:
    with pytest.raises(BadName):
        LookupService(MemoryNetwork().join(), "a/b")
