"""One client of the controller: what it says is heard, what it asks to see is drawn.

It has at most one picture in the making; of further requests the newest per camera waits, and pieces go out
no faster than the client reads them.
"""

import asyncio
import logging
from collections.abc import Callable
from typing import Final

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import UNSIGNED, Sealing
from robotree.protocol.messages import MavSeverity, PictureRequest, SetupSigning
from robotree.protocol.services.picture import split
from robotree.protocol.services.statustext import Speaker
from robotree.sim.controller import Controller
from robotree.sim.darkroom import Darkroom
from robotree.sim.firmware import COMPONENT, Outgoing

_log = logging.getLogger(__name__)

KEY_REFUSED: Final = "Keys are not taken over the wire; give the controller a key file, and start it again."
WINDOW: Final = 2048
"""Bytes that may wait for a client before a piece of a picture waits, too: so a slow line delays what else is
said by no more than these."""
BREATH: Final = 0.005
"""Between two looks whether they still wait [s]."""


class Connection:
    """One client: what it says goes to the controller, the pictures it asks for come back.

    Args:
        link: to the client.
        system: our MAVLink system id.
        controller: hears the client.
        darkroom: draws for it.
        leave: told when the client has gone.
        security: signs what we say, and decides whom we hear.
    """

    def __init__(
        self,
        link: Link,
        system: int,
        controller: Controller,
        darkroom: Darkroom,
        leave: Callable[["Connection"], None],
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
        self._controller, self._darkroom, self._leave = controller, darkroom, leave
        self.spoken = False
        """Whether an intact frame has come."""
        self._wanted: dict[int, PictureRequest] = {}
        self._drawing: asyncio.Task[None] | None = None
        self._key_refused = False
        controller.greet(self.endpoint)

    @property
    def garbled(self) -> int:
        """What this client said in vain: no frame, no message that we know, or not signed as it must be."""
        heard = self.endpoint.statistics
        return heard.bad_crc + heard.unknown + heard.incompatible + heard.refused

    def send(self, outgoing: Outgoing) -> None:
        """Say something to this client."""
        self.endpoint.send(outgoing.message, telemetry=outgoing.telemetry, instance=outgoing.instance)

    def refuse(self, text: str) -> None:
        """Tell the client why it is not served (any more), and end the link."""
        for chunk in Speaker().say(MavSeverity.ERROR, text):
            self.endpoint.send(chunk)
        self.endpoint.link.close()

    def _hear(self, frame: Frame) -> None:
        self.spoken = True
        message = frame.message
        if isinstance(message, SetupSigning):
            self._refuse_key()
            return
        if not isinstance(message, PictureRequest):
            self._controller.post(frame, self.endpoint)
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

    def _refuse_key(self) -> None:
        """A key that comes over the wire is never taken: any program of this machine could lock us out.

        Said once, and neither logged nor passed on.
        """
        if not self._key_refused:
            self._key_refused = True
            for chunk in Speaker().say(MavSeverity.WARNING, KEY_REFUSED):
                self.endpoint.send(chunk)

    async def _draw_wanted(self) -> None:
        try:
            while self._wanted:
                await self._room()
                request = self._wanted.pop(next(iter(self._wanted)))
                data, width, height = await self._darkroom.develop(request)
                for message in split(data, width=width, height=height, quality=request.quality):
                    await self._room()
                    self.endpoint.send(message, component=request.target_component)
        finally:
            self._drawing = None

    async def _room(self) -> None:
        """Wait until a piece of a picture would leave soon. What else is said goes in between."""
        while self.endpoint.link.statistics.waiting > WINDOW:  # noqa: ASYNC110  links do not tell
            await asyncio.sleep(BREATH)

    def _closed(self, _: LinkError) -> None:
        if self._drawing is not None:
            self._drawing.cancel()
        self._controller.leave(self.endpoint)
        self._leave(self)
        if refused := self.endpoint.statistics.refused:
            _log.warning(
                "%s: %d frames were refused, for they were not signed with our key",
                self.endpoint.link.address,
                refused,
            )
