"""Virtual time, a network within the process, and a few robots to play with.

Commands run as greenlets: the clock jumps when everybody waits, and the order of events follows from a seed.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import pytest

from robotree.vr import Robot
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.shared import Shared
from robotree.vr.base.description import Listing
from robotree.vr.base.errors import VrError
from robotree.vr.base.units import read_quantity
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.running import frame
from robotree.vr.running.process import Process
from robotree.vr.running.runner import Runner, Threads
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.network import MemoryNetwork, MemoryTransport
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner

REAL_GRACE = 0.05
"""[s] Patience with code that ignores a cancel, where time is real."""


def pytest_asyncio_loop_factories(item: pytest.Item) -> dict[str, Callable[[], asyncio.AbstractEventLoop]]:
    """Run every test of this folder in virtual time, except those of code that never ends."""
    if item.get_closest_marker("real_threads"):
        return {"real": asyncio.SelectorEventLoop}
    return {"virtual": lambda: VirtualLoop(VirtualRunner())}


def runner_here() -> Runner:
    loop = asyncio.get_running_loop()
    return loop.runner if isinstance(loop, VirtualLoop) else Threads()


@pytest.fixture(autouse=True)
def short_patience(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have real threads interrupted soon."""
    if request.node.get_closest_marker("real_threads"):
        monkeypatch.setattr(frame, "GRACE", REAL_GRACE)


class Realm:
    """A realm within the process: each robot joins the network as if it had its own process."""

    def __init__(self, network: MemoryNetwork) -> None:
        self.network = network
        self.operator = network.join("operator")
        self.directory = Directory(self.operator)
        self.lookup = LookupService(network.join("lookup"), "lookup")
        self.agents: list[RobotAgent] = []
        self.processes: list[Process] = []
        self.shared: Process | None = None
        """The process of all robots; None: each has one of its own."""
        self.unix = 1_000_000.0
        self.runner = runner_here()

    async def open(self) -> None:
        await self.lookup.start()
        await self.directory.start()

    async def start(self, robot: Robot, member: MemoryTransport | None = None, **options: Any) -> RobotAgent:
        transport = member or self.network.join(robot.name)
        self.processes.append(process := self.shared or Process(runner_here()))
        if host := options.pop("host", ""):
            options["shared"] = Shared(host)
        defaults = {"registrar": Registrar(transport), "unix": lambda: self.unix, "process": process}
        agent = RobotAgent(robot, transport, **defaults | options)
        await agent.start()
        self.agents.append(agent)
        return agent

    async def team(self, parent: Robot, /, **children: Robot) -> Any:
        """Start a robot and its children, by slot; returns its agent, with theirs as attributes."""
        agent = await self.start(parent)
        for slot, child in children.items():
            below = await self.start(child)
            await self.client(agent).enslave(slot, below.address)
            setattr(agent, slot, below)
        return agent

    def client(self, agent: RobotAgent, **options: Any) -> RobotClient:
        return RobotClient(self.operator, agent.address, **options)

    def kill(self, agent: RobotAgent) -> None:
        """End the robot's process as `kill -9` does."""
        self.network.kill(member(agent))
        self.agents.remove(agent)

    def listed(self) -> list[str]:
        return [listing.name for listing in self.listings()]

    def listings(self) -> tuple[Listing, ...]:
        return self.directory.listings

    async def until(self, condition: Callable[[], bool], within: float = 60.0) -> float:
        """Let virtual time pass until something is so; return how long it took [s]."""
        loop = asyncio.get_running_loop()
        began = loop.time()
        async with asyncio.timeout(within):
            while not condition():  # noqa: ASYNC110 # any condition at all
                await asyncio.sleep(0.01)
        return loop.time() - began

    async def close(self) -> None:
        for agent in self.agents:
            await agent.close()
        await self.directory.close()
        await self.lookup.close()
        for transport in list(self.network.members):
            await transport.close()
        for process in self.processes:
            process.close()


def member(agent: RobotAgent) -> MemoryTransport:
    assert isinstance(agent.transport, MemoryTransport)
    return agent.transport


@pytest.fixture(scope="session", autouse=True)
def units() -> None:
    """Load the units before the clock can jump over it."""
    assert read_quantity("1 m", "cm") == 100


@pytest.fixture
async def realm() -> AsyncIterator[Realm]:
    realm = Realm(MemoryNetwork(delay=0.001))
    await realm.open()
    yield realm
    await realm.close()


@pytest.fixture
async def realm_client(realm: Realm) -> AsyncIterator[RealmClient]:
    realm_client = RealmClient(realm.network.join("supervisor"))
    await realm_client.start()
    yield realm_client
    await realm_client.close()


@pytest.fixture(params=["a process each", "one process"])
def homes(request: pytest.FixtureRequest, realm: Realm) -> Realm:
    """The realm, once with robots in processes of their own, and once with all in one."""
    if request.param == "one process":
        realm.shared = Process(realm.runner)
    return realm


async def refusal(question: Awaitable[Any]) -> VrError:
    """Return the error with which something is refused."""
    with pytest.raises(VrError) as caught:
        await question
    return caught.value
