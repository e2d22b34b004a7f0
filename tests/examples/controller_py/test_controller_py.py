"""The controller in plain Python, driven, stopped and left by the real proxy of a rover."""

from __future__ import annotations

import ast
import asyncio
import random
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.proxy.agent import running_proxy
from robotree.proxy.rover import Rover
from robotree.vr.base.errors import CommandCancelled, Stopped
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until
from tests.examples.controllers import started

pytestmark = pytest.mark.e2e
SOURCE = Path(__file__).parents[3] / "examples" / "controller_py" / "controller.py"
PAGE = 113
"""Lines of code; blank ones and the first words do not count."""


@pytest.fixture
def url(controller_py: list[str]) -> Iterator[str]:
    with started([*controller_py, "0"]) as running:
        yield running.url


def test_it_is_one_page_and_needs_nothing_but_pymavlink() -> None:
    text = SOURCE.read_text()
    code = text.split('"""', 2)[2]
    assert len([line for line in code.splitlines() if line.strip()]) <= PAGE
    tree = ast.walk(ast.parse(text))
    names = {
        alias.name if isinstance(each, ast.Import) else each.module
        for each in tree
        if isinstance(each, ast.Import | ast.ImportFrom)
        for alias in each.names
    }
    assert names - sys.stdlib_module_names == {"rover_wire", "keys", "memory"}, (
        "pymavlink generates one, the others are here"
    )


async def test_the_real_proxy_drives_stops_and_leaves_it(url: str) -> None:
    network = MemoryNetwork()
    rover = Rover("rover-1", url, chance=random.Random(1))
    async with running_proxy(rover, network.join("proxy")) as agent:
        client = RobotClient(network.join("caller"), agent.address)
        await until(lambda: rover.online, "it is online")

        async def place() -> list[float]:
            info = await client.call("get_info", {})
            return [info["x"], info["y"]]

        async def moving(to: float) -> asyncio.Task[object]:
            call = asyncio.create_task(client.call("move", {"x": to, "y": 0.0, "speed": 0.2}, key=f"to {to}"))
            await until(lambda: abs(rover.readings().get("vx", 0.0)) > 0.05, "it moves")
            return call

        await client.call("move", {"x": 0.3, "y": -0.2, "speed": 0.5})
        assert await place() == pytest.approx([0.3, -0.2], abs=1e-5)

        call = await moving(-1.0)
        await client.cancel("to -1.0", reason="enough")
        with pytest.raises(CommandCancelled, match="enough"):
            await call

        call = await moving(-0.9)
        await client.safe_stop("a hand in the cell")
        with pytest.raises((CommandCancelled, Stopped)):
            await call
        with pytest.raises(Stopped):
            await client.call("move", {"x": 0.1, "y": 0.0, "speed": 0.5})
        await client.resume()
        await client.call("move", {"x": 0.05, "y": 0.0, "speed": 0.5})


async def test_it_stands_when_its_link_ends_and_serves_the_next_client(url: str) -> None:
    for _ in range(2):
        network = MemoryNetwork()
        rover = Rover("rover-1", url, chance=random.Random(1))
        async with running_proxy(rover, network.join("proxy")) as agent:
            client = RobotClient(network.join("caller"), agent.address)
            await until(lambda rover=rover: rover.online, "it is online")
            await until(lambda rover=rover: "vx" in rover.readings(), "it is told of")
            assert rover.readings()["vx"] == 0.0, "the one before has left it moving"
            call = asyncio.create_task(client.call("move", {"x": 0.6, "y": 0.0, "speed": 0.1}))
            await until(lambda rover=rover: rover.readings().get("vx", 0.0) > 0.05, "it moves")
        call.cancel()
        await asyncio.gather(call, return_exceptions=True)
