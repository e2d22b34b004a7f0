"""A client for whom there is no place: it is told so, and heard for a moment, for it may ask for a stop.

Its link stays open for `STAY` seconds. So who goes on speaking over datagrams, which open a new link, is told
once in that time and not once per datagram, and nothing of it stays behind.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import UNSIGNED, Sealing
from robotree.protocol.messages import MavSeverity
from robotree.protocol.services.statustext import Speaker
from robotree.sim.firmware import COMPONENT, Outgoing
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.serving.controller import Controller

STAY: Final = 1.0
"""[s] for which it is heard: time enough for a stop that is said after the first word."""
LARGEST_WORD: Final = 16 * 1024
"""[bytes] that it may say meanwhile, about as much as one that is served beside a full house."""


class Bystander:
    """One client that is not served.

    Args:
        link: to the client.
        system: our MAVLink system id.
        controller: hears its stops.
        leave: told when the client has gone.
        word: [bytes] that it may say; the rest is not even parsed.
        security: signs what we say, and decides whom we hear.
    """

    def __init__(
        self,
        link: Link,
        system: int,
        controller: Controller,
        leave: Callable[["Bystander"], None],
        word: int = LARGEST_WORD,
        security: Sealing = UNSIGNED,
    ) -> None:
        self.endpoint = Endpoint(
            link,
            system=system,
            component=COMPONENT,
            on_frame=self._hear,
            on_closed=self._closed,
            **security.seals(link.address),
        )
        self._controller, self._leave = controller, leave
        self._left = word
        self._known = False
        self._end = asyncio.get_running_loop().call_later(STAY, link.close)

    def say(self, text: str) -> None:
        """Tell the client a sentence."""
        for chunk in Speaker().say(MavSeverity.ERROR, text):
            self.endpoint.send(chunk)

    def send(self, outgoing: Outgoing) -> None:
        """Answer its stop; telemetry is for who is served."""
        if not outgoing.telemetry:
            self.endpoint.send(outgoing.message)

    def received(self, data: bytes) -> None:
        """The link tells: bytes came."""
        if heard := data[: self._left]:
            self._left -= len(heard)
            self.endpoint.received(heard)

    def closed(self, reason: LinkError) -> None:
        """The link tells: it has ended."""
        self.endpoint.closed(reason)

    def _hear(self, frame: Frame) -> None:
        if stop_asked_by(frame.message) and frame.is_for(self.endpoint.system, COMPONENT):
            self._known = True
            self._controller.post(frame, self.endpoint)

    def _closed(self, _: LinkError) -> None:
        self._end.cancel()
        if self._known:
            self._controller.leave(self.endpoint)
        self._leave(self)
