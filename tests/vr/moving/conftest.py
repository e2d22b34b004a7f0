"""Two hosts and a robot in this process, with journals as users have them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.agents.run import kept_by
from robotree.vr.base.address import everyone
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import Done, EventsRead, Migrate, ReadEvents
from robotree.vr.bundle import Bundle
from robotree.vr.core.bonds import DEFAULT_TERM
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.journal.journal import HostJournal
from robotree.vr.running.process import Process
from robotree.vr.running.runner import Threads
from robotree.vr.world.network import MemoryNetwork, MemoryTransport

HEADER = "from robotree.vr import Child, VirtualRobot, command, state\n"
WAITING = 30.0
"""[s] A busy machine may take that long."""


class Home:
    """One host, as a process would have it."""

    def __init__(self, stage: Stage, name: str) -> None:
        self.stage, self.name, self.lives = stage, name, 0

    async def start(self) -> None:
        """Begin another life."""
        self.lives += 1
        self.member = self.stage.network.join(self.name)
        runner = Threads()
        self.journal = HostJournal(self.stage.folder / f"{self.name}", runner)
        self.process: Process = Process(runner, self.journal)
        transport = kept_by(self.journal, self.process, self.member)
        term = self.stage.term
        self.host = Host(transport, self.name, term=term, process=self.process, journal=self.journal)
        self.history = HistoryWriter(self.stage.folder / self.name, runner.now)
        self.host.keeps_history(self.history)
        await self.host.start()
        await self.host.restore()

    def kill(self) -> None:
        """End as a process does that is killed: nothing more leaves it, nothing more is written."""
        self.host.moves.close()
        self.history.close()
        self.journal.barrier()
        self.journal.close()
        self.stage.network.kill(self.member)

    async def close(self) -> None:
        await self.host.close()
        self.history.close()
        self.journal.close()


class Stage:
    """A realm in this process."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.network = MemoryNetwork()
        self.operator: MemoryTransport = self.network.join("operator")
        self.homes: dict[str, Home] = {}
        self.term = DEFAULT_TERM

    async def add(self, *names: str) -> None:
        """Start hosts."""
        for name in names:
            self.homes[name] = Home(self, name)
            await self.homes[name].start()

    async def create(self, host: str, name: str, page: str) -> None:
        """Make a robot of a page."""
        client = HostClient(self.operator, self.homes[host].host.address)
        await client.create(Bundle(HEADER + page, f"{name}.py"), name)
        await self.until(lambda: bool(self.keys("robot", name)))

    def keys(self, role: Any, name: str) -> list[str]:
        return self.operator.presence.keys(everyone(role, name))

    def robot(self, name: str) -> RobotClient:
        """Ask a robot, wherever it is."""
        from robotree.vr.base.address import Address

        address = Address.parse(self.keys("robot", name)[0])
        assert address is not None
        return RobotClient(self.operator, address)

    async def enslave(self, parent: str, slot: str, child: str) -> None:
        await self.robot(parent).enslave(slot, self.robot(child).address)

    async def migrate(self, name: str, host: str) -> str:
        """Have a robot move; returns what the host says."""
        home = self.home_of(name)
        key = home.host.address.key
        return (await ask(self.operator, key, Migrate(robot=name, host=host), Done, timeout=WAITING)).note

    def home_of(self, name: str) -> Home:
        """Return where a robot is."""
        return next(home for home in self.homes.values() if name in home.host.agents)

    def where(self, name: str) -> list[str]:
        """Return the hosts that have a robot."""
        return [each for each, home in self.homes.items() if name in home.host.agents]

    async def noted(self, name: str, kind: str = "moved") -> list[HistoryEvent]:
        """Return what all hosts have kept of the moves of a robot, or of something else, in time."""
        found: list[HistoryEvent] = []
        for home in self.homes.values():
            request, key = ReadEvents(robot=name), home.host.address.key
            await self.until(lambda home=home: not home.history.waiting)
            found += [
                one.event
                for one in (await ask(self.operator, key, request, EventsRead, timeout=WAITING)).events
            ]
        return sorted((one for one in found if one.kind == kind), key=lambda one: one.unix)

    def field(self, name: str, field: str) -> Any:
        """Return what a robot keeps."""
        return self.home_of(name).host.agents[name].runtime.core.state.fields[field]

    async def until(self, so: Callable[[], bool]) -> None:
        async with asyncio.timeout(WAITING):
            while not so():  # noqa: ASYNC110 # any thread changes it
                await asyncio.sleep(0.002)

    async def close(self) -> None:
        for home in self.homes.values():
            await home.close()
        await self.operator.close()


def played(folder: Path, story: Callable[[Stage], Awaitable[None]]) -> None:
    """Play a story with a realm of its own."""

    async def play() -> None:
        stage = Stage(folder)
        try:
            await story(stage)
        finally:
            await stage.close()

    asyncio.run(play())


@pytest.fixture
async def stage(tmp_path: Path) -> AsyncIterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    await stage.close()
