"""The examples at work: real agents on a network in memory, real proxies, real physics in a hurry."""

from __future__ import annotations

import asyncio
import random
import shutil
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import pytest

from robotree.proxy import kinds
from robotree.proxy.robot_proxy import RobotProxy
from robotree.sim.serving.server import serving
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until
from tests.examples.controllers import COMPILER, compiled, generated, made_js, made_once

EXAMPLES = Path(__file__).parents[2] / "examples"
HURRY = 6.0
"""Simulated seconds in a second."""


class Workshop:
    """Robots of one network: proxies in front of simulated cells, and virtual robots from the examples."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack
        self.network = MemoryNetwork()
        self._transport = self.network.join("workshop")
        self._addresses: dict[str, Address] = {}
        self.proxies: dict[str, RobotProxy] = {}

    async def proxy(self, kind: str, name: str) -> RobotProxy:
        """Simulate a robot and stand for it."""
        server = await self._stack.enter_async_context(serving(kind, "tcp:127.0.0.1:0", speedup=HURRY))
        robot = kinds.make(kind, name, server.address, chance=random.Random(1))
        await self._agent(robot)
        running = asyncio.create_task(robot.run())
        self._stack.push_async_callback(_end, running)
        await until(lambda: robot.online and bool(robot.readings()), f"{name} is found")
        self.proxies[name] = robot
        return robot

    async def create(self, file: str, name: str, **children: str) -> RobotClient:
        """Create a virtual robot from an example and put it on top of others, by slot."""
        bundle = Bundle.read(EXAMPLES / file)
        await self._agent(await asyncio.to_thread(bundle.create, name))
        client = self.client(name)
        for slot, child in children.items():
            await client.enslave(slot, self._addresses[child])
        return client

    def client(self, name: str) -> RobotClient:
        """The client of a robot."""
        return RobotClient(self._transport, self._addresses[name])

    async def _agent(self, robot: Any) -> None:
        agent = RobotAgent(robot, self._transport)
        robot.on_change = agent.notify
        await agent.start()
        self._addresses[robot.name] = agent.address
        self._stack.push_async_callback(agent.close)


async def _end(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


@pytest.fixture
async def workshop() -> AsyncIterator[Workshop]:
    async with AsyncExitStack() as stack:
        yield Workshop(stack)


@pytest.fixture
def examples() -> Path:
    return EXAMPLES


@pytest.fixture(scope="session")
def controller_c(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program of the controller in C."""
    if COMPILER is None or shutil.which("make") is None:
        pytest.skip("there is no C compiler or no make here")
    return Path(*made_once(tmp_path_factory, "controller_c", compiled))


@pytest.fixture(scope="session")
def controller_py(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """How the controller in Python is started."""
    return made_once(tmp_path_factory, "controller_py", generated)


@pytest.fixture(scope="session")
def controller_js(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """How the controller in JavaScript is started."""
    return made_once(tmp_path_factory, "controller_js", made_js)
