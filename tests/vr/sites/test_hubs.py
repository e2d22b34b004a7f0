"""Hubs: their own certificates, and the pipe over real ones, one after the other and back to the first."""

from __future__ import annotations

import asyncio
import datetime as dt
import os
import socket
import ssl
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import zenoh

from robotree.vr.sites.hub import HubAddress, certificate_in, open_hub
from robotree.vr.sites.invitations import Hub
from robotree.vr.sites.zenoh_pipe import ZenohPipe
from robotree.vr.world.testing import until

pytestmark = pytest.mark.real_threads


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


async def test_sites_meet_at_any_hub_that_both_reach_whichever_dies_or_comes_back(
    pipes: list[ZenohPipe],
) -> None:
    hubs, heard = Hubs(2), set[bytes]()
    await hubs.start(1)
    pipes += [ZenohPipe(hubs.listed), ZenohPipe(hubs.listed)]
    pipes[1].subscribe("to/b", lambda _topic, body: heard.add(body))

    async def meet(what: str, one: int = 0) -> None:
        """Wait until what the one says from now on the other hears."""
        said = set[bytes]()

        def met() -> bool:
            body = os.urandom(8)
            said.add(body)
            pipes[one].publish("to/b", body)
            return bool(said & heard)

        await until(met, what)

    async def both_at(number: int) -> None:
        where = hubs.addresses[number].text
        await until(lambda: all(pipe.state().where == where for pipe in pipes), f"all are at hub {number}")

    await meet("by the only hub")
    await both_at(1)
    await hubs.start(0)
    await both_at(0)
    await meet("by the first, which is back")
    barred = ZenohPipe(hubs.listed[1:])  # its firewall lets it reach the second one alone
    pipes.append(barred)
    await meet("one at both hubs and one at the second", 2)
    await hubs.end(0)
    await both_at(1)
    await meet("by the second, while the first is dead")
    await hubs.start(0)
    await until(lambda: pipes[0].state().where == hubs.addresses[0].text, "the first is back")
    await meet("by the first")
    await hubs.end(1)
    await until(lambda: not barred.state().up, "the second is dead")
    await meet("by the first alone")
    await hubs.end(0)
    await until(
        lambda: all(address.text in pipes[0].state().reason for address in hubs.addresses),
        "it says which hubs do not answer",
    )
    assert not pipes[0].state().up


async def test_what_is_for_all_goes_by_all_hubs_and_what_is_for_one_goes_once(pipes: list[ZenohPipe]) -> None:
    hubs, heard = Hubs(2), list[bytes]()
    for number in (0, 1):
        await hubs.start(number)
    pipes += [ZenohPipe(hubs.listed), ZenohPipe(hubs.listed)]
    pipes[1].subscribe("**", lambda _topic, body: heard.append(body))

    pairs = list[tuple[bytes, bytes]]()

    def goes_once() -> bool:
        one, everybody = os.urandom(8), os.urandom(8)
        pairs.append((one, everybody))
        pipes[0].publish("to/b", one)
        pipes[0].publish("here", everybody, to_all=True)
        counts = [(heard.count(one), heard.count(everybody)) for one, everybody in pairs]
        return (1, 2) in counts  # what was sent before, by either hub, has come then

    await until(goes_once, "as soon as the hubs know who is there")
    for number in (0, 1):
        await hubs.end(number)


NOW = dt.datetime(2026, 11, 1, tzinfo=dt.UTC)


def test_hubs_that_start_at_once_have_one_certificate_with_the_key_that_belongs_to_it(tmp_path: Path) -> None:
    for number in range(8):
        folder = tmp_path / f"{number}"
        with ThreadPoolExecutor(4) as pool:
            made = list(pool.map(lambda _, at=folder: certificate_in(at, NOW), range(4)))
        assert len({one.fingerprint for one in made}) == 1
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(made[0].certificate, made[0].key)  # refuses a key that does not belong to it
