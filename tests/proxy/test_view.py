"""Views: pictures only for those who look."""

from __future__ import annotations

import asyncio
import io
import random
from collections.abc import AsyncIterator
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from robotree.protocol import Parser
from robotree.protocol.links.link import Accept, Handler, Link
from robotree.protocol.links.url import connect, listen
from robotree.protocol.messages import PictureRequest, Tool
from robotree.protocol.services.picture import split
from robotree.proxy.connection import Connection, Dial
from robotree.proxy.session import ControllerSession
from robotree.proxy.view import ATTEMPTS, LARGEST, SMALLEST, PictureSpec, WorkspaceView
from robotree.sim.serving.server import serving
from robotree.vr.base.errors import BadArgument, CommandFailed
from robotree.vr.world.testing import until

Controller = Any
JPEG = bytes(range(256)) * 8
LONG = 60.0
"""[s] that no answer takes, however slow the machine is: nothing is asked for twice."""


def requests(controller: Controller) -> list[PictureRequest]:
    return [message for message in controller.heard if isinstance(message, PictureRequest)]


@pytest.fixture
async def controller(make_controller: type[Controller]) -> Controller:
    controller = make_controller()
    controller.jpeg = JPEG
    return controller


@pytest.fixture
async def view(controller: Controller) -> AsyncIterator[WorkspaceView]:
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    view = WorkspaceView("cell", listener.address, answer_within=0.3, chance=random.Random(1))
    running = asyncio.create_task(view.run())
    living = asyncio.create_task(controller.live())
    await until(lambda: view.online, "the controller is found")
    yield view
    running.cancel()
    living.cancel()
    await asyncio.gather(running, living, return_exceptions=True)
    await listener.close()


async def test_a_picture_is_asked_for_only_when_somebody_looks(
    view: WorkspaceView, controller: Controller
) -> None:
    view._answer_within = LONG
    await asyncio.sleep(0.2)
    assert requests(controller) == []
    assert await view.look("wrist", 64, 36, 50) == JPEG
    (request,) = requests(controller)
    assert (request.width, request.height, request.quality, request.target_component) == (64, 36, 50, 101)


async def test_who_looks_at_the_same_thing_at_the_same_time_shares_one_picture(
    view: WorkspaceView, controller: Controller
) -> None:
    view._answer_within = LONG
    looks = [view.look("cell", 64, 36) for _ in range(5)]
    assert await asyncio.gather(*looks) == [JPEG] * 5
    assert len(requests(controller)) == 1
    await view.look("cell", 64, 36)
    assert len(requests(controller)) == 2


async def test_who_stops_looking_does_not_take_the_picture_away_from_others(
    view: WorkspaceView, controller: Controller
) -> None:
    controller.holes = 1
    tired, patient = (asyncio.create_task(view.look()) for _ in range(2))
    await until(lambda: bool(requests(controller)), "it is asked for")
    tired.cancel()
    assert await patient == JPEG


async def test_a_picture_with_a_hole_is_asked_for_again(view: WorkspaceView, controller: Controller) -> None:
    controller.holes = 1
    assert await view.look() == JPEG
    assert len(requests(controller)) == 2


async def test_a_slowly_drawn_picture_is_waited_for(view: WorkspaceView, controller: Controller) -> None:
    jpeg, controller.jpeg = controller.jpeg, b""
    look = asyncio.create_task(view.look("cell", 64, 36))
    await until(lambda: len(requests(controller)) == 2, "it is asked for again")
    controller.draw(jpeg, requests(controller)[0])
    assert await look == jpeg
    assert len(requests(controller)) == 2


async def test_a_camera_that_does_not_answer_is_given_up(view: WorkspaceView, controller: Controller) -> None:
    controller.jpeg = b""
    with pytest.raises(CommandFailed, match=r"no whole picture came from camera wrist within 0\.9 s"):
        await view.look("wrist")
    assert len(requests(controller)) == ATTEMPTS


async def test_a_picture_that_comes_slowly_is_waited_for(
    view: WorkspaceView, controller: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Longer than a picture may take to begin, but each piece comes in time."""
    loop = asyncio.get_running_loop()
    clock, passed = loop.time, list[float]()
    monkeypatch.setattr(loop, "time", lambda: clock() + sum(passed))
    view._answer_within = LONG
    controller.jpeg = b""
    look = asyncio.create_task(view.look("wrist"))
    await until(lambda: bool(requests(controller)), "it is asked for")
    slow = bytes(range(200)) * 10
    for piece in split(slow, width=64, height=36, quality=50):
        assert controller._endpoint is not None
        controller._endpoint.send(piece, component=101)
        passed.append(LONG / 3)
        await asyncio.sleep(0.01)
    assert sum(passed) > LONG
    assert await look == slow
    assert len(requests(controller)) == 1


@given(width=st.integers(1, 10**6), height=st.integers(1, 10**6))
def test_a_wish_keeps_its_shape(width: int, height: int) -> None:
    wish = PictureSpec.of("cell", width, height, 75)
    assert SMALLEST <= min(wish.width, wish.height) <= max(wish.width, wish.height) <= LARGEST
    if SMALLEST <= min(width, height) <= max(width, height) <= LARGEST:
        assert (wish.width, wish.height) == (width, height)
    elif max(width, height) / min(width, height) <= LARGEST / SMALLEST:
        # as nearly as whole pixels can say it
        assert abs(wish.width * height - wish.height * width) <= 0.5 * (width + height) + 1


@pytest.mark.parametrize(
    ("wide", "high", "shown"),
    [(3840, 2160, (1920, 1080)), (2160, 3840, (1080, 1920)), (8, 4, (32, 16)), (10**6, 1, (1920, 16))],
)
def test_a_wish_that_is_too_large_or_too_small_is_scaled(
    wide: int, high: int, shown: tuple[int, int]
) -> None:
    wish = PictureSpec.of("cell", wide, high, 75)
    assert (wish.width, wish.height) == shown


async def test_an_unknown_camera_is_refused_with_those_that_are_known(view: WorkspaceView) -> None:
    with pytest.raises(BadArgument, match=r"there is no camera 'ceiling'; there is: cell, wrist$"):
        await view.look("ceiling")


async def test_a_view_whose_controller_is_dead_says_so_at_once() -> None:
    view = WorkspaceView("cell", "tcp:127.0.0.1:1")
    with pytest.raises(CommandFailed, match=r"cell\.look failed: its controller was not heard yet"):
        await view.look()


async def test_the_simulated_cell_shows_itself_and_tells_its_readings() -> None:
    async with serving("arm", "tcp:127.0.0.1:0") as server:
        view = WorkspaceView("cell", server.address)
        running = asyncio.create_task(view.run())
        await until(lambda: view.online and "lever" in view.readings(), "the cell is found")
        assert view.readings()["lever"] < -0.75
        assert view.readings()["peak_force"] >= 0
        for camera in view.cameras:
            with Image.open(io.BytesIO(await view.look(camera, 160, 90))) as picture:
                assert picture.size == (160, 90)
                assert len(picture.getcolors(160 * 90) or []) > 50, "there is something to be seen"
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


async def test_a_view_has_its_poses_sent_ten_times_a_second_and_a_proxy_beside_it_all_of_them() -> None:
    heard: dict[str, list[int]] = {"view": [], "proxy": []}

    def listening(who: str) -> Dial:
        async def dial(url: str, accept: Accept) -> Link:
            return await connect(url, lambda link: Tap(accept(link), heard[who]))

        return dial

    async with serving("arm", "tcp:127.0.0.1:0") as server:
        view = WorkspaceView("cell", server.address, dial=listening("view"))
        proxy = Connection(
            server.address, ControllerSession(), on_event=lambda _: None, dial=listening("proxy")
        )
        running = [asyncio.create_task(each.run()) for each in (view, proxy)]
        await until(lambda: gaps(heard["view"])[-5:] == [100] * 5, "the view's rate is the one it wants")
        await until(lambda: gaps(heard["proxy"])[-5:] == [20] * 5, "and the proxy's is its own")
        assert not any(each.done() for each in running), "both go on"
        for each in running:
            each.cancel()
        await asyncio.gather(*running, return_exceptions=True)


class Tap:
    """Notes the moments [ms] of the poses that a handler hears."""

    def __init__(self, handler: Handler, moments: list[int]) -> None:
        self._handler, self._moments, self._parser = handler, moments, Parser()
        self.closed = handler.closed

    def received(self, data: bytes) -> None:
        poses = [frame.message for frame in self._parser.feed(data) if isinstance(frame.message, Tool)]
        self._moments += [pose.time_boot_ms for pose in poses]
        self._handler.received(data)


def gaps(moments: list[int]) -> list[int]:
    return [later - earlier for earlier, later in pairwise(moments)]
