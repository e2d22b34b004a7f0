"""A client that is not served, because there are too many: it is told so, and its stops are still obeyed.

Its link stays open for `REFUSED_STAY` seconds. So a client that goes on sending datagrams (which would open a
new link) is told once in that time, not once per datagram.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.messages import MavSeverity
from robotree.protocol.services.statustext import StatustextSender
from robotree.sim.controller.controller import Controller
from robotree.sim.firmware import COMPONENT, Outgoing
from robotree.sim.firmware.stops import stop_asked_by

REFUSED_STAY: Final = 1.0
"""[s] for which it is heard: enough for a stop after its first message."""
MAX_REFUSED_BYTES: Final = 16 * 1024
"""[bytes] that are parsed of it, about as much as of each client when all places are taken."""


class RefusedClient:
    """One client that is not served.

    Args:
        link: to the client.
        system: our MAVLink system id.
        controller: receives its stops.
        leave: called when the client has gone.
        most: [bytes] that are parsed; the rest is dropped.
        security: signs our frames, and checks theirs.
    """

    def __init__(
        self,
        link: Link,
        system: int,
        controller: Controller,
        leave: Callable[["RefusedClient"], None],
        most: int = MAX_REFUSED_BYTES,
        security: LinkSecurity = UNSIGNED,
    ) -> None:
        self.endpoint = Endpoint(
            link,
            system=system,
            component=COMPONENT,
            on_frame=self._hear,
            on_closed=self._closed,
            **security.signer_pair(link.controller),
        )
        self._controller, self._leave = controller, leave
        self._left = most
        self._known = False
        self._end = asyncio.get_running_loop().call_later(REFUSED_STAY, link.close)

    def say(self, text: str) -> None:
        """Tell the client a sentence."""
        for chunk in StatustextSender().say(MavSeverity.ERROR, text):
            self.endpoint.send(chunk)

    def send(self, outgoing: Outgoing) -> None:
        """Answer its stop; telemetry is only for clients that are served."""
        if not outgoing.telemetry:
            self.endpoint.send(outgoing.message, component=outgoing.component)

    def received(self, data: bytes) -> None:
        """Bytes came over the link."""
        if heard := data[: self._left]:
            self._left -= len(heard)
            self.endpoint.received(heard)

    def closed(self, reason: LinkError) -> None:
        """The link has ended."""
        self.endpoint.closed(reason)

    def _hear(self, frame: Frame) -> None:
        if stop_asked_by(frame.message) and frame.is_for(self.endpoint.system, *self._controller.components):
            self._known = True
            self._controller.post(frame, self.endpoint)

    def _closed(self, _: LinkError) -> None:
        self._end.cancel()
        if self._known:
            self._controller.leave(self.endpoint)
        self._leave(self)
