"""The laws of links, the same for every scheme there is."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from itertools import count
from typing import TYPE_CHECKING, Any

import pytest

from robotree.protocol.links.can import host as can_host
from robotree.protocol.links.can import listener as can_listener
from robotree.protocol.links.loopback import Loopback
from robotree.protocol.links.url import SCHEMES, connect, listen
from robotree.protocol.testing import (
    RecordingHandler,
    check_close_in_accept,
    check_link,
    check_refused,
    until,
)

if TYPE_CHECKING:
    from robotree.protocol.links.link import Accept, Link, Listener

_CHANNELS = count()


@asynccontextmanager
async def sockets(url: str) -> AsyncGenerator[Callable[[Accept, Accept], Awaitable[tuple[Link, Link]]]]:
    """A way to make pairs over whatever can be listened on."""
    async with AsyncExitStack() as stack:

        async def make_pair(near: Accept, far: Accept) -> tuple[Link, Link]:
            listener: Listener = await listen(url, far)
            stack.push_async_callback(listener.close)
            link = await connect(listener.address, near)
            stack.callback(link.close)
            if url.startswith("udp"):
                link.send(b"a word, for nobody is known before")
            await until(lambda: listener.links)
            return link, next(iter(listener.links))

        yield make_pair


BUSES = ("robotree/?fd=1", "robotree/?fd=0", "virtual/?fd=1", "virtual/?fd=0")


def bus(kind: str) -> str:
    """A bus that nobody else uses."""
    return f"can:{kind.replace('?', f'laws-{os.getpid()}-{next(_CHANNELS)}?')}"


async def test_tcp_keeps_the_laws() -> None:
    async with sockets("tcp:0") as make_pair:
        await check_link(make_pair, lambda: asyncio.sleep(0.005), pauses=True)


async def test_udp_keeps_the_laws_that_datagrams_can_keep() -> None:
    async with sockets("udp:0") as make_pair:
        await check_link(make_pair, lambda: asyncio.sleep(0.005), congests=False, tells_the_end=False)


@pytest.mark.parametrize("kind", BUSES)
async def test_can_keeps_the_laws_classic_and_fd_watched_and_in_threads(kind: str) -> None:
    async with sockets(bus(kind)) as make_pair:
        await check_link(make_pair, lambda: asyncio.sleep(0.06))


async def test_a_serial_line_keeps_the_laws_that_a_line_can_keep(make_cable: Callable[[], Any]) -> None:
    cable = make_cable()

    async def make_pair(near: Accept, far: Accept) -> tuple[Link, Link]:
        listener = await listen(cable.url(1), far)
        link = await connect(cable.url(0), near)
        return link, next(iter(listener.links))

    await check_link(make_pair, lambda: asyncio.sleep(0.02), tells_the_end=False)


@pytest.mark.parametrize("pace", [1, 7], ids=["idle", "busy"])
async def test_loopback_keeps_the_laws_on_an_idle_machine_and_on_a_busy_one(pace: int) -> None:
    networks: list[Loopback] = []
    settlings = count(1)

    async def make_pair(near: Accept, far: Accept) -> tuple[Link, Link]:
        networks.append(Loopback(near, far))
        return networks[0].near, networks[0].far

    async def settle() -> None:
        if next(settlings) % pace == 0:  # else others had the processor
            networks[0].advance()

    await check_link(make_pair, settle, congests=False)


@pytest.mark.parametrize("end", ["who listens", "who connects"])
@pytest.mark.parametrize("scheme", sorted(SCHEMES))
async def test_a_link_may_be_closed_before_it_is_accepted(
    scheme: str, end: str, make_cable: Callable[[], Any]
) -> None:
    async with AsyncExitStack() as stack:
        here, there = f"{scheme}:0", ""
        if scheme == "can":
            here = bus("robotree/?fd=1")
        elif scheme == "serial":
            cable = make_cable()
            here, there = cable.url(1), cable.url(0)

        async def dial(accept: Accept) -> None:
            near, far = (RecordingHandler, accept) if end == "who listens" else (accept, RecordingHandler)
            listener = await listen(here, far)
            stack.push_async_callback(listener.close)
            link = await connect(there or listener.address, near)
            stack.callback(link.close)
            link.send(b"a word, for nobody is known before")
            if end == "who listens":
                await asyncio.sleep(0.05)
                assert listener.links == frozenset(), "what has ended is not open"

        await check_close_in_accept(dial, lambda: asyncio.sleep(0.06))


async def test_an_end_of_the_loopback_may_be_closed_before_it_is_accepted() -> None:
    networks: list[Loopback] = []

    async def dial(accept: Accept) -> None:
        networks.append(Loopback(RecordingHandler, accept))

    async def settle() -> None:
        networks[0].advance()

    await check_close_in_accept(dial, settle)


NOBODY = {
    "can": "can:robotree/laws-of-nobody",
    "serial": "serial:/dev/there-is-none",
    "tcp": "tcp:127.0.0.1:1",
}


@pytest.mark.parametrize("scheme", sorted(set(SCHEMES) - {"udp"}))
async def test_a_link_that_cannot_be_had_is_refused_in_one_sentence(
    scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_host, "CONNECT_TIMEOUT", 0.3)
    await check_refused(lambda accept: connect(NOBODY[scheme], accept))


@pytest.mark.parametrize("url", ["tcp:0", "udp:0", "can:robotree/"])
async def test_a_place_that_is_taken_is_refused_in_one_sentence(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = bus("robotree/?fd=1") if url.startswith("can") else url
    async with AsyncExitStack() as stack:
        first = await listen(url, lambda _: pytest.fail("nobody comes"))
        stack.push_async_callback(first.close)
        monkeypatch.setattr(can_listener, "CLAIM_TIME", 60.0)  # the other one answers, sooner or later
        await check_refused(lambda accept: listen(first.address, accept))
