"""The other process of the round trips: `python bench/wire/far.py URL…`.

It echoes on a bare asyncio server, answers PING on a link at each URL, and sends telemetry to a crowd. It
says where, as one line of JSON, and ends with its standard input.
"""

from __future__ import annotations

import asyncio
import json
import resource
import sys
from typing import TYPE_CHECKING

from robotree.protocol import Endpoint
from robotree.protocol.links.url import listen
from robotree.protocol.messages import Gripper, Heartbeat, Joints, Message, Ping, Tool
from robotree.protocol.services import ping
from robotree.protocol.services.peer import Peer

if TYPE_CHECKING:
    from robotree.protocol import Frame
    from robotree.protocol.links.link import Link

CLIENTS = 10
RATE = 100.0
"""[Hz]"""
SECONDS = 4.0
TELEMETRY: list[Message] = [
    Joints(7, (0.1,) * 8, 8),
    Tool(7, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, (1, 2, 3, 4), 1),
    Gripper(7, 0.04, 0.04, 1.0, 0),
    Heartbeat(0, 0, 0, 0, 4),
]
"""The messages that every client of the crowd hears at `RATE`."""


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


class Crowd:
    """Speaks to many at once, and measures what that costs."""

    def __init__(self) -> None:
        self._members: list[Endpoint] = []
        self.complete = asyncio.Event()

    def accept(self, link: Link) -> Endpoint:
        """One more listens."""
        self._members.append(answering(link))
        if len(self._members) == CLIENTS:
            self.complete.set()
        return self._members[-1]

    async def speak(self) -> float:
        """Send telemetry to all, and hand back the share of a core that it took."""
        loop = asyncio.get_running_loop()
        begin, spent = loop.time(), _processor()
        for step in range(round(SECONDS * RATE)):
            for endpoint in self._members:
                for message in TELEMETRY:
                    endpoint.send(message, telemetry=True)
            await asyncio.sleep(max(begin + (step + 1) / RATE - loop.time(), 0.0))
        return (_processor() - spent) / (loop.time() - begin)


def _processor() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _say(what: object) -> None:
    sys.stdout.write(f"{json.dumps(what)}\n")
    sys.stdout.flush()


async def serve(urls: list[str]) -> None:
    """Be there until standard input ends."""
    loop, crowd = asyncio.get_running_loop(), Crowd()
    echo = await loop.create_server(Echo, "127.0.0.1", 0)
    listeners = [await listen(url, answering) for url in urls]
    listeners.append(await listen("tcp:127.0.0.1:0", crowd.accept))
    _say([echo.sockets[0].getsockname()[1], *(each.address for each in listeners)])
    ended = asyncio.ensure_future(loop.run_in_executor(None, sys.stdin.read))
    coming = asyncio.ensure_future(crowd.complete.wait())
    await asyncio.wait([ended, coming], return_when=asyncio.FIRST_COMPLETED)
    if coming.done():
        _say(await crowd.speak())
        await ended
    for each in listeners:
        await each.close()
    echo.close()


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1:]))
