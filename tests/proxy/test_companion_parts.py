"""A companion over MAVLink on TCP with the ordinary proxies: each commands its own component."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from typing import Any

import pytest

from robotree.proxy import kinds
from robotree.proxy.robot_proxy import RobotProxy
from robotree.sim.kinds import HEAD, LEFT_ARM, RIGHT_ARM
from robotree.sim.serving.server import serving
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address
from robotree.vr.base.errors import BadArgument, CommandFailed, Stopped
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until

PARTS = {
    "base": ("base", 1),
    "left": ("limb", LEFT_ARM),
    "right": ("limb", RIGHT_ARM),
    "head": ("head", HEAD),
}


@pytest.fixture
async def parts() -> AsyncIterator[dict[str, tuple[RobotProxy, RobotClient]]]:
    """The four proxies of one controller, and who asks them."""
    async with AsyncExitStack() as stack:
        server = await stack.enter_async_context(serving("companion", "tcp:127.0.0.1:0"))
        transport = MemoryNetwork().join("test")
        found: dict[str, tuple[RobotProxy, RobotClient]] = {}
        for name, (kind, component) in PARTS.items():
            robot = kinds.make(kind, name, server.address, chance=random.Random(1), component=component)
            agent = RobotAgent(robot, transport)
            robot.on_change = agent.notify
            await agent.start()
            stack.push_async_callback(agent.close)
            running = asyncio.create_task(robot.run())
            stack.push_async_callback(_end, running)
            address: Address = agent.address
            found[name] = robot, RobotClient(transport, address)
        for name, (robot, _) in found.items():
            await until(lambda robot=robot: robot.online and bool(robot.readings()), f"{name} is found")
        yield found


async def _end(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_each_proxy_commands_its_own_part(parts: dict[str, tuple[RobotProxy, RobotClient]]) -> None:
    ask: dict[str, Any] = {name: client.call for name, (_, client) in parts.items()}
    assert {name: robot.kinds()[:2] for name, (robot, _) in parts.items()} == {
        "base": ("Base", "Rover"),
        "left": ("Limb", "Arm"),
        "right": ("Limb", "Arm"),
        "head": ("Head", "RobotProxy"),
    }
    assert parts["head"][0].reading_units["tags"] == "count"
    await asyncio.gather(
        ask["left"]("posture", {"j1": 0.3, "j2": 0.2, "j3": 0, "j4": 1.6, "j5": 0, "j6": 0, "speed": 0.5}),
        ask["right"]("reach", {"x": 0.4, "y": -0.3, "z": 1.0, "hand": "level", "speed": 0.5}),
        ask["base"]("move", {"x": 0.3, "y": 0.0}),
        ask["head"]("look", {"pan": 0.4, "tilt": 0.2}),
    )
    right, base, head = [await ask[name]("get_info", {}) for name in ("right", "base", "head")]
    assert (right["x"], right["y"], right["z"]) == pytest.approx((0.4, -0.3, 1.0), abs=0.02)
    assert base["x"] == pytest.approx(-2.15, abs=0.02)
    assert base["battery"] == pytest.approx(0.86, abs=0.01)
    assert head["pan"] == pytest.approx(0.4, abs=0.05)
    await ask["head"]("say", {"text": "Guten Tag, schön!"})
    with pytest.raises(BadArgument, match="201 bytes"):
        await ask["head"]("say", {"text": "x" * 201})
    with pytest.raises(CommandFailed, match=r"two parts of the robot would touch|nearer than 15 mm"):
        await ask["left"]("posture", {"j1": 0.6, "j2": -0.7, "j3": -1.5, "j4": 1.9, "j5": 0, "j6": 0})
    await parts["left"][0].safe_stop("a test")
    with pytest.raises(Stopped, match="robotree resume left"):
        await ask["left"]("grip", {"action": "open"})
    await ask["right"]("grip", {"action": "open"})
