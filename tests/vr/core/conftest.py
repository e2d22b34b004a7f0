"""Time that jumps, a network within the process, and a few robots to play with.

Commands run in real threads. The loop's clock therefore jumps to the next timer only when every thread of
ours waits for something, or has computed for so long that it counts as hung.
"""

from __future__ import annotations

import asyncio
import selectors
import sys
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Any

import pytest

from robotree.vr import Robot
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.description import Listing
from robotree.vr.errors import VrError
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.units import read_quantity
from robotree.vr.world.network import MemoryNetwork, MemoryTransport

HUNG = 0.3
"""[s] of real time that one thread may compute before the clock goes on without it."""
STILL = 2
"""Looks, half a millisecond apart, at which nobody may do anything before the clock jumps."""


class JumpingLoop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self.now = 0.0
        super().__init__(JumpingSelector(self))

    def time(self) -> float:
        return self.now


class JumpingSelector(selectors.DefaultSelector):  # type: ignore[misc,valid-type,unused-ignore] # one of several
    def __init__(self, loop: JumpingLoop) -> None:
        super().__init__()
        self._loop = loop
        self._computed: dict[threading.Thread, float] = {}

    def select(self, timeout: float | None = None) -> Any:
        events = super().select(0)
        if events or timeout == 0:
            return events
        if timeout is None:
            return super().select(1.0)
        still = 0
        while others() and still < STILL:
            began = time.monotonic()
            if events := super().select(0.0005):
                return events
            still = 0 if self._somebody_computes(time.monotonic() - began) else still + 1
        self._loop.now += timeout
        return []

    def _somebody_computes(self, seconds: float) -> bool:
        for thread in filter(computes, others()):
            self._computed[thread] = self._computed.get(thread, 0.0) + seconds
            if self._computed[thread] < HUNG:
                return True
        return False


def others() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread is not threading.current_thread()]


def computes(thread: threading.Thread) -> bool:
    """Whether a thread does something, rather than wait."""
    frame = sys._current_frames().get(thread.ident or 0)
    if frame is None:
        return True
    name = frame.f_code.co_name
    if frame.f_code.co_filename.endswith("threading.py"):
        waiter = frame.f_locals.get("waiter")
        return waiter is not None and not waiter.locked()  # it has been told, and not begun yet
    return name not in {"_worker", "_write"}


def pytest_asyncio_loop_factories() -> dict[str, Callable[[], asyncio.AbstractEventLoop]]:
    """Run every test of this folder in virtual time."""
    return {"virtual": JumpingLoop}


class Realm:
    """A realm within the process: each robot joins the network as if it had its own process."""

    def __init__(self, network: MemoryNetwork) -> None:
        self.network = network
        self.operator = network.join("operator")
        self.directory = Directory(self.operator)
        self.lookup = LookupService(network.join("lookup"), "lookup")
        self.agents: list[RobotAgent] = []
        self.unix = 1_000_000.0

    async def open(self) -> None:
        await self.lookup.start()
        await self.directory.start()

    async def start(self, robot: Robot, member: MemoryTransport | None = None, **options: Any) -> RobotAgent:
        transport = member or self.network.join(robot.name)
        options = {"registrar": Registrar(transport), "unix": lambda: self.unix} | options
        agent = RobotAgent(robot, transport, **options)
        await agent.start()
        self.agents.append(agent)
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


async def refusal(question: Awaitable[Any]) -> VrError:
    """Return the error with which something is refused."""
    with pytest.raises(VrError) as caught:
        await question
    return caught.value
