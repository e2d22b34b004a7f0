"""PING between two processes beside a bare asyncio echo of as many bytes, in turns.

`python bench/wire/round_trips.py URL…` is the other process. It echoes on a bare asyncio server and answers
PING on a link at each URL. It says where, as one line of JSON, and ends with its standard input.
"""

from __future__ import annotations

import asyncio
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

from robotree.protocol import Endpoint, Frame
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import Ping
from robotree.protocol.services import ping
from robotree.protocol.services.peer import Peer

if TYPE_CHECKING:
    from robotree.protocol.links.link import Link

BYTES = len(Frame.of(Ping(2**62, 2**31, 1, 1)).raw)
"""[bytes] of a PING, and of what the bare echo carries."""
FIRST_TRIP_WITHIN = 10.0
"""[s] that the first trip of each link may take."""

Trip = Callable[[], Awaitable[None]]
"""Goes there and back once."""


class Way(NamedTuple):
    """The times of one way."""

    name: str
    median: float
    """[s]"""
    ratios: tuple[float, ...]
    """Of the medians to that of the bare echo, round by round, sorted."""

    @property
    def ratio(self) -> float:
        """The middle one of the ratios."""
        return statistics.median(self.ratios)

    @property
    def usual(self) -> tuple[float, float]:
        """Between these lies the middle half of the ratios."""
        low, _, high = statistics.quantiles(self.ratios, n=4)
        return low, high


class Far(NamedTuple):
    """The other process."""

    port: int
    """Of the bare echo."""
    addresses: list[str]
    """Where it answers PING."""


@contextmanager
def far(*urls: str) -> Generator[Far]:
    """The other process, inside the block.

    Args:
        urls: where it shall answer PING.

    Yields:
        What is known of it.
    """
    words = [sys.executable, __file__, *urls]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            port, *addresses = _read(process)
            yield Far(port, addresses)
        finally:
            assert process.stdin is not None  # noqa: S101  it was asked for
            process.stdin.close()


def _read(process: subprocess.Popen[str]) -> Any:
    line = process.stdout.readline() if process.stdout is not None else ""
    if not line:
        raise ConnectionError("the other process of the measurement has ended")
    return json.loads(line)


class Bare(asyncio.Protocol):
    """Sends bytes and waits for as many: what asyncio costs without us."""

    def __init__(self) -> None:
        self._missing = 0
        self._back = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Remember the way there."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  asyncio promises it for streams
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Count what came back."""
        self._missing -= len(data)
        if self._missing <= 0:
            self._back.set()

    async def trip(self) -> None:
        """There and back, once."""
        self._missing = BYTES
        self._back.clear()
        self._transport.write(bytes(BYTES))
        await self._back.wait()

    def close(self) -> None:
        """Leave."""
        self._transport.close()


class Asking:
    """Asks PING over one link."""

    def __init__(self) -> None:
        self._back = asyncio.Event()
        self._number = 0
        self._mouth: Endpoint | None = None

    def accept(self, link: Link) -> Endpoint:
        """The link is open."""
        self._mouth = Endpoint(link, system=255, component=155, on_frame=self._hear)
        return self._mouth

    def _hear(self, frame: Frame) -> None:
        if isinstance(frame.message, Ping) and frame.message.seq == self._number:
            self._back.set()

    async def trip(self) -> None:
        """There and back, once."""
        self._number += 1
        self._back.clear()
        if self._mouth is not None:
            self._mouth.send(Ping(2**62, self._number))
        await self._back.wait()


async def compare(rounds: int = 500, turn: int = 1) -> list[Way]:
    """The bare echo, and PING over TCP, over CAN FD and over classic CAN on the loopback bus.

    Args:
        rounds: how many turns each way gets.
        turn: round trips of one turn. Back to back they are faster, the bare echo most of all: it alone
            finds all it needs in the processor's caches. A ping of the real world comes alone.

    Returns:
        What each way took, the bare echo first.
    """
    channel = f"bench-{os.getpid()}"
    urls = {
        "PING over TCP": "tcp:127.0.0.1:0",
        "PING over CAN FD": f"can:robotree/{channel}-fd?fd=1",
        "PING over classic CAN": f"can:robotree/{channel}-classic?fd=0",
    }
    with far(*urls.values()) as other:
        loop = asyncio.get_running_loop()
        _, bare = await loop.create_connection(Bare, "127.0.0.1", other.port)
        trips: dict[str, Trip] = {"bare asyncio echo": bare.trip}
        links: list[Link] = []
        for name, address in zip(urls, other.addresses, strict=True):
            asking = Asking()
            links.append(await connect(address, asking.accept))
            trips[name] = asking.trip
        for trip in trips.values():  # each can be gone, and is warm
            async with asyncio.timeout(FIRST_TRIP_WITHIN):
                await trip()
        results = await _take_turns(trips, rounds, turn)
        for link in links:
            link.close()
        bare.close()
        await asyncio.sleep(0.05)  # until every link has told the far end
    return results


async def _take_turns(trips: dict[str, Trip], rounds: int, turn: int) -> list[Way]:
    medians: dict[str, list[float]] = {name: [] for name in trips}
    times: dict[str, list[float]] = {name: [] for name in trips}
    for _ in range(rounds):
        for name, trip in trips.items():
            taken: list[float] = []
            for _ in range(turn):
                begun = time.perf_counter()
                await trip()
                taken.append(time.perf_counter() - begun)
            medians[name].append(statistics.median(taken))
            times[name] += taken
    bare = next(iter(medians.values()))
    return [
        Way(
            name,
            statistics.median(times[name]),
            tuple(sorted(ours / theirs for ours, theirs in zip(each, bare, strict=True))),
        )
        for name, each in medians.items()
    ]


class Echo(asyncio.Protocol):
    """The baseline without us: sends back each piece of data."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Remember the way back."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  asyncio promises it for streams
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Send it back."""
        self.transport.write(data)


def answering(link: Link) -> Endpoint:
    """An endpoint that answers PING."""

    def answer(frame: Frame) -> None:
        if isinstance(frame.message, Ping):
            for reply in ping.answer(frame.message, Peer(link.address, frame.system, frame.component)):
                endpoint.send(reply)

    endpoint = Endpoint(link, system=1, component=1, on_frame=answer)
    return endpoint


def _say(what: object) -> None:
    sys.stdout.write(f"{json.dumps(what)}\n")
    sys.stdout.flush()


async def serve(urls: list[str]) -> None:
    """Be there until standard input ends."""
    loop = asyncio.get_running_loop()
    echo = await loop.create_server(Echo, "127.0.0.1", 0)
    listeners = [await listen(url, answering) for url in urls]
    _say([echo.sockets[0].getsockname()[1], *(each.address for each in listeners)])
    await asyncio.to_thread(sys.stdin.read)
    for each in listeners:
        await each.close()
    echo.close()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1:]))
