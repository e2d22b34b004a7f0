"""A slow line between a site and its hub, on loopback: delay, a rate, losses, and a cut.

It carries what TCP carries, and so loses nothing: a lost segment is one that comes a time-out later, and all
behind it with it. What is under way when the line is cut comes when it is whole again, as after a pulled
cable.
"""

from __future__ import annotations

import asyncio
import random
import socket
from contextlib import suppress

CHUNK = 1460
"""[bytes] that are carried at once: a segment of TCP over Ethernet."""

UNDER_WAY = 512
"""Chunks under way in one direction at most; the sender waits with more."""

TIME_OUT = 0.2
"""[s] after which TCP sends a lost segment again, beside the way there and back: the least in Linux."""


class SlowLine:
    """See the module. `open` it, `close` it. On the event loop."""

    def __init__(
        self,
        host: str,
        port: int,
        *,
        delay: float = 0.0,
        rate: float = 0.0,
        loss: float = 0.0,
    ) -> None:
        """Prepare.

        Args:
            host: where the far end is.
            port: there.
            delay: [s] one way.
            rate: [bit/s] of each direction; 0: any.
            loss: share of segments that are lost, 0 to 1.
        """
        self.delay, self.rate, self.loss = delay, rate, loss
        self.carried = 0
        """[bytes] in both directions."""
        self._target, self._chance = (host, port), random.Random(1)
        self._whole = asyncio.Event()
        self._whole.set()
        self._server: asyncio.Server | None = None
        self._carrying: set[asyncio.Task[None]] = set()
        self._writers: set[asyncio.StreamWriter] = set()

    async def open(self, host: str = "127.0.0.1", port: int = 0) -> int:
        """Listen; returns the port.

        Args:
            host: where.
            port: 0: one that is free.
        """
        self._server = await asyncio.start_server(self._take, host, port, limit=CHUNK)
        return int(self._server.sockets[0].getsockname()[1])

    def cut(self) -> None:
        """Carry nothing from now on. Connections stay, as with a pulled cable."""
        self._whole.clear()

    def mend(self) -> None:
        """Carry again, first what was under way."""
        self._whole.set()

    def hang_up(self) -> None:
        """End all connections."""
        for writer in list(self._writers):
            writer.transport.abort()

    async def close(self) -> None:
        """End. Twice is once."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
            self.hang_up()
            for task in self._carrying:
                task.cancel()
            await asyncio.gather(*self._carrying, return_exceptions=True)

    # -- inside -----------------------------------------------------------------------------------

    async def _take(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry one connection until one side ends it."""
        task = asyncio.current_task()
        assert task is not None  # noqa: S101 # asyncio makes one
        self._carrying.add(task)
        self._writers.add(writer)
        far: asyncio.StreamWriter | None = None
        try:
            await self._whole.wait()
            far_reader, far = await asyncio.open_connection(*self._target, limit=CHUNK)
            self._writers.add(far)
            for one in (writer, far):
                one.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            ways = [
                asyncio.ensure_future(way)
                for way in (self._carry(reader, far), self._carry(far_reader, writer))
            ]
            try:
                await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                await asyncio.gather(*ways, return_exceptions=True)
        except (OSError, asyncio.CancelledError):
            pass  # who dialed sees that it ends
        finally:
            for end in (writer, far):
                if end is not None:
                    self._writers.discard(end)
                    with suppress(OSError):
                        end.close()
            self._carrying.discard(task)

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Carry one direction until it ends."""
        under_way = asyncio.Queue[tuple[float, bytes]](UNDER_WAY)
        arriving = asyncio.ensure_future(self._arrive(under_way, writer))
        loop, free, last = asyncio.get_running_loop(), 0.0, 0.0
        try:
            while not arriving.done():
                chunk = await reader.read(CHUNK)
                now = loop.time()
                if self.rate:
                    free = max(free, now) + len(chunk) * 8 / self.rate
                    await asyncio.sleep(free - now)
                    now = loop.time()
                late = TIME_OUT + 2 * self.delay if self._chance.random() < self.loss else 0.0
                last = max(last, now + self.delay + late)
                await under_way.put((last, chunk))
                if not chunk:
                    break
            await arriving
        finally:
            arriving.cancel()

    async def _arrive(
        self, under_way: asyncio.Queue[tuple[float, bytes]], writer: asyncio.StreamWriter
    ) -> None:
        """Hand on what has been under way for long enough."""
        loop = asyncio.get_running_loop()
        while True:
            at, chunk = await under_way.get()
            await asyncio.sleep(max(0.0, at - loop.time()))
            await self._whole.wait()
            if not chunk:
                return
            self.carried += len(chunk)
            writer.write(chunk)
            await writer.drain()
