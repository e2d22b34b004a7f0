"""All transports pass one examination."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest

from robotree.vr.rehearsal.memory import MemoryNetwork, MemoryTransport
from robotree.vr.testing import TRANSPORT_CHECKS, Join, check_transport, run_in_virtual_time
from robotree.vr.transport import PresenceHandler, Registration, Transport

Check = Callable[[Join], Awaitable[None]]


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_memory(check: Check, join_memory: Join) -> None:
    await check(join_memory)


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_local(check: Check, join_realm: Join) -> None:
    await check(join_realm)


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_zenoh(check: Check, join_zenoh: Join) -> None:
    await check(join_zenoh)


async def test_a_whole_network_can_be_examined_at_once(join_memory: Join) -> None:
    await check_transport(join_memory)


class Mute(MemoryTransport):
    """Loses what is published."""

    def publish(self, key: str, body: bytes) -> None:
        if key == "probe":
            super().publish(key, body)


class Stubborn(MemoryTransport):
    """Goes on after it was closed."""

    async def announce(self, key: str) -> Registration:
        self.closed = False
        return await super().announce(key)


class Blind(MemoryTransport):
    """Does not tell what was there before."""

    async def watch(self, pattern: str, handler: PresenceHandler) -> Registration:
        there = await self.present(pattern)
        return await super().watch(pattern, lambda key, now: None if key in there else handler(key, now))


@pytest.mark.parametrize("broken", [Mute, Stubborn, Blind])
def test_the_examination_notices_a_broken_promise(broken: type[MemoryTransport]) -> None:
    async def examine() -> None:
        network = MemoryNetwork()

        async def join() -> Transport:
            member = broken(network, "broken")
            network.members.append(member)
            return member

        await check_transport(join)

    with pytest.raises(AssertionError, match="broken:"):
        run_in_virtual_time(examine())
