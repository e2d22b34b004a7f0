"""Views: pictures of a workspace, and what its instruments read.

A view keeps its own connection to the controller whose cameras it uses, so that pictures never delay a
command. It asks for a picture only when somebody looks, and several who look at the same thing at the same
time share one.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from robotree.protocol.links.security import UNSIGNED, Sealing
from robotree.protocol.links.url import connect
from robotree.protocol.messages import Joints, LocalPositionNed, MavComponent, Message, PictureRequest, Tool
from robotree.protocol.services.picture import Picture
from robotree.proxy.connection import Connection, Dial
from robotree.proxy.session import Event, Session
from robotree.proxy.translate import UNITS
from robotree.vr.errors import BadArgument, CommandFailed

CAMERAS = {"cell": MavComponent.CAMERA, "wrist": MavComponent.CAMERA2}
"""Which component of the controller is which camera. The first one is looked through when none is named."""
RATES: Mapping[type[Message], float] = {Joints: 10.0, Tool: 10.0, LocalPositionNed: 10.0}
"""[Hz] at which the poses are enough to be read by people; a controller sends them five times as often, and
on a bus they would take the place of the pictures."""
ANSWER_WITHIN = 1.5
"""[s] in which a picture begins to come, and goes on to come; else it is asked for again. A busy renderer
needs 0.2; on a machine that is busy with other things ten times that, and then the first request is answered
while the second waits."""
ATTEMPTS = 3
"""How many times `ANSWER_WITHIN` a picture may take, all in all: 4.5 s, since whoever looks waits 5 s. One
with a hole is dropped on the way. 27 kB need 2.3 s on a classic CAN bus of 500 kbit/s, beside telemetry."""
SMALLEST, LARGEST = 16, 1920
"""[px] Sides of a picture."""


@dataclass(frozen=True, slots=True)
class Wish:
    """One picture that somebody wants."""

    camera: str
    width: int
    height: int
    quality: int

    @classmethod
    def of(cls, camera: str, width: int, height: int, quality: int) -> Wish:
        """Take a wish, moved into what can be had: too large or too small a picture keeps its shape.

        A camera shows more to the sides the wider its picture is, so another shape would be another view.
        """
        sides = max(1, width), max(1, height)
        scale = min(1.0, LARGEST / max(sides)) * max(1.0, SMALLEST / min(sides))
        width, height = (max(SMALLEST, min(LARGEST, round(side * scale))) for side in sides)
        return cls(camera, width, height, max(1, min(100, quality)))


class WorkspaceView:
    """Looks at one workspace through the cameras of a controller."""

    def __init__(
        self,
        name: str,
        url: str,
        *,
        answer_within: float = ANSWER_WITHIN,
        dial: Dial = connect,
        chance: random.Random | None = None,
        security: Sealing = UNSIGNED,
    ) -> None:
        """Prepare the view; nothing is opened before `run`.

        Args:
            name: of the view, for messages.
            url: where the controller listens.
            answer_within: [s] in which a picture begins to come, and goes on to come.
            dial: opens a link.
            chance: for the waits between attempts to connect.
            security: the keys of our links.
        """
        self.name = name
        self._answer_within = answer_within
        self._session = Session(component=MavComponent.ONBOARD_COMPUTER, rates=RATES)
        self._connection = Connection(
            url, self._session, on_event=self._hear, dial=dial, chance=chance, security=security
        )
        self._shared: dict[Wish, asyncio.Task[bytes]] = {}
        self._turn: dict[str, asyncio.Lock] = {camera: asyncio.Lock() for camera in CAMERAS}
        self._expected: dict[int, asyncio.Future[bytes]] = {}

    @property
    def online(self) -> bool:
        """Whether the controller can be asked; when not, the readings are old."""
        return self._session.online

    @property
    def cameras(self) -> Sequence[str]:
        """What can be looked through; the first one is the default."""
        return tuple(CAMERAS)

    @property
    def reading_units(self) -> Mapping[str, str]:
        """Symbol of the unit of each instrument."""
        return UNITS

    def readings(self) -> dict[str, float]:
        """Return the last known readings of the workspace's instruments; `age` [s] tells how old they are."""
        return self._session.twin.readings(self._connection.now())

    async def run(self) -> None:
        """Keep the connection up until cancelled.

        Raises:
            BadUrl: the controller's address means nothing.
        """
        await self._connection.run()

    async def look(self, camera: str = "", width: int = 320, height: int = 180, quality: int = 75) -> bytes:
        """Take one picture.

        Args:
            camera: one of `cameras`; empty: the first.
            width: [px]
            height: [px]
            quality: of the JPEG, 1 to 100.

        Returns:
            The picture as JPEG.

        Raises:
            BadArgument: the view has no such camera.
            CommandFailed: the controller is offline or does not send a picture.
        """
        camera = camera or self.cameras[0]
        if camera not in CAMERAS:
            reason = f"there is no camera {camera!r}; there is: {', '.join(self.cameras)}"
            raise BadArgument(command=f"{self.name}.look", parameter="camera", reason=reason)
        wish = Wish.of(camera, width, height, quality)
        task = self._shared.get(wish)
        if task is None:
            task = self._shared[wish] = asyncio.get_running_loop().create_task(self._fetch(wish))
            task.add_done_callback(lambda ended: self._shown(wish, ended))
        # Whoever stops looking must not take the picture away from the others.
        return await asyncio.shield(task)

    async def _fetch(self, wish: Wish) -> bytes:
        """Ask for one picture at a time from each camera: the wire does not say which request it answers."""
        patience = ATTEMPTS * self._answer_within
        async with self._turn[wish.camera]:
            ends = self._connection.now() + patience
            while ends - self._connection.now() > self._answer_within / 10:
                if not self._session.online:
                    raise self._failed(self._session.trouble)
                if (jpeg := await self._ask(wish, ends)) is not None:
                    return jpeg
        raise self._failed(f"no whole picture came from camera {wish.camera} within {patience:g} s")

    async def _ask(self, wish: Wish, ends: float) -> bytes | None:
        """Ask once, and wait while pieces come, until the moment `ends` [s]; None: no whole picture came."""
        component, system = CAMERAS[wish.camera], self._session.controller.system
        request = PictureRequest(wish.width, wish.height, system, component, wish.quality)
        expected: asyncio.Future[bytes]
        expected = self._expected[component] = asyncio.get_running_loop().create_future()
        self._connection.perform(self._session.ask_for(request))
        before = -1
        try:
            while (left := ends - self._connection.now()) > 0 and before != (before := self._session.pieces):
                await asyncio.wait([expected], timeout=min(self._answer_within, left))
                if expected.done():
                    return expected.result()
            return None
        finally:
            self._expected.pop(component, None)

    def _failed(self, detail: str) -> CommandFailed:
        return CommandFailed(robot=self.name, command="look", detail=detail)

    def _shown(self, wish: Wish, ended: asyncio.Task[bytes]) -> None:
        self._shared.pop(wish, None)
        if not ended.cancelled():
            ended.exception()  # was told to everyone who still looks

    def _hear(self, event: Event) -> None:
        if isinstance(event, Picture):
            expected = self._expected.get(event.peer.component)
            if expected is not None and not expected.done():
                expected.set_result(event.data)
