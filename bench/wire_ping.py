"""PING between two processes over TCP beside a bare asyncio echo of the same bytes; the cost of ten clients.

    python bench/wire_ping.py [--count N] [--json]

The round trips are measured in turns, so that a busy machine slows both. The cost of ten clients that hear
four messages at 100 Hz each is the processor time of the serving process.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import resource
import statistics
import subprocess
import sys
import time

from robotree.protocol import Endpoint, Frame
from robotree.protocol.links.link import Link, Listener
from robotree.protocol.links.tcp import connect, listen
from robotree.protocol.messages import Gripper, Heartbeat, Joints, Message, Ping, Tool
from robotree.protocol.services import ping
from robotree.protocol.services.peer import Peer

BYTES = len(Frame.of(Ping(2**62, 2**31, 1, 1)).raw)
CLIENTS, RATE, SECONDS = 10, 100.0, 5.0
TELEMETRY: list[Message] = [
    Joints(7, (0.1,) * 8, 8),
    Tool(7, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, (1, 2, 3, 4), 1),
    Gripper(7, 0.04, 0.04, 1.0, 0),
    Heartbeat(0, 0, 0, 0, 4),
]


class Echo(asyncio.Protocol):
    """Sends back what comes."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Remember the way back."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  asyncio promises it
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Send it back."""
        self.transport.write(data)


class Bare(asyncio.Protocol):
    """Sends bytes and waits for as many."""

    def __init__(self) -> None:
        self.missing = 0
        self.back = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Remember the way there."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  asyncio promises it
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        """Count what came back."""
        self.missing -= len(data)
        if self.missing <= 0:
            self.back.set()

    async def round_trip(self) -> None:
        """There and back, once."""
        self.missing = BYTES
        self.back.clear()
        self.transport.write(bytes(BYTES))
        await self.back.wait()


def controller(link: Link) -> Endpoint:
    """An endpoint that answers pings."""

    def answer(frame: Frame) -> None:
        if isinstance(frame.message, Ping):
            for reply in ping.answer(frame.message, Peer(link, frame.system, frame.component)):
                endpoint.send(reply)

    endpoint = Endpoint(link, system=1, component=1, on_frame=answer)
    return endpoint


async def serve() -> None:
    """The other process: an echo, a controller, and one that sends telemetry to everyone."""
    loop = asyncio.get_running_loop()
    echo = await loop.create_server(Echo, "127.0.0.1", 0)
    answering = await listen("127.0.0.1", 0, controller)
    crowd: list[Endpoint] = []
    complete = asyncio.Event()

    def accept(link: Link) -> Endpoint:
        crowd.append(controller(link))
        if len(crowd) == CLIENTS:
            complete.set()
        return crowd[-1]

    speaking: Listener = await listen("127.0.0.1", 0, accept)
    ports = [echo.sockets[0].getsockname()[1]]
    ports += [int(each.address.rpartition(":")[2]) for each in (answering, speaking)]
    print(json.dumps(ports), flush=True)
    await complete.wait()
    begin, spent = loop.time(), _processor()
    for i in range(round(SECONDS * RATE)):
        for endpoint in crowd:
            for message in TELEMETRY:
                endpoint.send(message, telemetry=True)
        await asyncio.sleep(max(begin + (i + 1) / RATE - loop.time(), 0.0))
    print(json.dumps((_processor() - spent) / (loop.time() - begin)), flush=True)


def _processor() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


async def measure(ports: list[int], count: int) -> tuple[float, float]:
    """Median round trips of the bare echo and of PING, [us]."""
    loop = asyncio.get_running_loop()
    _, bare = await loop.create_connection(Bare, "127.0.0.1", ports[0])
    back = asyncio.Event()

    def accept(link: Link) -> Endpoint:
        nonlocal endpoint
        endpoint = Endpoint(link, system=255, component=190, on_frame=lambda _: back.set())
        return endpoint

    endpoint: Endpoint | None = None
    await connect("127.0.0.1", ports[1], accept)
    if endpoint is None:
        raise ConnectionError("nobody was accepted")
    times: tuple[list[float], list[float]] = ([], [])
    for i in range(count):
        begin = time.perf_counter()
        await bare.round_trip()
        middle = time.perf_counter()
        back.clear()
        endpoint.send(Ping(2**62, i))
        await back.wait()
        times[0].append(middle - begin)
        times[1].append(time.perf_counter() - middle)
    return statistics.median(times[0]) * 1e6, statistics.median(times[1]) * 1e6


async def listen_in(port: int) -> int:
    """Ten clients hear telemetry; how many frames came."""
    heard: list[Frame] = []
    for system in range(CLIENTS):
        await connect(
            "127.0.0.1",
            port,
            lambda link, system=system: Endpoint(link, system=system + 1, component=1, on_frame=heard.append),
        )
    await asyncio.sleep(SECONDS + 0.5)
    return len(heard)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=3000)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        asyncio.run(serve())
        return
    with subprocess.Popen([sys.executable, __file__, "--serve"], stdout=subprocess.PIPE, text=True) as server:
        if server.stdout is None:
            raise ConnectionError("the server says nothing")
        ports = json.loads(server.stdout.readline())
        bare, ours = asyncio.run(measure(ports, arguments.count))
        frames = asyncio.run(listen_in(ports[2]))
        share = json.loads(server.stdout.readline())
    figures = {
        "echo_us": bare,
        "ping_us": ours,
        "ratio": ours / bare,
        "frames": frames,
        "share_of_core": share,
    }
    if arguments.json:
        print(json.dumps(figures))
        return
    print(f"bare asyncio echo of {BYTES} bytes  {bare:7.1f} us")
    print(f"PING over the TCP link          {ours:7.1f} us   {ours / bare:.2f}x")
    print(f"{CLIENTS} clients, {len(TELEMETRY)} messages at {RATE:g} Hz   {100 * share:7.1f} % of a core")


if __name__ == "__main__":
    main()
