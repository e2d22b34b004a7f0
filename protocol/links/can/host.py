"""The host's side of a bus: one link with one controller."""

from __future__ import annotations

import asyncio
import random
import secrets
from typing import TYPE_CHECKING

from robotree.protocol.errors import LinkBroken, LinkClosed, LinkRefused
from robotree.protocol.isotp.frames import CLASSIC, FD, SingleFrame, decode
from robotree.protocol.links.can.control import Code, Control, SilenceTimer, read
from robotree.protocol.links.can.identifiers import (
    EVERYBODY,
    HOSTS,
    ROUTE,
    Kind,
    Priority,
    identifier,
    route,
)
from robotree.protocol.links.can.link import CanLink, Ends
from robotree.protocol.links.can.port import Port, open_port

if TYPE_CHECKING:
    from can import Message

    from robotree.protocol.links.can.address import CanAddress
    from robotree.protocol.links.link import Accept

CONNECT_TIMEOUT = 2.5
"""[s]; a controller that knows nothing of sessions says its heartbeat once per second."""
_ASK_AGAIN = 0.2
"""[s]"""
_STRANGER_AFTER = 1.0
"""[s] of unanswered questions after which a controller that speaks counts as one without sessions."""


class Host:
    """One host on a bus. Made by `connect`."""

    def __init__(self, address: CanAddress, accept: Accept, port: Port) -> None:
        self._address, self._accept, self._port = address, accept, port
        port.user = self
        self._loop = asyncio.get_running_loop()
        self._link: asyncio.Future[CanLink] = self._loop.create_future()
        self._began = self._loop.time()
        self._last_word = f"no controller with node={address.node} answers on this bus"
        self._broadcast_route = route(Kind.BROADCAST, target=EVERYBODY, source=address.node)
        self._choose_number()

    async def open(self) -> CanLink:
        """Ask the controller for a session until it answers.

        Raises:
            LinkRefused: it does not, or our number is another host's.
        """
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT):
                while True:
                    self._control(Control(Code.OPEN, self._session))
                    done, _ = await asyncio.wait([self._link], timeout=_ASK_AGAIN)
                    if done:
                        return self._link.result()
        except TimeoutError:
            raise LinkRefused(str(self._address), self._last_word) from None

    def heard(self, message: Message) -> None:
        """A data frame arrived."""
        way = message.arbitration_id & ROUTE
        if not message.is_extended_id:
            return
        if way == self._data_route:
            if self._link.done():
                self._link.result().heard(message)
            else:
                self._controller_speaks()
        elif way == self._broadcast_route:
            self._heard_by_all(message)
        elif way == self._control_route and (control := read(bytes(message.data))) is not None:
            self._controlled(control)

    def room(self) -> None:
        """The bus has accepted all waiting frames."""
        if self._link.done():
            self._link.result().pump()

    def broke(self, cause: str) -> None:
        """The bus is broken."""
        if self._link.done():
            self._link.result().end(LinkBroken(str(self._address), cause))
        else:
            self._link.set_exception(LinkRefused(str(self._address), cause))

    def _choose_number(self) -> None:
        address = self._address
        self._number = random.choice(HOSTS) if address.host is None else address.host
        self._session = secrets.randbits(32)
        ends = {"target": self._number, "source": address.node}
        self._data_route = route(Kind.ADDRESSED, **ends)
        self._control_route = route(Kind.CONTROL, **ends)

    def _heard_by_all(self, message: Message) -> None:
        frame = decode(bytes(message.data))
        if not isinstance(frame, SingleFrame):
            return
        if self._link.done():
            self._link.result().alive()
            self._link.result().deliver(frame.data)
        else:
            self._controller_speaks()

    def _controller_speaks(self) -> None:
        """A controller that speaks and does not answer knows nothing of sessions."""
        if self._loop.time() - self._began > _STRANGER_AFTER:
            self._begin(None)

    def _controlled(self, control: Control) -> None:
        if control.session != self._session:
            return
        if not self._link.done():
            if control.code == Code.ACCEPT:
                self._begin(self._session)
            elif control.code == Code.REFUSE:
                self._last_word = f"another host has number {self._number}; leave host= out"
                self._choose_number()
        elif control.code == Code.CLOSE:
            self._link.result().end(LinkClosed(str(self._address), by_us=False))
        else:
            self._link.result().alive()

    def _begin(self, session: int | None) -> None:
        address = self._address
        link = CanLink(
            self._port,
            str(address),
            Ends(own=self._number, partner=address.node, toward=Priority.TO_CONTROLLER),
            SilenceTimer(self._loop.time(), session, address.silence),
            FD if address.fd else CLASSIC,
            on_end=self._leave,
        )
        self._link.set_result(link)
        link.begin(self._accept)

    def _leave(self, _: CanLink) -> None:
        self._port.leave()

    def _control(self, control: Control) -> None:
        arbitration_id = identifier(
            Priority.FLOW, Kind.CONTROL, target=self._address.node, source=self._number
        )
        self._port.send(arbitration_id, control.encode(), fd=self._address.fd)


async def connect(address: CanAddress, accept: Accept) -> CanLink:
    """Open a link to a controller.

    Raises:
        LinkRefused: the bus cannot be had, or the controller does not answer.
    """
    port = await open_port(address)
    try:
        return await Host(address, accept, port).open()
    except BaseException:
        await port.leave()
        raise
