"""Round trips between two processes: our links over CAN and TCP beside a bare asyncio TCP echo.

    python bench/wire_can.py [ROUNDS]

All ways carry the same bytes (a MAVLink frame of the size of PING) and take turns in one run, so that the
ratios hold on a noisy machine. Printed are medians; the ratios are to the bare echo of the same round.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable
from typing import IO, cast

import can

from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect, listen

FRAME = bytes((0xFD, 14)) + bytes(24)
"""26 bytes: a header of 10, the payload of PING and a checksum. Links look at nothing of it."""
BUS_PAYLOAD = 60
"""[bytes] for the bus alone, without link and event loop."""
TURNS = 100
"""Round trips of one way before the next one's turn."""
TARGET = 3.0
"""The ratio that the link over CAN FD must keep."""

Trip = Callable[[], Awaitable[None]]


class BareEcho(asyncio.Protocol):
    """What asyncio costs without us."""

    def __init__(self, data_received: Callable[[bytes], None] | None = None) -> None:
        self._told = data_received

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Remember the way back."""
        self.transport = cast("asyncio.Transport", transport)

    def data_received(self, data: bytes) -> None:
        """Send everything back, or tell of it."""
        if self._told is None:
            self.transport.write(data)
        else:
            self._told(data)


class LinkEcho:
    """A handler that sends everything back."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def received(self, data: bytes) -> None:
        """Send it back."""
        self._link.send(data)

    def closed(self, reason: Exception) -> None:
        """Nothing to do."""


class Waiter:
    """Waits for the echo of one frame, over a link or a bare transport."""

    def __init__(self) -> None:
        self._echo: asyncio.Future[None] | None = None

    def received(self, data: bytes) -> None:
        """The echo came."""
        if self._echo is not None and not self._echo.done() and len(data) == len(FRAME):
            self._echo.set_result(None)

    def closed(self, reason: Exception) -> None:
        """Nothing to do."""

    async def trip(self, send: Callable[[bytes], None]) -> None:
        """One way there and back."""
        self._echo = asyncio.get_running_loop().create_future()
        send(FRAME)
        await self._echo


async def echo_over_links(urls: list[str]) -> None:
    """The far process: echoes on all links and on a bare server, until its standard input ends."""
    loop = asyncio.get_running_loop()
    server = await loop.create_server(BareEcho, "127.0.0.1", 0)
    listeners = [await listen(url, LinkEcho) for url in urls]
    addresses = [listener.address for listener in listeners]
    print(server.sockets[0].getsockname()[1], *addresses, flush=True)
    await loop.run_in_executor(None, sys.stdin.readline)
    for listener in listeners:
        await listener.close()


def echo_over_bus(channel: str) -> None:
    """The far process for the bus alone."""
    with can.Bus(interface="robotree", channel=channel) as bus:
        print("here", flush=True)
        for message in bus:
            if message.arbitration_id == 0:
                return
            bus.send(message)


async def measure(name: str, trip: Trip, times: dict[str, list[float]]) -> float:
    """Some round trips; hand back their median [s] and keep all."""
    taken: list[float] = []
    for _ in range(TURNS):
        begun = time.perf_counter()
        await trip()
        taken.append(time.perf_counter() - begun)
    times.setdefault(name, []).extend(taken)
    return statistics.median(taken)


async def compare(port: int, urls: list[str], channel: str, rounds: int) -> None:
    """Let all ways take turns and print what they took."""
    waiter = Waiter()
    transport, _ = await asyncio.get_running_loop().create_connection(
        lambda: BareEcho(waiter.received), "127.0.0.1", port
    )
    ways: dict[str, Trip] = {"bare asyncio TCP echo": lambda: waiter.trip(transport.write)}
    links: list[Link] = []
    for url in urls:
        one = Waiter()
        links.append(await connect(url, lambda _, waiter=one: waiter))
        ways[f"link {url}"] = lambda waiter=one, link=links[-1]: waiter.trip(link.send)
    with can.Bus(interface="robotree", channel=channel) as bus:
        message = can.Message(arbitration_id=1, data=bytes(BUS_PAYLOAD), is_fd=True, bitrate_switch=True)

        async def over_bus() -> None:
            bus.send(message)
            if bus.recv(5) is None:
                raise TimeoutError("the bus did not answer")

        ways[f"bus alone, {BUS_PAYLOAD} bytes CAN FD"] = over_bus
        times: dict[str, list[float]] = {}
        ratios: dict[str, list[float]] = {}
        for _ in range(rounds):
            medians = {name: await measure(name, trip, times) for name, trip in ways.items()}
            bare = next(iter(medians.values()))
            for name, median in medians.items():
                ratios.setdefault(name, []).append(median / bare)
        bus.send(can.Message(arbitration_id=0))
    for link in links:
        link.close()
    transport.close()
    await asyncio.sleep(0.1)
    report(times, ratios)


def report(times: dict[str, list[float]], ratios: dict[str, list[float]]) -> None:
    """Print a table, and whether the target was met."""
    print(f"{'round trip':48} {'median':>9} {'p99':>9} {'ratio':>6}   lowest to highest round")
    for name, taken in times.items():
        taken.sort()
        median, late = taken[len(taken) // 2] * 1e6, taken[len(taken) * 99 // 100] * 1e6
        each = ratios[name]
        print(
            f"{name:48} {median:6.0f} us {late:6.0f} us {statistics.median(each):6.2f}"
            f"   {min(each):.2f} to {max(each):.2f}"
        )
    worst = statistics.median(next(each for name, each in ratios.items() if "link can:" in name))
    print(f"link over CAN FD: {worst:.2f} of {TARGET:g} allowed: {'met' if worst <= TARGET else 'MISSED'}")


def main() -> None:
    """Start the far processes and compare."""
    channel = f"bench-{os.getpid()}"
    urls = [f"can:robotree/{channel}-fd?fd=1", f"can:robotree/{channel}-classic?fd=0", "tcp:127.0.0.1:0"]
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    with contextlib.ExitStack() as stack:

        def start(*words: str) -> list[str]:
            far = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, __file__, *words],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                )
            )
            return cast("IO[str]", far.stdout).readline().split()

        port, *addresses = start("echo", *urls)
        start("bus", f"{channel}-alone")
        asyncio.run(compare(int(port), addresses, f"{channel}-alone", rounds))


if __name__ == "__main__":
    if sys.argv[1:2] == ["echo"]:
        asyncio.run(echo_over_links(sys.argv[2:]))
    elif sys.argv[1:2] == ["bus"]:
        echo_over_bus(sys.argv[2])
    else:
        main()
