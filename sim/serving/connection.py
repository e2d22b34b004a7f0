"""One client of the controller: its frames go to the inbox, the pictures that it requests come back.

At most one picture is rendered at a time; of further requests the newest per camera waits. Pieces of a
picture are sent no faster than the client reads them.

A client that is not served, because there are too many, is told so, and its stops are still obeyed. Its link
stays open for `REFUSED_STAY` seconds. So a client that goes on sending datagrams (which would open a new
link) is told once in that time, not once per datagram.
"""

import asyncio
import logging
from collections.abc import Callable
from math import inf
from typing import Final

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import KeyRefused, LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.rejection import cause, rejection
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.messages import MavSeverity, PictureRequest, SetupSigning
from robotree.protocol.services.picture import split
from robotree.protocol.services.statustext import StatustextSender
from robotree.sim.controller.controller import Controller
from robotree.sim.firmware import COMPONENT, Outgoing
from robotree.sim.firmware.stops import stop_asked_by
from robotree.sim.serving.render_thread import RenderThread

_log = logging.getLogger(__name__)

WINDOW: Final = 2048
"""[bytes] that may wait for a client before a piece of a picture waits, too. This bounds how long a slow line
delays other messages."""
BREATH: Final = 0.005
"""[s] between two checks of what still waits."""


class Connection:
    """One client: its frames go to the controller, its pictures come back.

    Args:
        link: to the client.
        system: our MAVLink system id.
        controller: hears the client.
        darkroom: draws for it.
        leave: told when the client has gone.
        rotated: called when the client has changed the key: who it was, and the client's system id.
        security: signs our frames, and checks theirs.
    """

    def __init__(
        self,
        link: Link,
        system: int,
        controller: Controller,
        render_thread: RenderThread,
        leave: Callable[["Connection"], None],
        rotated: Callable[["Connection", int], None],
        security: LinkSecurity = UNSIGNED,
    ) -> None:
        self._security, self._signer_pair = security, security.signer_pair(link.controller)
        self.endpoint = Endpoint(
            link,
            system=system,
            component=COMPONENT,
            on_frame=self._hear,
            on_closed=self._closed,
            **self._signer_pair,
        )
        self._controller, self._render_thread, self._leave, self._rotated = (
            controller,
            render_thread,
            leave,
            rotated,
        )
        self._stops: int | None = None
        self.heard = -inf
        """When the last intact frame came, [s] on the loop's clock."""
        self._over = False
        self._wanted: dict[int, PictureRequest] = {}
        self._drawing: asyncio.Task[None] | None = None
        self._keys_refused = self._refused = 0
        self._said: set[str] = set()
        controller.greet(self.endpoint)

    @property
    def garbled(self) -> int:
        """How much was not accepted: bad, unknown or wrongly signed frames, and refused keys."""
        heard = self.endpoint.statistics
        return heard.bad_crc + heard.unknown + heard.incompatible + heard.refused + self._keys_refused

    def received(self, data: bytes, stops: int | None) -> None:
        """Bytes came; `stops`: how many stops had arrived when they began to wait; None: they did not."""
        self._stops = stops
        self.endpoint.received(data)
        if (refused := self.endpoint.statistics.refused) > self._refused:
            self._refused = refused
            self._explain()

    def closed(self, reason: LinkError) -> None:
        """The link has ended."""
        self.endpoint.closed(reason)

    def set_signer_pair(self) -> None:
        """Sign, and hear, with the key that the link has now."""
        self._signer_pair = self._security.signer_pair(self.endpoint.link.controller)
        self.endpoint.set_signer_pair(**self._signer_pair)

    def send(self, outgoing: Outgoing) -> None:
        """Send something to this client."""
        self.endpoint.send(
            outgoing.message,
            telemetry=outgoing.telemetry,
            instance=outgoing.instance,
            component=outgoing.component,
        )

    def refuse(self, text: str) -> None:
        """Tell the client why it is not served (any more), and end the link."""
        self.say(MavSeverity.ERROR, text)
        self.endpoint.link.close()

    def say(self, severity: MavSeverity, text: str) -> None:
        """Tell the client a sentence."""
        for chunk in StatustextSender().say(severity, text):
            self.endpoint.send(chunk)

    def _explain(self) -> None:
        """Tell the client once per cause why its frames are refused."""
        verifier = self._signer_pair["verifier"]
        why = None if verifier is None else cause(verifier)
        if why is not None and why.kind not in self._said:
            self._said.add(why.kind)
            self.say(MavSeverity.WARNING, f"Your frames are refused: {why.why}.")

    def _hear(self, frame: Frame) -> None:
        self.heard = asyncio.get_running_loop().time()
        message = frame.message
        if self._over and not stop_asked_by(message):  # rest of a piece whose first part ended the link
            return
        if isinstance(message, SetupSigning):
            self._set_up(frame, message)
            return
        if not isinstance(message, PictureRequest):
            self._controller.post(frame, self.endpoint, self._stops)
            return
        ours = (
            message.target_system == self.endpoint.system
            and message.target_component in self._controller.cameras
        )
        if ours:
            self._wanted[message.target_component] = message
            if self._drawing is None:
                self._drawing = asyncio.create_task(
                    self._draw_wanted(), name=f"pictures for {self.endpoint.link.address}"
                )

    def _set_up(self, frame: Frame, message: SetupSigning) -> None:
        """Take a key from a client that has the present one; the message is neither logged nor passed on.

        MAVLink has no answer to it; the reason of a refusal is sent once.
        """
        if not frame.is_for(self.endpoint.system, COMPONENT):
            return
        link, secret, moment = self.endpoint.link, message.secret_key, message.initial_timestamp
        try:
            changed = self._security.rotate(link, self._signer_pair, secret, moment)
        except KeyRefused as error:
            self._keys_refused += 1
            if (text := str(error)) not in self._said:
                self._said.add(text)
                self.say(MavSeverity.WARNING, text)
        else:
            if changed:
                self._rotated(self, frame.system)

    async def _draw_wanted(self) -> None:
        try:
            while self._wanted:
                await self._room()
                request = self._wanted.pop(next(iter(self._wanted)))
                data, width, height, pose = await self._render_thread.render(request)
                pieces = split(data, width=width, height=height, quality=request.quality)
                for message in (pose, *pieces):
                    await self._room()
                    self.endpoint.send(message, component=request.target_component)
        finally:
            self._drawing = None

    async def _room(self) -> None:
        """Wait until a piece of a picture would leave soon. Other messages go in between."""
        while self.endpoint.link.statistics.waiting > WINDOW:  # noqa: ASYNC110  links have no event for it
            await asyncio.sleep(BREATH)

    def _closed(self, _: LinkError) -> None:
        self._over = True
        if self._drawing is not None:
            self._drawing.cancel()
        self._controller.leave(self.endpoint)
        self._leave(self)
        if cause := rejection(self._signer_pair["verifier"]):
            _log.warning("%s: %s", self.endpoint.link.address, cause)


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
