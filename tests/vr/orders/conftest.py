"""Directories, robots and people in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Annotated, Any

import pytest

from robotree.vr import Robot, Unit, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.shared import Shared
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore
from robotree.vr.running.process import Process
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner

EPOCH = 1_700_000_000.0
"""[s] since 1970 when each test begins."""


def pytest_asyncio_loop_factories() -> dict[str, Callable[[], asyncio.AbstractEventLoop]]:
    return {"virtual": lambda: VirtualLoop(VirtualRunner())}


class Rover(Robot):
    """A rover that counts what it did."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.x = 0.0
        self.done: list[str] = []

    @command(effect="once", offline="queue")
    def drive(self, x: Annotated[float, Unit("m")], seconds: float = 0.1) -> float:
        """Drive ahead."""
        self.done.append(self.context.key)
        self.sleep(seconds)
        self.x += x
        return self.x

    @command(effect="repeat", offline="queue")
    def go_to(self, x: float, seconds: float = 0.1) -> None:
        self.done.append(self.context.key)
        self.sleep(seconds)
        self.x = x

    @command(effect="once")
    def jog(self) -> None:
        """Never while it is away."""

    @command(effect="read", offline="memory")
    def place(self) -> float:
        return self.x

    @command(effect="once", offline="queue")
    def fail(self) -> None:
        raise ValueError("over")

    def readings(self) -> dict[str, float]:
        return {"x": self.x}


class Stage:
    """A realm within the process."""

    def __init__(self, folder: Path) -> None:
        self.network = MemoryNetwork(delay=0.001)
        self.folder = folder
        self.loop = asyncio.get_running_loop()
        self.services: list[DirectoryService] = []
        self.agents: list[tuple[RobotAgent, Registrar]] = []
        self.clients: list[RealmClient] = []
        self.transports: dict[str, MemoryTransport] = {}

    def unix(self) -> float:
        return EPOCH + self.loop.time()

    async def directory(self, name: str, skew: float = 0.0) -> DirectoryService:
        transport = self.transports[name] = self.network.join(name)
        store = OrderStore(self.folder / f"{name}.db")
        service = DirectoryService(transport, name, store, unix=lambda: self.unix() + skew)
        await service.start()
        self.services.append(service)
        return service

    async def kill_directory(self, service: DirectoryService) -> None:
        self.network.kill(self.transports[service.address.name])
        self.services.remove(service)
        for task in list(service._tasks):
            task.cancel()
        service._store.close()
        await asyncio.sleep(0.01)

    async def robot(
        self, robot: Robot, ledger: Ledger | None = None, identity: str = "", skew: float = 0.0
    ) -> RobotAgent:
        transport = self.transports[robot.name] = self.network.join(robot.name)
        registrar = Registrar(transport, chance=lambda: 0.5)
        loop = self.loop
        assert isinstance(loop, VirtualLoop)
        agent = RobotAgent(
            robot,
            transport,
            registrar=registrar,
            unix=lambda: self.unix() + skew,
            process=Process(loop.runner),
            shared=Shared(),
            orders=OrderMemory(
                Ledger(None) if ledger is None else ledger, identity or f"{robot.name}-for-life"
            ),
        )
        await agent.start()
        self.agents.append((agent, registrar))
        return agent

    async def switch_off(self, agent: RobotAgent) -> None:
        """As if somebody pulled the plug."""
        self.network.kill(self.transports[agent.robot.name])
        found = next(each for each in self.agents if each[0] is agent)
        self.agents.remove(found)
        if agent._taker is not None and agent._taker._task is not None:
            agent._taker._task.cancel()
        agent.open = False
        await asyncio.sleep(0.1)

    async def person(self, name: str = "operator") -> RealmClient:
        client = RealmClient(self.network.join(name))
        client.orders._unix = self.unix
        await client.start()
        self.clients.append(client)
        return client

    async def until(self, happened: Callable[[], Any], within: float = 60.0) -> None:
        async with asyncio.timeout(within):
            while not happened():  # noqa: ASYNC110 # virtual time
                await asyncio.sleep(0.01)

    async def close(self) -> None:
        for client in self.clients:
            await client.close()
        for agent, registrar in self.agents:
            await agent.close()
            await registrar.close()
        for service in self.services:
            await service.close()
            service._store.close()
        await asyncio.sleep(0.1)


@pytest.fixture
async def stage(tmp_path: Path) -> AsyncIterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    await stage.close()
