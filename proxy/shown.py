"""What proxies stream to whoever watches: places, forces and pictures, only while somebody listens.

Places and forces are telemetry: each message of the controller is passed on, as fast as the stream allows.
Pictures are asked for over a connection of their own, as a view does, so that they never delay a command.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator, Callable
from dataclasses import dataclass
from typing import Annotated

from robotree.proxy.view import WorkspaceView
from robotree.vr.author.stream import Sending
from robotree.vr.base.errors import VrError
from robotree.vr.base.units import Unit

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
