"""A controller on a CAN bus, where a picture takes thousands of frames: it delays nothing but itself."""

from __future__ import annotations

import asyncio
import os
import time

import pytest

from robotree.protocol import Endpoint, Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import Joints, PictureRequest, Timesync
from robotree.protocol.services.picture import Picture, PictureReceiver
from robotree.sim.serving.server import serving

SIZE = (640, 360)


class Looker:
    """Asks for a picture, and for the time again and again until it has come."""

    def __init__(self) -> None:
        self.picture: asyncio.Future[Picture] = asyncio.get_running_loop().create_future()
        self.asked: dict[int, float] = {}
        self.waits: list[float] = []
        """[s] that answers took while the picture was coming."""
        self.joints = 0
        self._receiver = PictureReceiver()

    @property
    def coming(self) -> bool:
        """Whether some of the picture is here, but not all."""
        return self._receiver.statistics.pieces > 0 and not self.picture.done()

    def accept(self, link: Link) -> Endpoint:
        self.mouth = Endpoint(link, system=255, component=190, on_frame=self._hear)
        return self.mouth

    def ask(self) -> None:
        now = time.monotonic_ns()
        self.asked[now] = time.monotonic()
        self.mouth.send(Timesync(0, now))

    def _hear(self, frame: Frame) -> None:
        message = frame.message
        if isinstance(message, Timesync) and message.tc1 and self.coming:
            self.waits.append(time.monotonic() - self.asked[message.ts1])
        self.joints += isinstance(message, Joints) and self.coming
        for picture in self._receiver.receive(frame, None):
            self.picture.set_result(picture)


@pytest.mark.parametrize("fd", [1, 0], ids=["fd", "classic"])
async def test_who_waits_for_a_picture_is_answered_and_told_meanwhile(fd: int) -> None:
    url = f"can:robotree/looks-{os.getpid()}-{fd}?fd={fd}"
    async with serving("arm", url):
        looker = Looker()
        link = await connect(url, looker.accept)
        looker.mouth.send(PictureRequest(*SIZE, target_system=1, target_component=100, quality=95))
        async with asyncio.timeout(60):
            while not looker.picture.done():
                looker.ask()
                await asyncio.wait([looker.picture], timeout=0.02)
        picture = looker.picture.result()
        assert (picture.width, picture.height) == SIZE
        assert len(picture.data) > 20_000
        assert looker.waits, "the picture is not ahead of the answers"
        assert looker.joints, "nor of telemetry"
        link.close()
    await asyncio.sleep(0.05)  # the bus is left in a thread
