"""A realm within the process, as a supervisor comes to it: one lookup, one host, two rovers."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest

from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.base.description import RobotDescription
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.running.process import Process
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.testing import until
from tests.vr.core.conftest import pytest_asyncio_loop_factories, runner_here

SOURCE = """
from robotree.vr import Child, VirtualRobot, command

class Carrier(VirtualRobot):
    \"\"\"Carries things.\"\"\"
    rover = Child("Rover")

    @command
    def carry(self, far: float) -> float:
        self.progress(0.5, "half way")
        return self.rover.move(x=far)

class Train(VirtualRobot):
    front = Child("Carrier")
    second = Child("Carrier")
"""


class Rover(Robot):
    """A rover without wheels."""

    stopped = ""

    @command
    def move(self, x: float) -> float:
        return x

    def safe_stop(self, reason: str) -> None:
        self.stopped = reason

    def readings(self) -> dict[str, float]:
        return {"x": 1.0}


class Window:
    cameras = ("cell",)
    reading_units: ClassVar[Mapping[str, str]] = {}

    def readings(self) -> dict[str, float]:
        return {}

    async def look(self, camera: str, width: int, height: int, quality: int) -> bytes:
        return f"{camera} {width}x{height} {quality}".encode()


class World:
    """A network with one lookup, one host, two rovers, and a realm client that sees them."""

    def __init__(self, path: Path) -> None:
        self.network = MemoryNetwork()
        self.source = path / "carrier.py"
        self.source.write_text(SOURCE)
        self.lookup = LookupService(self.network.join("lookup"), "lookup-1")
        transport = self.network.join("host")
        self.host = self.host_on(transport, "host-1")
        self.realm_client = RealmClient(self.network.join("operator"))
        self.agents: dict[str, RobotAgent] = {}

    def host_on(self, transport: MemoryTransport, name: str, **options: Any) -> Host:
        process = Process(runner_here())
        return Host(transport, name, registrar=Registrar(transport), process=process, **options)

    async def open(self) -> None:
        await asyncio.gather(self.lookup.start(), self.host.start(), self.realm_client.start())
        await asyncio.gather(*(self.add(name) for name in ("r1", "r2")))
        await until(lambda: self.names == ["r1", "r2"], "the rovers are listed")

    async def add(self, name: str) -> None:
        transport = self.network.join(name)
        self.agents[name] = RobotAgent(
            Rover(name), transport, registrar=Registrar(transport), process=Process(runner_here())
        )
        await self.agents[name].start()

    async def create(self, name: str, wanted: str = "Carrier", host: str = "") -> RobotDescription:
        return await self.realm_client.create(str(self.source), name, host, wanted)

    @property
    def names(self) -> list[str]:
        return [listing.name for listing in self.realm_client.robots()]

    async def close(self) -> None:
        for agent in self.agents.values():
            await agent.close()
        await self.host.close()
        await self.realm_client.close()
        await self.lookup.close()
        for transport in list(self.network.members):
            await transport.close()


__all__ = ["pytest_asyncio_loop_factories"]


@pytest.fixture
async def world(tmp_path: Path) -> AsyncIterator[World]:
    world = World(tmp_path)
    await world.open()
    yield world
    await world.close()
