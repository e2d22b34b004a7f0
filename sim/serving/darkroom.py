"""Where pictures are drawn: a thread of its own, so that neither the arm nor the answers wait for them."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

from robotree.protocol.messages import PictureRequest
from robotree.sim.physics.camera import Studio, fit, jpeg
from robotree.sim.serving.controller import Controller


class Darkroom:
    """Draws pictures in a thread of its own, one after the other.

    Args:
        controller: whose cell and cameras.
    """

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._studio = Studio(controller.cell.model)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="darkroom")

    async def develop(self, request: PictureRequest) -> tuple[bytes, int, int]:
        """The JPEG that was asked for, its width and its height [px]."""
        return await asyncio.get_running_loop().run_in_executor(self._thread, self._draw, request)

    def close(self) -> None:
        """End the thread when its picture is done."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _draw(self, request: PictureRequest) -> tuple[bytes, int, int]:
        width, height = fit(request.width, request.height)
        camera = self._controller.cameras[request.target_component]
        picture = self._studio.picture(self._controller.cell.published, camera, width, height)
        return jpeg(picture, request.quality), width, height
