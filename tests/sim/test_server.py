"""A controller over real TCP: commanded, watched, photographed and stopped; and several clients at once."""

from __future__ import annotations

import asyncio
import io
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
    MavAutopilot,
    MavState,
    MavType,
    Mode,
    ModeKind,
    PictureRequest,
    Reason,
    SetMode,
    Tool,
    Verb,
)
from robotree.protocol.services.picture import Picture, PictureReceiver
from robotree.sim.errors import CannotListen, UnknownKind
from robotree.sim.serving.server import serve, serving

ANY = "tcp:127.0.0.1:0"
PATIENCE = 30.0


class Client:
    """Somebody at the other end of the socket."""

    def __init__(self, component: int = 190) -> None:
        self.component = component
        self.heard: list[AnyMessage] = []
        self.everything: list[AnyMessage] = []
        self.pictures: list[Picture] = []
        self._receiver = PictureReceiver()
        self._news = asyncio.Event()

    async def dial(self, address: str) -> Client:
        self.link = await connect(address, self._accept)
        self.say(Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE))
        return self

    def say(self, message: AnyMessage) -> None:
        self._endpoint.send(message)

    async def until(self, happened: Callable[[AnyMessage], bool]) -> AnyMessage:
        """The next message of that kind; what came before it is not looked at again."""
        async with asyncio.timeout(PATIENCE):
            while True:
                while self.heard:
                    if happened(message := self.heard.pop(0)):
                        return message
                self._news.clear()
                await self._news.wait()

    async def picture(self) -> Picture:
        async with asyncio.timeout(PATIENCE):
            while not self.pictures:
                self._news.clear()
                await self._news.wait()
        return self.pictures.pop(0)

    def _accept(self, link: Link) -> Endpoint:
        self._endpoint = Endpoint(link, system=255, component=self.component, on_frame=self._hear)
        return self._endpoint

    def _hear(self, frame: Frame) -> None:
        self.heard.append(frame.message)
        self.everything.append(frame.message)
        self.pictures += self._receiver.receive(frame, None)
        self._news.set()


def goal(key: int, *args: float) -> Goal:
    return Goal(key, 1, 0, (*args, *(float("nan"),) * (7 - len(args))), Verb.GO_TO, 1, 1)


def is_status(key: int, state: GoalState) -> Callable[[AnyMessage], bool]:
    return lambda m: isinstance(m, GoalStatus) and m.key == key and m.state == state


async def test_an_arm_is_commanded_watched_photographed_and_stopped() -> None:
    async with serving("arm", ANY) as server:
        client = await Client().dial(server.address)
        await client.until(lambda m: isinstance(m, Heartbeat))
        first = await client.until(lambda m: isinstance(m, Tool))
        assert isinstance(first, Tool)
        client.say(goal(1, first.x + 0.05, first.y, first.z - 0.02))
        await client.until(lambda m: isinstance(m, Tool) and m.busy == 1)
        await client.until(is_status(1, GoalState.SUCCEEDED))
        await client.until(lambda m: isinstance(m, Tool) and abs(m.x - first.x - 0.05) < 0.004)
        client.say(PictureRequest(width=320, height=180, target_system=1, target_component=100, quality=80))
        picture = await client.picture()
        assert picture.peer.component == 100
        with Image.open(io.BytesIO(picture.data)) as image:
            assert image.size == (320, 180)
        client.say(goal(2, 0.4, 0.2, 0.3, 0.0))
        await client.until(is_status(2, GoalState.ACTIVE))
        client.say(SetMode(0, 0, 0, ModeKind.SAFE_STOP))
        ended = await client.until(is_status(2, GoalState.CANCELLED))
        assert isinstance(ended, GoalStatus)
        assert ended.reason == Reason.STOPPED
        await client.until(lambda m: isinstance(m, Mode) and m.mode == ModeKind.SAFE_STOP)


async def test_answers_go_where_the_question_came_from_and_telemetry_to_all() -> None:
    async with serving("rover", ANY) as server:
        asker, watcher = await Client(1).dial(server.address), await Client(2).dial(server.address)
        asker.say(Goal(7, 1, 0, (0.01, 0.0, *(float("nan"),) * 5), Verb.MOVE, 1, 1))
        await asker.until(is_status(7, GoalState.SUCCEEDED))
        await watcher.until(lambda m: isinstance(m, Mode) and m.mode == ModeKind.ACTIVE)
        await watcher.until(lambda m: isinstance(m, Mode) and m.mode == ModeKind.READY)
        assert not [m for m in watcher.everything if isinstance(m, GoalStatus)]


async def test_of_many_picture_requests_the_newest_of_each_camera_are_answered() -> None:
    async with serving("rover", ANY) as server:
        client = await Client().dial(server.address)
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
        client = await Client().dial(server.address)
        client.say(PictureRequest(40, 30, 1, 99, 70))
        client.say(PictureRequest(40, 30, 2, 100, 70))
        client.say(PictureRequest(48, 30, 1, 100, 0))
        assert (await client.picture()).width == 48


async def test_a_client_that_leaves_in_the_middle_of_a_picture_disturbs_nobody() -> None:
    async with serving("rover", ANY) as server:
        leaver, stayer = await Client(1).dial(server.address), await Client(2).dial(server.address)
        leaver.say(PictureRequest(640, 360, 1, 100, 70))
        await leaver.until(lambda m: isinstance(m, Heartbeat))
        leaver.link.close()
        stayer.say(PictureRequest(40, 30, 1, 100, 70))
        assert (await stayer.picture()).width == 40


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
    client = await Client().dial(await address)
    await client.until(lambda m: isinstance(m, Heartbeat))
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running


async def test_a_controller_whose_physics_fails_ends_with_the_reason() -> None:
    async with serving("rover", ANY) as server:
        server._fail(FloatingPointError("the world fell apart"))
        with pytest.raises(FloatingPointError):
            await server.failure
