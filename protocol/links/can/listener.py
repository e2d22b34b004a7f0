"""The controller's side of a bus: one node number, and a link with every host that asks for one.

A host asks with OPEN. One that knows nothing of sessions is linked with by its first MAVLink frame. When the
bus breaks, all links end and the listener goes onto it again as soon as it can.
"""

from __future__ import annotations

import asyncio
import contextlib
import secrets
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.codec import MAGIC
from robotree.protocol.errors import LinkBroken, LinkClosed, LinkRefused
from robotree.protocol.frame import HEADER_BYTES, MAGIC_V1
from robotree.protocol.isotp.frames import (
    CLASSIC,
    FD,
    FirstFrame,
    SingleFrame,
    decode,
    largest_single,
    single,
)
from robotree.protocol.links.can.address import CanAddress, Telemetry
from robotree.protocol.links.can.control import ALIVE_PERIOD, Code, Control, SilenceTimer, read
from robotree.protocol.links.can.identifiers import (
    EVERYBODY,
    HOSTS,
    Kind,
    Priority,
    identifier,
    taken_apart,
)
from robotree.protocol.links.can.link import CanLink, Ends
from robotree.protocol.links.can.port import Port, open_port

if TYPE_CHECKING:
    from collections.abc import Hashable

    from can import Message

    from robotree.protocol.links.link import Accept, Link

CLAIM_TIME = 0.2
"""[s] that another controller has to say that our number is its own."""
AGAIN = 1.0
"""[s] between two attempts to go onto a broken bus again."""
_MOST_TOPICS = 256
_SPEAKER = 5
"""Where a frame says who speaks; the message follows."""


class ListenerStatistics(msgspec.Struct, frozen=True):
    """One reading of a listener's gauges."""

    foreign: int
    """Frames that are not for us: of other nodes, or of other uses of the bus."""
    unknown: int
    """Frames for us that no link expects."""
    breaks: int
    """How often the bus broke."""


class CanListener:
    """Waits for hosts. Made by `listen`."""

    def __init__(self, address: CanAddress, accept: Accept, port: Port) -> None:
        self._where, self._accept, self._port = address, accept, port
        port.user = self
        self._links: dict[int, CanLink] = {}
        self._sessions: dict[int, int] = {}
        """The latest session of each host that opened one."""
        self._latest: dict[Hashable, tuple[bytes, set[int]]] = {}
        """By topic, what the latest telemetry to all told, and the hosts on whose behalf."""
        self._claim = secrets.randbits(32)
        self._refused = asyncio.Event()
        self._foreign = self._unknown = self._breaks = 0
        self._again: asyncio.Task[None] | None = None
        self._broadcast_id = identifier(
            Priority.TELEMETRY, Kind.BROADCAST, target=EVERYBODY, source=address.node
        )

    @property
    def address(self) -> str:
        """The address that others pass to `connect`."""
        return str(self._where)

    @property
    def links(self) -> frozenset[Link]:
        """The links that are open now."""
        return frozenset(self._links.values())

    @property
    def statistics(self) -> ListenerStatistics:
        """The gauges now."""
        return ListenerStatistics(self._foreign, self._unknown, self._breaks)

    async def claim(self) -> None:
        """Ask the others on the bus whether our number is free.

        Raises:
            LinkRefused: it is another controller's.
        """
        self._control(Control(Code.CLAIM, self._claim), target=EVERYBODY, fd=self._where.fd)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(CLAIM_TIME):
                await self._refused.wait()
            raise LinkRefused(self.address, f"another controller on this bus has node={self._where.node}")

    async def close(self) -> None:
        """Listen no more and end all links."""
        if self._again is not None:
            self._again.cancel()
            await asyncio.gather(self._again, return_exceptions=True)
        for link in list(self._links.values()):
            link.close()
        await asyncio.sleep(0)  # until every handler was told
        await self._port.leave()

    def heard(self, message: Message) -> None:
        """A data frame arrived."""
        kind, target, source = taken_apart(message.arbitration_id)
        node = self._where.node
        if not message.is_extended_id or target not in (node, EVERYBODY):
            self._foreign += 1
        elif kind == Kind.ADDRESSED and target == node and source in HOSTS:
            link = self._links.get(source) or self._unknown_host(message, source)
            if link is not None:
                link.heard(message)
        elif kind == Kind.CONTROL and (control := read(bytes(message.data))) is not None:
            self._controlled(control, source, fd=message.is_fd)
        else:
            self._foreign += 1

    def room(self) -> None:
        """The bus has accepted all waiting frames."""
        for link in list(self._links.values()):
            link.pump()

    def broke(self, cause: str) -> None:
        """The bus is broken."""
        self._breaks += 1
        for link in list(self._links.values()):
            link.end(LinkBroken(link.address, cause))
        self._again = asyncio.get_running_loop().create_task(self._go_on_again())

    async def _go_on_again(self) -> None:
        await self._port.leave()
        while True:
            try:
                self._port = await open_port(self._where)
            except LinkRefused:
                await asyncio.sleep(AGAIN)
            else:
                self._port.user = self
                return

    def _controlled(self, control: Control, source: int, *, fd: bool) -> None:
        if source == self._where.node:
            self._rival(control, fd=fd)
        elif source not in HOSTS:
            self._foreign += 1
        elif control.code == Code.OPEN:
            self._open(source, control.session, fd=fd)
        elif (link := self._links.get(source)) is None or link.presence.session != control.session:
            self._unknown += 1
            if control.code != Code.CLOSE:  # a host whose session has ended must know
                self._control(Control(Code.CLOSE, control.session), target=source, fd=fd)
        elif control.code == Code.CLOSE:
            link.end(LinkClosed(link.address, by_us=False))
        else:
            link.alive()

    def _rival(self, control: Control, *, fd: bool) -> None:
        """Another controller has our number, or these are our own words."""
        if control.code == Code.CLAIM and control.session != self._claim:
            self._control(Control(Code.REFUSE, control.session), target=self._where.node, fd=fd)
        elif control.code == Code.REFUSE and control.session == self._claim:
            self._refused.set()

    def _open(self, host: int, session: int, *, fd: bool) -> None:
        older = self._links.get(host)
        if older is not None and older.presence.session != session:
            silence = older.silence(asyncio.get_running_loop().time())
            if silence < 2 * ALIVE_PERIOD:  # it lives, so the newcomer has its number by mistake
                self._control(Control(Code.REFUSE, session), target=host, fd=fd)
                return
            older.end(LinkClosed(older.address, by_us=False))
        self._sessions[host] = session
        self._control(Control(Code.ACCEPT, session), target=host, fd=fd)
        if host not in self._links:  # else the host did not hear our first answer
            self._link(host, session, fd=fd)

    def _unknown_host(self, message: Message, host: int) -> CanLink | None:
        """A data frame of a host without a link: a link, if the host knows nothing of sessions."""
        self._unknown += 1
        if (session := self._sessions.get(host)) is not None:
            self._control(Control(Code.CLOSE, session), target=host, fd=message.is_fd)
            return None
        frame = decode(bytes(message.data))
        if not isinstance(frame, SingleFrame | FirstFrame) or frame.data[0] not in (MAGIC, MAGIC_V1):
            return None
        return self._link(host, None, fd=message.is_fd)

    def _link(self, host: int, session: int | None, *, fd: bool) -> CanLink:
        where, now = self._where, asyncio.get_running_loop().time()
        link = CanLink(
            self._port,
            f"can:{where.interface}/{where.channel}?node={where.node}&host={host}",
            Ends(own=where.node, partner=host, toward=Priority.TO_HOST),
            SilenceTimer(now, session, where.silence),
            FD if fd and where.fd else CLASSIC,
            broadcast=self._broadcast,
            on_end=self._forget,
        )
        self._links[host] = link
        self._latest.clear()  # nothing of it was told to the newcomer
        link.begin(self._accept)
        return link

    def _forget(self, link: CanLink) -> None:
        if self._links.get(link.ends.partner) is link:
            del self._links[link.ends.partner]

    def _broadcast(self, link: CanLink, frame: bytes, topic: Hashable) -> bool:
        """Send telemetry to all, if that is what to do with it."""
        mode = self._where.telemetry
        if mode is Telemetry.ADDRESSED or (mode is Telemetry.AUTO and len(self._links) > 1):
            return False
        width = link.width
        if len(frame) > largest_single(width):
            return False
        if mode is Telemetry.BROADCAST and self._is_told(link.ends.partner, frame, topic):
            return True
        self._port.send(self._broadcast_id, single(frame, width), fd=width > CLASSIC)
        return True

    def _is_told(self, host: int, frame: bytes, topic: Hashable) -> bool:
        """Whether this went out on behalf of another host; what is said to one host twice is news."""
        content = _told_by(frame)
        latest, hosts = self._latest.get(topic, (b"", set[int]()))
        if content == latest and host not in hosts:
            hosts.add(host)
            return True
        if len(self._latest) >= _MOST_TOPICS:
            self._latest.clear()
        self._latest[topic] = content, {host}
        return False

    def _control(self, control: Control, *, target: int, fd: bool) -> None:
        """Say something in the format that the other one speaks."""
        arbitration_id = identifier(Priority.FLOW, Kind.CONTROL, target=target, source=self._where.node)
        self._port.send(arbitration_id, control.encode(), fd=fd and self._where.fd)


def _told_by(frame: bytes) -> bytes:
    """The part of a frame that is the same on every link: each numbers and signs its frames by itself."""
    return frame[_SPEAKER : HEADER_BYTES + frame[1]] if frame[0] == MAGIC else frame


async def listen(address: CanAddress, accept: Accept) -> CanListener:
    """Be the controller with this node number, and wait for hosts.

    Raises:
        LinkRefused: the bus cannot be had, or the number is another controller's.
    """
    listener = CanListener(address, accept, await open_port(address))
    try:
        await listener.claim()
    except BaseException:
        await listener.close()
        raise
    return listener
