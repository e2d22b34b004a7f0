"""All transports pass one examination."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence

import pytest

from robotree.vr.base.presence import PresenceHandler, Undo
from robotree.vr.base.transport import Registration, Transport
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.testing import TRANSPORT_CHECKS, Join, check_transport, run_in_virtual_time

Check = Callable[[Join], Awaitable[None]]


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
def test_memory(check: Check, join_memory: Join) -> None:
    async def examine() -> None:
        await check(join_memory)

    run_in_virtual_time(examine())


@pytest.mark.parametrize("check", TRANSPORT_CHECKS, ids=lambda check: check.__name__)
async def test_local(check: Check, join_realm: Join) -> None:
    await check(join_realm)


@pytest.mark.parametrize("delay", [0.0, 0.003])
def test_a_whole_network_can_be_examined_at_once(delay: float) -> None:
    async def examine() -> None:
        network = MemoryNetwork(delay=delay)
        network.weather.jitter = delay

        async def join() -> Transport:
            return network.join()

        await check_transport(join)

    run_in_virtual_time(examine())


async def test_a_memory_network_runs_in_real_time_too(join_memory: Join) -> None:
    for check in TRANSPORT_CHECKS[:4]:
        await check(join_memory)


class Mute(MemoryTransport):
    """Loses what is published."""

    def publish(self, key: str, body: bytes) -> None:
        if key == "probe":
            super().publish(key, body)


class Stubborn(MemoryTransport):
    """Goes on after it was closed."""

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        self.closed = False
        return await super().announce(key, unless=unless)


class Blind(MemoryTransport):
    """Does not tell what was there before."""

    def __init__(self, network: MemoryNetwork, name: str) -> None:
        super().__init__(network, name)
        watch = self.presence.watch

        def blind(pattern: str, handler: PresenceHandler) -> Undo:
            there = self.presence.keys(pattern)
            return watch(pattern, lambda key, now: None if key in there else handler(key, now))

        self.presence.watch = blind  # type: ignore[method-assign]


@pytest.mark.parametrize("broken", [Mute, Stubborn, Blind])
def test_the_examination_notices_a_broken_promise(broken: type[MemoryTransport]) -> None:
    async def examine() -> None:
        network = MemoryNetwork()

        async def join() -> Transport:
            return network.enter(broken(network, "broken"))

        await check_transport(join)

    with pytest.raises(AssertionError, match="broken:"):
        run_in_virtual_time(examine())
