"""MAVLink over UDP: one frame per datagram.

A datagram link has no connections. A client sends without knowing whether somebody listens; a listener opens
a link for every address from which it receives, and ends it after a minute of silence, or after a few seconds
when its place is needed.
"""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, cast

from robotree.files import forks
from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError
from robotree.protocol.links.link import handler_of
from robotree.protocol.links.outbox import Outbox
from robotree.protocol.links.sockets import name, refusing
from robotree.protocol.links.url import require_loopback

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable

    from robotree.protocol.links.link import Accept, Handler, Link, LinkStatistics, Listener, Unsent
    from robotree.protocol.links.url import Url

SILENCE = 60.0
"""[s] after which a listener takes a silent address for gone."""
SWEEP = 5.0
"""[s] between two looks for silent addresses."""
MAX_LINKS = 128
"""Links of one listener. Where there are so many, the address that has been silent for the longest time makes
room if it has been for `LINGER`; else datagrams from further addresses are passed over."""
LINGER = 5.0
"""[s] that a silent address keeps a place that another one needs: several heartbeats missed."""


Address = tuple[Any, ...]
"""A socket's address: host, port, and what IPv6 adds."""


class UdpLink:
    """One address that we exchange datagrams with. Made by `connect_url` and `listen_url`."""

    def __init__(self, carrier: _Carrier, remote: Address | None, address: str) -> None:
        self.address, self.controller = address, carrier.controller
        self._carrier, self._remote = carrier, remote
        self._outbox = Outbox()
        self._reason: LinkError | None = None
        self.heard = asyncio.get_running_loop().time()
        """When the last datagram came, [s] on the loop's clock."""
        self._handler: Handler | None = None

    def begin(self, accept: Accept) -> None:
        """Let somebody hear the link; who closes it at once is told of the end at once, too."""
        self._handler = handler_of(self, accept)
        if self._reason is not None:
            self._handler.closed(self._reason)

    @property
    def congested(self) -> bool:
        """Whether frames wait for the system to take them."""
        return self._carrier.paused

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        return self._outbox.statistics()

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        """Send one whole frame, or queue it."""
        if self._reason is not None:
            self._outbox.dropped += 1
        elif self._carrier.paused:
            self._outbox.put(frame, topic)
            if (overrun := self._outbox.overrun(self.address)) is not None:
                self.end(overrun)
        else:
            self._carrier.send(self._outbox.leave(frame), self._remote)

    def flush(self) -> None:
        """The system takes datagrams again."""
        while not self._carrier.paused and (frame := self._outbox.pop()) is not None:
            self._carrier.send(frame, self._remote)

    def receive(self, data: bytes, now: float) -> None:
        """A datagram came from our address."""
        self.heard = now
        if self._handler is not None and self._reason is None:
            self._outbox.received += len(data)
            self._handler.received(data)

    def close(self) -> None:
        """End the link; the far end is not told."""
        self.end(LinkClosed(self.address, by_us=True))

    def end(self, reason: LinkError) -> None:
        """End the link with a reason."""
        if self._reason is None:
            self._reason = reason
            self._carrier.forget(self, self._remote)
            if self._handler is not None:
                self._handler.closed(reason)


class _Carrier(asyncio.DatagramProtocol):
    """One socket and its links, by remote address, the one heard last at the end.

    None is the address of a connected socket.
    """

    def __init__(self, accept: Accept, *, connected: bool) -> None:
        self._accept, self._connected = accept, connected
        self._transport: asyncio.DatagramTransport | None = None
        self._sweep: asyncio.TimerHandle | None = None
        self.controller = ""
        """The address of the end that listens."""
        self.links: dict[Address | None, UdpLink] = {}
        self.paused = False
        forks.owns(self)

    def in_child(self) -> Iterable[int]:
        return () if self._transport is None else (self._transport.get_extra_info("socket").fileno(),)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast("asyncio.DatagramTransport", transport)
        listens = transport.get_extra_info("peername" if self._connected else "sockname")
        self.controller = name("udp", listens)
        if not self._connected:
            self._look_for_silence()

    def open(self, remote: Address | None, address: str) -> UdpLink:
        """A link to an address."""
        link = self.links[remote] = UdpLink(self, remote, address)
        link.begin(self._accept)
        return link

    def datagram_received(self, data: bytes, addr: Address) -> None:
        now = asyncio.get_running_loop().time()
        if self._connected:
            link = self.links.get(None)
        elif (link := self.links.pop(addr, None)) is not None:
            self.links[addr] = link
        elif self._has_room(now):
            link = self.open(addr, name("udp", addr))
        if link is not None:
            link.receive(data, now)

    def _has_room(self, now: float) -> bool:
        """Whether another address can have a place; silent ones lose theirs."""
        if len(self.links) < MAX_LINKS:
            return True
        oldest = next(iter(self.links.values()))
        if (silent := now - oldest.heard) < LINGER:
            return False
        oldest.end(LinkBroken(oldest.address, f"silent for {silent:.1f} s while another needed its place"))
        return True

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there now; somebody may later."""

    def pause_writing(self) -> None:
        self.paused = True

    def resume_writing(self) -> None:
        self.paused = False
        for link in list(self.links.values()):
            link.flush()

    def connection_lost(self, exc: Exception | None) -> None:
        for link in list(self.links.values()):
            link.end(LinkBroken(link.address, str(exc)) if exc else LinkClosed(link.address, by_us=True))

    def send(self, frame: bytes, remote: Address | None) -> None:
        if self._transport is not None:
            self._transport.sendto(frame, remote)

    def forget(self, link: UdpLink, remote: Address | None) -> None:
        if self.links.get(remote) is link:
            del self.links[remote]
        if self._connected:
            self.close()

    def close(self) -> None:
        if self._sweep is not None:
            self._sweep.cancel()
        if self._transport is not None:
            self._transport.close()

    def _look_for_silence(self) -> None:
        loop = asyncio.get_running_loop()
        for link in list(self.links.values()):
            if loop.time() - link.heard >= SILENCE:
                link.end(LinkBroken(link.address, f"silent for {SILENCE:g} s"))
        self._sweep = loop.call_later(SWEEP, self._look_for_silence)


class UdpListener:
    """Waits for datagrams. Made by `listen_url`."""

    def __init__(self, carrier: _Carrier, local: Address) -> None:
        self._carrier = carrier
        self.address = name("udp", local)

    @property
    def links(self) -> frozenset[Link]:
        """The addresses that speak now."""
        return frozenset(self._carrier.links.values())

    async def close(self) -> None:
        """Listen no more and end all links."""
        for link in list(self._carrier.links.values()):
            link.close()
        self._carrier.close()
        await asyncio.sleep(0)


async def connect_url(url: Url, accept: Accept) -> Link:
    """Open a link to an address, whether or not somebody is there: `udp:HOST:PORT`.

    Raises:
        LinkRefused: there can be no such address.
    """
    url.only()
    host, port = url.host_and_port()
    address = name("udp", (host, port))
    loop = asyncio.get_running_loop()
    with refusing(address):
        _, carrier = await loop.create_datagram_endpoint(
            lambda: _Carrier(accept, connected=True), remote_addr=(host, port)
        )
    try:
        return carrier.open(None, address)
    except BaseException:
        carrier.close()
        raise


async def listen_url(url: Url, accept: Accept, *, exposed: bool) -> Listener:
    """Wait for datagrams: `udp:PORT` or `udp:HOST:PORT`.

    Raises:
        LinkRefused: the port is taken, or the address is not ours.
        BadUrl: the address is not loopback and nobody asked for that.
    """
    url.only()
    host, port = url.host_and_port()
    address = name("udp", (host, port))
    require_loopback(address, host, exposed=exposed)
    loop = asyncio.get_running_loop()
    with refusing(address):
        transport, carrier = await loop.create_datagram_endpoint(
            lambda: _Carrier(accept, connected=False), local_addr=(host, port)
        )
    return UdpListener(carrier, transport.get_extra_info("sockname"))
