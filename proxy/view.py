"""Views: pictures of a workspace, and readings of its instruments; and what proxies stream to who watches.

A view has its own connection to the controller whose cameras it uses, so that pictures never delay a command.
It asks for a picture only on request; requests for the same picture at the same time share one.

A proxy streams places, forces and pictures only while somebody listens. Places and forces are telemetry: each
message of the controller is passed on, as fast as the stream allows. Pictures are asked for as a view does.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import random
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    CameraPose,
    Joints,
    LocalPositionNed,
    MavComponent,
    Message,
    PictureRequest,
    Skeleton,
    Tool,
)
from robotree.protocol.services.peer import Send
from robotree.protocol.services.picture import Picture
from robotree.proxy.connection import Connection, Dial
from robotree.proxy.session import ControllerSession, SessionEvent
from robotree.proxy.translate import UNITS
from robotree.vr.author.stream import Sending
from robotree.vr.base.errors import BadArgument, CommandFailed, VrError
from robotree.vr.base.requests import CameraLens, Shot
from robotree.vr.base.units import Unit

CAMERAS: Mapping[str, int] = {"cell": MavComponent.CAMERA, "wrist": MavComponent.CAMERA2}
"""Cameras by their component of the controller, where a view is given no others."""
RATES: Mapping[type[Message], float] = {Joints: 10.0, Tool: 10.0, LocalPositionNed: 10.0, Skeleton: 2.0}
"""[Hz] at which the poses are enough to be read by people; a controller sends them five times as often, and
on a bus they would take the place of the pictures."""
ANSWER_WITHIN = 1.5
"""[s] in which a picture begins to come, and goes on to come; else it is asked for again. A busy renderer
needs 0.2; on a machine that is busy with other things ten times that, and then the first request is answered
while the second waits."""
ATTEMPTS = 3
"""How many times `ANSWER_WITHIN` a picture may take altogether: 4.5 s, since the caller waits 5 s. One with a
lost packet is dropped. 27 kB need 2.3 s on a classic CAN bus of 500 kbit/s, beside telemetry."""
SMALLEST, LARGEST = 16, 1920
"""[px] Sides of a picture."""


@dataclass(frozen=True, slots=True)
class PictureSpec:
    """Which picture is requested."""

    camera: str
    width: int
    height: int
    quality: int

    @classmethod
    def of(cls, camera: str, width: int, height: int, quality: int) -> PictureSpec:
        """Make a spec within the possible sizes: too large or too small a picture keeps its aspect ratio.

        A camera shows more to the sides the wider its picture is, so another ratio would show something else.
        """
        sides = max(1, width), max(1, height)
        scale = min(1.0, LARGEST / max(sides)) * max(1.0, SMALLEST / min(sides))
        width, height = (max(SMALLEST, min(LARGEST, round(side * scale))) for side in sides)
        return cls(camera, width, height, max(1, min(100, quality)))


class WorkspaceView:
    """Shows one workspace through the cameras of a controller."""

    reading_units: Mapping[str, str] = UNITS
    """Symbol of the unit of each instrument."""

    def __init__(
        self,
        name: str,
        url: str,
        *,
        answer_within: float = ANSWER_WITHIN,
        dial: Dial = connect,
        chance: random.Random | None = None,
        security: LinkSecurity = UNSIGNED,
        cameras: Mapping[str, int] = CAMERAS,
    ) -> None:
        """Prepare the view; nothing is opened before `run`. Most arguments are as for `Connection`.

        A picture begins to come, and goes on to come, within `answer_within` [s]. `cameras` are components of
        the controller by the name of the camera; the first one is the default.
        """
        self.name, self._cameras = name, dict(cameras)
        self.frame = url
        """Names W, in which its cameras are: that of the robots of the same controller."""
        self._answer_within = answer_within
        self._session = ControllerSession(component=MavComponent.ONBOARD_COMPUTER, rates=RATES)
        self._connection = Connection(
            url, self._session, on_event=self._hear, dial=dial, chance=chance, security=security
        )
        self._shared: dict[PictureSpec, asyncio.Task[Shot]] = {}
        self._turn: dict[str, asyncio.Lock] = {camera: asyncio.Lock() for camera in self._cameras}
        self._expected: dict[int, asyncio.Future[Shot]] = {}

    @property
    def online(self) -> bool:
        """Whether the controller can be asked; when not, the readings are old."""
        return self._session.online

    @property
    def cameras(self) -> Sequence[str]:
        """Names of the cameras; the first one is the default."""
        return tuple(self._cameras)

    @property
    def skeleton(self) -> Sequence[tuple[float, float, float]]:
        """Where the joints of the arm are in `frame` [m], from its foot to its tool; empty: nobody says."""
        told = self._session.twin.latest(Skeleton)
        if told is None:
            return ()
        places = [*zip(told.x, told.y, told.z, strict=True)][: told.count]
        return tuple(place for place in places if all(map(math.isfinite, place)))

    def readings(self) -> dict[str, float]:
        """Return the last known readings of the workspace's instruments; `age` [s] is their age."""
        return self._session.twin.readings(self._connection.now())

    async def run(self) -> None:
        """Keep the connection up until cancelled.

        Raises:
            BadUrl: the controller's address means nothing.
        """
        await self._connection.run()

    async def look(self, camera: str = "", width: int = 320, height: int = 180, quality: int = 75) -> bytes:
        """Take one picture, as `shoot`, without where the camera was."""
        return (await self.shoot(camera, width, height, quality)).jpeg

    async def shoot(self, camera: str = "", width: int = 320, height: int = 180, quality: int = 75) -> Shot:
        """Take one picture.

        Args:
            camera: one of `cameras`; empty: the first.
            width: [px]
            height: [px]
            quality: of the JPEG, 1 to 100.

        Returns:
            The picture, and where the camera was in it, if the controller says so.

        Raises:
            BadArgument: the view has no such camera.
            CommandFailed: the controller is offline or does not send a picture.
        """
        camera = camera or self.cameras[0]
        if camera not in self._cameras:
            reason = f"there is no camera {camera!r}; there is: {', '.join(self.cameras)}"
            raise BadArgument(command=f"{self.name}.look", parameter="camera", reason=reason)
        spec = PictureSpec.of(camera, width, height, quality)
        task = self._shared.get(spec)
        if task is None:
            task = self._shared[spec] = asyncio.get_running_loop().create_task(self._fetch(spec))
            task.add_done_callback(lambda ended: self._shown(spec, ended))
        # One caller that is cancelled must not cancel the picture of the others.
        return await asyncio.shield(task)

    async def _fetch(self, spec: PictureSpec) -> Shot:
        """Ask each camera for one picture at a time: a picture does not name the request that it answers."""
        patience = ATTEMPTS * self._answer_within
        async with self._turn[spec.camera]:
            ends = self._connection.now() + patience
            while ends - self._connection.now() > self._answer_within / 10:
                if not self._session.online:
                    raise self._failed(self._session.trouble)
                if (shot := await self._ask(spec, ends)) is not None:
                    return shot
        raise self._failed(f"no whole picture came from camera {spec.camera} within {patience:g} s")

    async def _ask(self, spec: PictureSpec, ends: float) -> Shot | None:
        """Ask once, and wait while pieces come, until the moment `ends` [s]; None: no whole picture came."""
        component, system = self._cameras[spec.camera], self._session.controller.system
        request = PictureRequest(spec.width, spec.height, system, component, spec.quality)
        expected: asyncio.Future[Shot]
        expected = self._expected[component] = asyncio.get_running_loop().create_future()
        self._connection.perform([Send(request)])
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

    def _shown(self, spec: PictureSpec, ended: asyncio.Task[Shot]) -> None:
        self._shared.pop(spec, None)
        if not ended.cancelled():
            ended.exception()  # was told to everyone who still looks

    def _hear(self, event: SessionEvent) -> None:
        if isinstance(event, Picture):
            expected = self._expected.get(event.peer.component)
            if expected is not None and not expected.done():
                component = event.peer.component
                expected.set_result(Shot(event.data, _lens(self._session.take_camera_pose(component))))


def _lens(pose: CameraPose | None) -> CameraLens | None:
    """Return what a controller says of its camera; None: nothing, or nothing that can be."""
    if pose is None or not all(map(math.isfinite, (pose.x, pose.y, pose.z, *pose.q, pose.fovy))):
        return None
    if not (0.0 < pose.fovy < math.pi and any(pose.q)):
        return None
    w, x, y, z = pose.q
    return CameraLens(x=pose.x, y=pose.y, z=pose.z, qw=w, qx=x, qy=y, qz=z, fovy=pose.fovy)


OFTEN = 20.0
"""[1/s] places and forces at most."""
PICTURES = 2.0
"""[1/s] pictures at most: a simulated camera takes a seventh of a second of a core for each."""
PATIENT = 5.0
"""[s] in which a picture begins to come: nobody waits for one, so it may be longer than for a view."""
SIZE = 640, 480
"""[px] of a picture."""
QUALITY = 92
"""Of the JPEG: markers are read from it."""
LOOK = 0.1
"""[s] between two looks whether somebody listens."""
AGAIN = 1.0
"""[s] after a picture that did not come."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class FloorPlace:
    """Where a base stands, in the frame of its floor."""

    x: Annotated[float, Unit("m")]
    y: Annotated[float, Unit("m")]
    heading: Annotated[float, Unit("rad"), "counterclockwise from x; 0 where a base does not turn"]


@dataclass(frozen=True, slots=True)
class ToolPose:
    """Where a tool is, in the arm's frame W: its point, and its orientation as a unit quaternion."""

    x: Annotated[float, Unit("m")]
    y: Annotated[float, Unit("m")]
    z: Annotated[float, Unit("m")]
    qw: float
    qx: float
    qy: float
    qz: float


@dataclass(frozen=True, slots=True)
class ToolForce:
    """What a tool feels, in the arm's frame W."""

    fx: Annotated[float, Unit("N")]
    fy: Annotated[float, Unit("N")]
    fz: Annotated[float, Unit("N")]


@dataclass(frozen=True, slots=True)
class Gaze:
    """How a neck is turned."""

    pan: Annotated[float, Unit("rad"), "to the left"]
    tilt: Annotated[float, Unit("rad"), "downward"]


@dataclass(frozen=True, slots=True)
class CameraPicture:
    """One picture of a camera that a robot carries."""

    jpeg: bytes
    camera: str
    number: Annotated[int, "grows by one with each"]


class PictureShow:
    """Streams the pictures of one camera while somebody listens.

    Args:
        pictures: the stream, when it is asked for.
        open_view: makes the view that takes them.
        camera: its name in that view.
    """

    def __init__(
        self,
        pictures: Callable[[], Sending[CameraPicture]],
        open_view: Callable[[], WorkspaceView],
        camera: str,
    ) -> None:
        self._pictures, self._open_view, self._camera = pictures, open_view, camera
        self._number = 0

    async def run(self) -> None:
        """Show until cancelled; the connection is there only while somebody listens."""
        while True:
            while not self._pictures().wanted:  # noqa: ASYNC110 # the transport tells nobody who listens
                await asyncio.sleep(LOOK)
            async with _connected(self._open_view()) as view:
                await self._show(view)

    async def _show(self, view: WorkspaceView) -> None:
        while self._pictures().wanted:
            try:
                jpeg = await view.look(self._camera, *SIZE, QUALITY)
            except VrError as error:  # its controller is away, or busy
                _log.info("no picture: %s", error)
                await asyncio.sleep(AGAIN)
                continue
            self._number += 1
            self._pictures().send(CameraPicture(jpeg, self._camera, self._number))
            await asyncio.sleep(1.0 / PICTURES)


@contextlib.asynccontextmanager
async def _connected(view: WorkspaceView) -> AsyncGenerator[WorkspaceView]:
    running = asyncio.ensure_future(view.run())
    try:
        yield view
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
