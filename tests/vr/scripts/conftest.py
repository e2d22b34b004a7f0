"""A realm within the process, in real time: scripts wait in threads of their own."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import pytest

from robotree.vr import command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.author.robot import Robot
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.scripts.roles import Limit, RolePlayer, in_role
from robotree.vr.world.network import MemoryNetwork

EXAMPLES = Path(__file__).parents[3] / "examples"


class Companion(RolePlayer):
    """A small robot that notes what it does."""

    limits: ClassVar[Mapping[str, Limit]] = {"speed": Limit(upper=0.7), "distance": Limit(lower=0.5)}

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.done: list[str] = []
        self.go = threading.Event()
        self.go.set()
        self.fails = ""

    def note(self, text: str) -> None:
        if self.fails and text.startswith(self.fails):
            raise RuntimeError("a motor is hot")
        self.done.append(text)

    @command
    def say(self, text: str) -> str:
        """Say something."""
        said = self.manner.words(text)
        self.note(f"say {said} [{self.manner.get('voice', 'plain')}]")
        return said

    @command
    def go_to(self, place: str, speed: float = 0.5) -> None:
        """Go to a place."""
        while not self.go.is_set():
            self.sleep(0.01)
        self.note(f"go_to {place} at {self.manner.number('speed', speed):g}")

    @command
    def wave(self) -> None:
        """Wave."""
        self.note(f"wave {self.manner.get('times', 1)}")

    @in_role("child", of="wave")
    def _wave_with_both(self) -> None:
        self.note("wave with both arms")


class Stage:
    """Robots and scripts, and what tests do with them."""

    def __init__(self) -> None:
        self.network = MemoryNetwork()
        self.operator = self.network.join("operator")
        self.agents: dict[str, RobotAgent] = {}
        """The latest incarnation of each."""
        self.all: list[RobotAgent] = []
        self.begun: list[asyncio.Task[Any]] = []

    async def start(self, robot: Robot) -> RobotAgent:
        return await self.begun_as(RobotAgent(robot, self.network.join(robot.name)))

    async def begun_as(self, agent: RobotAgent) -> RobotAgent:
        await agent.start()
        self.all.append(agent)
        self.agents[agent.address.name] = agent
        return agent

    async def companion(self, name: str = "c1") -> Companion:
        robot = Companion(name)
        await self.start(robot)
        return robot

    async def script(self, source: str, name: str = "guide", suffix: str = ".yaml") -> Any:
        robot = Bundle(source, f"{name}{suffix}").create(name)
        await self.start(robot)
        return robot

    def lines(self, name: str) -> list[str]:
        """Return what a robot has told people."""
        return [line.text for line in self.agents[name].runtime.log.since(0)]

    def client(self, name: str) -> RobotClient:
        return RobotClient(self.operator, self.agents[name].address)

    async def call(self, name: str, command: str, **arguments: Any) -> Any:
        return await self.client(name).call(command, arguments, deadline=30.0, caller="operator")

    def begin(self, name: str, command: str = "start", **arguments: Any) -> asyncio.Task[Any]:
        self.begun.append(begun := asyncio.ensure_future(self.call(name, command, **arguments)))
        return begun

    async def enslave(self, parent: str, slot: str, child: str) -> None:
        await self.client(parent).enslave(slot, self.agents[child].address)

    async def release(self, parent: str, slot: str) -> None:
        await self.client(parent).free(slot)

    async def until(self, condition: Any, within: float = 10.0) -> None:
        async with asyncio.timeout(within):
            while not condition():  # noqa: ASYNC110 # any condition at all
                await asyncio.sleep(0.005)

    async def close(self) -> None:
        for agent in reversed(self.all):
            await agent.close()
        await asyncio.gather(*self.begun, return_exceptions=True)
        for transport in list(self.network.members):
            await transport.close()


class Listed(Stage):
    """A stage with a lookup service."""

    async def open(self) -> None:
        await LookupService(self.network.join("lookup"), "lookup").start()

    async def start(self, robot: Robot) -> RobotAgent:
        transport = self.network.join(robot.name)
        return await self.begun_as(RobotAgent(robot, transport, registrar=Registrar(transport)))


class Charged(Companion):
    """Has a battery, and is at a place."""

    def __init__(self, name: str, battery: float, place: str) -> None:
        super().__init__(name)
        self.battery, self.attributes = battery, {"place": place}

    def readings(self) -> dict[str, float]:
        return {"battery": self.battery}


@pytest.fixture(autouse=True)
def names_are_sure_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A network in memory delivers at once what somebody else may say of a name."""
    for module in ("exchange.claim", "agents.agent"):
        monkeypatch.setattr(f"robotree.vr.{module}.SETTLE", 0.005)


@pytest.fixture
async def stage() -> AsyncIterator[Stage]:
    stage = Stage()
    yield stage
    await stage.close()


@pytest.fixture
async def listed() -> AsyncIterator[Listed]:
    stage = Listed()
    await stage.open()
    yield stage
    await stage.close()
