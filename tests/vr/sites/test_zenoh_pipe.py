"""The pipe over real hubs: one after the other, and back to the first."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Iterator

import pytest
import zenoh

from robotree.vr.sites.hub import HubAddress, open_hub
from robotree.vr.sites.invitations import Hub
from robotree.vr.sites.zenoh_pipe import ZenohPipe
from robotree.vr.world.testing import until


class Hubs:
    """Hubs on loopback that can be started again."""

    def __init__(self, count: int) -> None:
        self.addresses, self.open = list[HubAddress](), dict[int, zenoh.Session]()
        for _ in range(count):
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self.addresses.append(HubAddress("tcp", "127.0.0.1", free.getsockname()[1]))

    @property
    def listed(self) -> list[Hub]:
        return [Hub(address.text) for address in self.addresses]

    async def start(self, number: int) -> None:
        self.open[number] = await asyncio.to_thread(open_hub, self.addresses[number], None)

    async def end(self, number: int) -> None:
        await asyncio.to_thread(self.open.pop(number).close)


@pytest.fixture
def pipes() -> Iterator[list[ZenohPipe]]:
    made: list[ZenohPipe] = []
    yield made
    for pipe in made:
        pipe.close()


async def test_sites_that_were_scattered_over_hubs_meet_at_the_first_that_answers(
    pipes: list[ZenohPipe],
) -> None:
    hubs, heard = Hubs(2), set[bytes]()
    await hubs.start(1)
    pipes += [ZenohPipe(hubs.listed), ZenohPipe(hubs.listed)]
    pipes[1].subscribe("to/*", lambda _topic, body: heard.add(body))

    async def meet(number: int) -> None:
        """Wait until what the one says the other hears, both at this hub."""
        said, where = set[bytes](), hubs.addresses[number].text

        def met() -> bool:
            body = os.urandom(8)
            said.add(body)
            pipes[0].publish("to/b", body)
            return bool(said & heard) and all(pipe.state().where == where for pipe in pipes)

        await until(met, f"both are at hub {number}")

    await meet(1)
    await hubs.start(0)
    await meet(0)
    await hubs.end(0)
    await meet(1)
    late = ZenohPipe(hubs.listed)
    pipes.append(late)
    await until(lambda: late.state().up, "who comes later is at the same hub")
    await hubs.start(0)
    await meet(0)
    await until(lambda: late.state().where == hubs.addresses[0].text, "and goes with them")
    for number in (0, 1):
        await hubs.end(number)
    await until(
        lambda: all(address.text in pipes[0].state().reason for address in hubs.addresses),
        "it says which hubs do not answer",
    )
    assert not pipes[0].state().up
