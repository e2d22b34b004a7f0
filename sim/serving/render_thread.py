"""The thread that renders pictures, so that neither the physics nor the answers wait for them."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

from robotree.protocol.messages import CameraPose, PictureRequest
from robotree.sim.controller.controller import Controller
from robotree.sim.physics.camera import Renderer, fit, jpeg

_WORD: Final = 0xFFFFFFFF


class Rendered(NamedTuple):
    """A picture.

    Attributes:
        jpeg: its bytes.
        width: [px]
        height: [px]
        pose: where the camera was in it.
    """

    jpeg: bytes
    width: int
    height: int
    pose: CameraPose


class RenderThread:
    """Renders pictures in one thread, one after the other.

    Args:
        controller: whose cell and cameras.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._renderer = Renderer(controller.cell.model)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="render")

    async def render(self, request: PictureRequest) -> Rendered:
        """The requested picture."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._render, request)

    def close(self) -> None:
        """End the thread after its present picture."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _render(self, request: PictureRequest) -> Rendered:
        width, height = fit(request.width, request.height)
        camera = self._controller.cameras[request.target_component]
        now = self._controller.cell.time_ms
        picture = self._renderer.picture(self._controller.cell.published, camera, width, height)
        (x, y, z), rotation, fovy = self._renderer.pose(camera)
        pose = CameraPose(now & _WORD, x, y, z, rotation, fovy)
        return Rendered(jpeg(picture, request.quality), width, height, pose)
