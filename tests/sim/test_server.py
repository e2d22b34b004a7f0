"""A controller over TCP and on a CAN bus: commanded, watched, photographed and stopped by several clients."""

from __future__ import annotations

import asyncio
import io
import os
import time
from collections.abc import Callable

import pytest
from PIL import Image

from robotree.protocol import Endpoint, Frame
from robotree.protocol.errors import BadUrl
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    AnyMessage,
    Goal,
    GoalState,
    GoalStatus,
    Heartbeat,
    Joints,
    Mode,
    ModeKind,
    PictureRequest,
    Reason,
    SetMode,
    Timesync,
    Tool,
    Verb,
)
from robotree.protocol.services.picture import Picture, PictureReceiver
from robotree.sim.errors import CannotListen, UnknownKind
from robotree.sim.serving.server import serve, serving
from tests.station import PATIENCE, Station

ANY = "tcp:127.0.0.1:0"


def goal(key: int, *args: float) -> Goal:
    return Goal(key, 1, 0, (*args, *(float("nan"),) * (7 - len(args))), Verb.GO_TO, 1, 1)


def is_status(key: int, state: GoalState) -> Callable[[AnyMessage], bool]:
    return lambda m: isinstance(m, GoalStatus) and m.key == key and m.state == state


async def test_an_arm_is_commanded_watched_photographed_and_stopped() -> None:
    async with serving("arm", ANY) as server:
        client = await Station().dial(server.address)
        await client.next(lambda m: isinstance(m, Heartbeat))
        first = await client.next(lambda m: isinstance(m, Tool))
        assert isinstance(first, Tool)
        client.say(goal(1, first.x + 0.05, first.y, first.z - 0.02))
        await client.next(lambda m: isinstance(m, Tool) and m.busy == 1)
        await client.next(is_status(1, GoalState.SUCCEEDED))
        await client.next(lambda m: isinstance(m, Tool) and abs(m.x - first.x - 0.05) < 0.004)
        client.say(PictureRequest(width=320, height=180, target_system=1, target_component=100, quality=80))
        picture = await client.picture()
        assert picture.peer.component == 100
        with Image.open(io.BytesIO(picture.data)) as image:
            assert image.size == (320, 180)
        client.say(goal(2, 0.4, 0.2, 0.3, 0.0))
        await client.next(is_status(2, GoalState.ACTIVE))
        client.say(SetMode(0, 0, 0, ModeKind.SAFE_STOP))
        ended = await client.next(is_status(2, GoalState.CANCELLED))
        assert isinstance(ended, GoalStatus)
        assert ended.reason == Reason.STOPPED
        await client.next(lambda m: isinstance(m, Mode) and m.mode == ModeKind.SAFE_STOP)


async def test_of_many_picture_requests_the_newest_of_each_camera_are_answered() -> None:
    async with serving("rover", ANY) as server:
        client = await Station().dial(server.address)
        for width in range(40, 60):
            for camera in (100, 101):
                client.say(PictureRequest(width, 30, 1, camera, 70))
        seen: dict[int, int] = {}
        async with asyncio.timeout(PATIENCE):
            while seen.get(100) != 59 or seen.get(101) != 59:
                picture = await client.picture()
                seen[picture.peer.component] = picture.width
                count = len(client.pictures)
        assert count < 20


async def test_a_camera_that_is_not_there_gives_no_picture_and_does_no_harm() -> None:
    async with serving("rover", ANY) as server:
        client = await Station().dial(server.address)
        client.say(PictureRequest(40, 30, 1, 99, 70))
        client.say(PictureRequest(40, 30, 2, 100, 70))
        client.say(PictureRequest(48, 30, 1, 100, 0))
        assert (await client.picture()).width == 48


async def test_a_taken_port_is_one_clear_sentence() -> None:
    async with serving("rover", ANY) as server:
        with pytest.raises(CannotListen, match="choose another port") as refused:
            await serve("rover", server.address, ready=print)
        assert isinstance(refused.value, OSError)
        assert "\n" not in str(refused.value)


async def test_an_unknown_kind_names_the_known_ones() -> None:
    with pytest.raises(UnknownKind, match="arm, rover"):
        await serve("submarine", ANY, ready=print)


async def test_nobody_listens_for_other_machines_unasked() -> None:
    with pytest.raises(BadUrl):
        await serve("rover", "tcp:0.0.0.0:0", ready=print)


async def test_it_tells_its_address_and_ends_when_cancelled() -> None:
    address: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    running = asyncio.create_task(serve("rover", ANY, ready=address.set_result))
    client = await Station().dial(await address)
    await client.next(lambda m: isinstance(m, Heartbeat))
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running


async def test_a_controller_whose_physics_fails_ends_with_the_reason() -> None:
    async with serving("rover", ANY) as server:
        server._fail(FloatingPointError("the world fell apart"))
        with pytest.raises(FloatingPointError):
            await server.failure


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
