"""A proxy and a view as a whole, in a realm of this test alone, before a simulated cell."""

from __future__ import annotations

import asyncio
import io
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest
from PIL import Image

from robotree.proxy.agent import run_proxy, run_view, running_proxy
from robotree.proxy.arm import Arm
from robotree.proxy.errors import BadController, UnknownKind
from robotree.sim.serving.server import Server, serving
from robotree.vr.base.address import Address
from robotree.vr.base.errors import BadName, DuplicateName, VrError
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.client import RobotClient, ViewClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until


@pytest.fixture
async def cell() -> AsyncIterator[Server]:
    async with serving("arm", "tcp:127.0.0.1:0") as server:
        yield server


@pytest.fixture
async def realm(place: Path) -> AsyncIterator[Transport]:
    transport = await join("test", root=place / "robotree")
    yield transport
    await transport.close()


T = TypeVar("T")


async def eventually(ask: Callable[[], Awaitable[T]], holds: Callable[[T], bool]) -> T:
    """Ask again and again until the answer is as it must become."""
    for _ in range(1200):
        if holds(answer := await ask()):
            return answer
        await asyncio.sleep(0.05)
    pytest.fail("it did not become so within 60 s")


class Up(asyncio.Future[str]):
    """Becomes the address of an agent once it is up."""


@asynccontextmanager
async def running(agent: Coroutine[Any, Any, None], up: Up) -> AsyncIterator[Address]:
    """An agent that runs inside the block; its address."""
    task = asyncio.create_task(agent)
    try:
        await asyncio.wait([task, up], return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
        address = Address.parse(up.result())
        assert address is not None
        yield address
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


async def test_a_proxy_is_listed_can_be_called_and_is_gone_when_it_ends(
    cell: Server, realm: Transport
) -> None:
    lookup, directory = LookupService(realm, "lu-1"), Directory(realm)
    await lookup.start()
    await directory.start()
    up = Up()
    async with running(
        run_proxy("arm", "arm-1", cell.address, realm="test", ready=up.set_result), up
    ) as address:
        await until(lambda: bool(directory.listings), "it is listed")
        (listing,) = directory.listings
        assert (listing.name, listing.kinds) == ("arm-1", ("Arm", "RobotProxy", "Robot"))
        assert listing.attributes["controller"] == cell.address
        assert {"go_to", "get_info", "grip", "halt", "hold"} <= set(listing.commands)
        client = RobotClient(realm, address)
        await eventually(client.describe, lambda robot: robot.online)  # it is listed before it is heard
        assert (await client.describe()).attributes["simulated"] == "yes"
        await until(
            lambda: any(one.attributes.get("simulated") == "yes" for one in directory.listings),
            "its listing says so, too",
        )
        info = await client.call("get_info", {})
        await client.call("go_to", {"x": info["x"] + 0.05, "y": 0, "z": info["z"], "twist": 0})
        assert (await client.call("get_info", {}))["x"] == pytest.approx(info["x"] + 0.05, abs=0.005)
        with pytest.raises(DuplicateName, match="a robot named 'arm-1' is already running"):
            await run_proxy("arm", "arm-1", cell.address, realm="test")
    await until(lambda: not directory.listings, "it is listed no more")
    await directory.close()
    await lookup.close()


async def test_a_view_shows_the_cell_to_the_realm(cell: Server, realm: Transport) -> None:
    up = Up()
    async with running(run_view("cell", cell.address, realm="test", ready=up.set_result), up) as address:
        client = ViewClient(realm, address)
        described = await eventually(client.describe, lambda view: "lever" in view.readings)
        assert described.cameras == ("cell", "wrist")
        picture = await client.look("wrist", width=160, height=90)
        assert (picture.width, picture.height, picture.camera) == (160, 90, "wrist")
        with Image.open(io.BytesIO(picture.jpeg)) as image:
            assert image.size == (160, 90)
        with pytest.raises(DuplicateName, match="a view named 'cell' is already running"):
            await run_view("cell", cell.address, realm="test")
        with pytest.raises(VrError, match=r"there is no camera 'ceiling'; there is: cell, wrist"):
            await client.look("ceiling")


async def test_a_proxy_comes_up_before_its_controller(realm: Transport) -> None:
    up = Up()
    async with running(
        run_proxy("arm", "arm-1", "tcp:127.0.0.1:1", realm="test", ready=up.set_result), up
    ) as address:
        client = RobotClient(realm, address)
        assert not (await client.describe()).online
        with pytest.raises(
            VrError, match=r"cannot be reached: tcp:127\.0\.0\.1:1 cannot be opened: .*refused"
        ):
            await client.call("get_info", {})


@pytest.mark.parametrize(
    ("kind", "name", "url", "error", "sentence"),
    [
        (
            "crane",
            "arm-1",
            "tcp:127.0.0.1:1",
            UnknownKind,
            "'crane' is no kind of robot; there is: arm, rover",
        ),
        ("arm", "a/b", "tcp:127.0.0.1:1", BadName, "'a/b' cannot be a name"),
        ("arm", "arm-1", "5760", BadController, "'5760' is no address of a link: begin it with"),
    ],
)
async def test_what_cannot_be_is_refused_before_anything_is_joined(
    kind: str, name: str, url: str, error: type[VrError], sentence: str
) -> None:
    with pytest.raises(error, match=sentence):
        await run_proxy(kind, name, url, realm="never/joined")


async def test_an_error_beside_the_block_ends_the_block() -> None:
    class Broken(Arm):
        async def run(self) -> None:
            raise RuntimeError("a mistake of ours")

    with pytest.raises(RuntimeError, match="a mistake of ours"):
        async with running_proxy(Broken("arm-1", "tcp:127.0.0.1:1"), MemoryNetwork().join("proxy")):
            await asyncio.Event().wait()
