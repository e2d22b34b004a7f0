"""MAVLink over TCP.

Whole frames go to the socket, each in one write, without Nagle's delay; the system's buffer is kept small
so that telemetry which waits is superseded here instead of growing old there.
"""

from __future__ import annotations

import asyncio
import socket
from typing import TYPE_CHECKING

from robotree.files import forks
from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError, LinkUnanswered
from robotree.protocol.links.outbox import BOUND, Outbox
from robotree.protocol.links.sockets import name, refusing
from robotree.protocol.links.url import require_loopback

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable

    from robotree.protocol.links.link import Accept, Handler, Link, LinkStatistics, Listener, Unsent
    from robotree.protocol.links.url import Url

CONNECT_TIMEOUT = 5.0
"""[s]"""
SYSTEM_BUFFER = 64 * 1024
"""[bytes] that the system keeps for us; a few hundred frames."""
HIGH_WATER = 16 * 1024
"""[bytes] that asyncio keeps before our own outbox does."""
POLITE = 1.0
"""[s] after the end in which the far end may still read what was said before."""
MAX_LINKS = 128
"""Open links of one listener; more are closed at once."""


class TcpLink(asyncio.Protocol):
    """One end of a TCP connection. Made by `connect_url` and `listen_url`."""

    def __init__(
        self, accept: Accept, links: set[TcpLink] | None = None, bound: int = BOUND, address: str = "tcp:?"
    ) -> None:
        self._accept, self._links = accept, links
        self._transport: asyncio.Transport | None = None
        self.over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the handler was told of the end."""
        self._handler: Handler | None = None
        self._outbox = Outbox(bound)
        self._paused = False
        self._reason: LinkError | None = None
        self._closing: object = None
        forks.owns(self)
        self.address = self.controller = address
        """The far end's; who was dialled may have reset the connection before the system can tell."""

    @property
    def congested(self) -> bool:
        """Whether frames wait for the far end."""
        return self._paused

    @property
    def open(self) -> bool:
        """False: it has ended, or what was said last waits to be read."""
        return self._transport is not None and self._reason is None and not self._transport.is_closing()

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        inside = self._transport.get_write_buffer_size() if self._transport is not None else 0
        return self._outbox.statistics(inside)

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        """Send one whole frame, or queue it."""
        if self._transport is None or not self.open:
            self._outbox.dropped += 1
        elif not self._paused:
            self._transport.write(self._outbox.leave(frame))
        else:
            self._outbox.put(frame, topic)
            if (overrun := self._outbox.overrun(self.address)) is not None:
                self._end(overrun, self._transport)

    def close(self) -> None:
        """End the connection; what asyncio has of us already may still be read, for `POLITE` seconds."""
        if self._transport is not None and self._reason is None:
            self._end(LinkClosed(self.address, by_us=True), self._transport)

    def _end(self, reason: LinkError, transport: asyncio.Transport) -> None:
        self._reason = reason
        if self._paused:  # nobody reads: a polite end would wait for ever
            transport.abort()
        else:
            self._wait_to_be_read(transport)

    def _wait_to_be_read(self, transport: asyncio.Transport) -> None:
        """End our half of the connection; the far end ends the other half when it has read all.

        We read on meanwhile, to no purpose but one: a socket that is closed with unread bytes resets the
        connection (RFC 9293, 3.10.4), and the far end loses what it has not read. The wait is a task, for a
        program that ends cancels its tasks: it does not wait.
        """
        transport.resume_reading()
        transport.write_eof()
        wait = asyncio.ensure_future(asyncio.wait([self.over], timeout=POLITE))
        wait.add_done_callback(lambda _: transport.abort())
        self._closing = wait  # asyncio itself holds its tasks weakly

    def in_child(self) -> Iterable[int]:
        return () if self._transport is None else (self._transport.get_extra_info("socket").fileno(),)

    def give_up(self) -> None:
        """Wait no longer for what was said before the end to be read."""
        if self._transport is not None:
            self._transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is established."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  asyncio promises it for streams
        if (peer := transport.get_extra_info("peername")) is not None:
            self.address = name("tcp", peer)
            own = transport.get_extra_info("sockname")
            self.controller = self.address if self._links is None else name("tcp", own)
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SYSTEM_BUFFER)
        transport.set_write_buffer_limits(high=HIGH_WATER, low=0)
        if self._links is not None:
            if not _has_room(self._links):
                transport.abort()
                return
            self._links.add(self)
        self._transport = transport
        try:
            self._handler = self._accept(self)
        except BaseException:
            transport.abort()
            raise

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        if self._handler is not None and self._reason is None:
            self._outbox.received += len(data)
            self._handler.received(data)

    def pause_reading(self) -> None:
        """Let the far end wait: what it sends is not read until `resume_reading`."""
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_reading(self) -> None:
        """Read on."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()

    def pause_writing(self) -> None:
        """The far end does not read."""
        self._paused = True

    def resume_writing(self) -> None:
        """The far end has read."""
        self._paused = False
        while self._transport is not None and not self._paused and not self._transport.is_closing():
            frame = self._outbox.pop()
            if frame is None:
                return
            self._transport.write(frame)

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection has ended."""
        self._transport = None
        if self._links is not None:
            self._links.discard(self)
        if self._reason is None:
            self._reason = (
                LinkClosed(self.address, by_us=False) if exc is None else LinkBroken(self.address, str(exc))
            )
        handler, self._handler = self._handler, None
        if handler is not None:
            handler.closed(self._reason)
        if not self.over.done():
            self.over.set_result(None)


def _has_room(links: set[TcpLink]) -> bool:
    """Whether a listener takes one more link; those that have ended make room.

    A hundred connections may come in one step of the loop, and their handlers end as many older ones in it,
    which are there until the next step, or until they were read.
    """
    ended = [link for link in links if not link.open]
    if len(links) >= MAX_LINKS:
        for link in ended:
            link.give_up()
    return len(links) - len(ended) < MAX_LINKS


class TcpListener:
    """Waits for TCP connections. Made by `listen_url`."""

    def __init__(self, server: asyncio.Server, links: set[TcpLink]) -> None:
        self._server, self._links = server, links
        forks.owns(self)
        self.address = name("tcp", server.sockets[0].getsockname())

    @property
    def links(self) -> frozenset[Link]:
        """The connections that stand now."""
        return frozenset(link for link in self._links if link.open)

    def in_child(self) -> Iterable[int]:
        return [sock.fileno() for sock in self._server.sockets]

    async def close(self) -> None:
        """Listen no more and end all connections."""
        self._server.close()
        links = [*self._links]
        for link in links:
            link.close()
        await self._server.wait_closed()
        await asyncio.gather(*(link.over for link in links))


async def connect_url(url: Url, accept: Accept) -> Link:
    """Open a connection: `tcp:HOST:PORT`.

    Raises:
        LinkUnanswered: nobody listens there, or nobody answers.
    """
    url.only()
    host, port = url.host_and_port()
    address = name("tcp", (host, port))
    loop = asyncio.get_running_loop()
    with refusing(address, LinkUnanswered):
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT):
                _, link = await loop.create_connection(lambda: TcpLink(accept, address=address), host, port)
        except TimeoutError as error:
            raise LinkUnanswered(address, f"no answer within {CONNECT_TIMEOUT:g} s") from error
    return link


async def listen_url(url: Url, accept: Accept, *, exposed: bool) -> Listener:
    """Wait for connections: `tcp:PORT` or `tcp:HOST:PORT`.

    Raises:
        LinkRefused: the port is taken, or the address is not ours.
        BadUrl: the address is not loopback and nobody asked for that.
    """
    url.only()
    host, port = url.host_and_port()
    address = name("tcp", (host, port))
    require_loopback(address, host, exposed=exposed)
    links: set[TcpLink] = set()
    loop = asyncio.get_running_loop()
    with refusing(address):
        server = await loop.create_server(lambda: TcpLink(accept, links), host, port, reuse_address=True)
    return TcpListener(server, links)
