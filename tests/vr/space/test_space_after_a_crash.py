"""A host is killed while its page works with the space: the page goes on, and does nothing twice."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.agents.host import Host
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.outlet import Outlet
from robotree.vr.running.process import Process
from robotree.vr.space.memory import MemoryStore
from robotree.vr.space.service import SpaceService
from robotree.vr.world.world import SimulatedProcess, World

PAGE = '''
from dataclasses import dataclass
from robotree.vr import VirtualRobot, command
from robotree.vr.base.errors import TransactionOver

@dataclass(frozen=True)
class Task:
    number: int

@dataclass(frozen=True)
class Done:
    number: int

class Worker(VirtualRobot):
    """Writes tasks, and does them."""

    @command
    def work(self, many: int) -> list[int]:
        """Write tasks, take each, and note that it was done."""
        for number in range(many):
            self.space.write(Task(number))
        for number in range(many):
            while True:
                try:
                    with self.space.transaction(within=60) as tx:
                        task = tx.take(Task)
                        self.sleep(0.004)
                        tx.write(Done(task.number))
                    break
                except TransactionOver:
                    pass
        return [self.space.take(Done).number for _ in range(many)]
'''
MANY = 4


class Clocks:
    """The clocks of a simulated process; nothing else runs while its journal writes."""

    def __init__(self, process: SimulatedProcess) -> None:
        self.now, self.unix = process.runner.now, process.runner.unix
        self.lock = threading.RLock


class Crashing:
    """A host that is killed at moments, a space, and somebody who calls."""

    def __init__(self, world: World, folder: Path) -> None:
        self.world, self.folder = world, folder
        self.store: Any = None
        self.journal: HostJournal | None = None
        self.host: Any = None
        self.answer: list[Any] = []
        world.start("jobs", self.live_space)
        self.process = world.start("h1", self.live_host)
        self.operator = world.start("operator", self.wait)

    async def wait(self, _: SimulatedProcess) -> None:
        await asyncio.Event().wait()

    async def live_space(self, process: SimulatedProcess) -> None:
        self.store = MemoryStore("jobs", asyncio.get_running_loop().time)
        await SpaceService(process.transport, "jobs", self.store).start()
        await asyncio.Event().wait()

    async def live_host(self, process: SimulatedProcess) -> None:
        journal = self.journal = HostJournal(self.folder, Clocks(process), boot="this")
        threads: Process[Any] = Process(process.runner, journal)
        threads.life, threads.returns, threads.keeps_steps = journal.life, 10.0, True
        host = Host(Outlet(process.transport, journal.barrier), "h1", process=threads, journal=journal)
        await host.start()
        await host.restore()
        self.host = host
        await asyncio.Event().wait()

    async def create(self) -> None:
        page = Bundle(source=PAGE, path="worker.py")
        await HostClient(self.operator.transport, self.host.address).create(page, "worker")

    async def call(self) -> None:
        worker = RobotClient(self.operator.transport, self.host.agents["worker"].address)
        try:
            self.answer.append(await worker.call("work", {"many": MANY}, deadline=60.0))
        except Exception as error:  # noqa: BLE001 # compared with what is expected
            self.answer.append(error)

    def crash(self) -> None:
        """Kill the host, and start it again."""
        self.process.kill()
        assert self.journal is not None
        self.journal.close()
        self.process = self.world.start("h1", self.live_host)

    def until(self, end: float) -> None:
        while not self.answer and self.world.runner.now() < end:
            self.world.run(self.world.runner.now() + 0.01)


@pytest.mark.parametrize("part", range(6))
def test_a_page_that_works_with_the_space_goes_on_wherever_its_host_is_killed(
    tmp_path: Path, part: int
) -> None:
    """At each millisecond of its work in turn, from when its call was accepted."""
    for moment in range(5 + part, 65, 6):
        with World(moment) as world:
            story = Crashing(world, tmp_path / str(moment))
            world.run(1.0)
            story.operator.do(story.create, "create")
            world.run(2.0)
            story.operator.do(story.call, "call")
            world.run(2.0 + moment * 0.001)
            story.crash()
            story.until(50.0)
            assert story.answer == [list(range(MANY))], moment
            assert story.store.contents("", 99).counts == {}, moment
            assert story.store._table.transactions == {}, moment
            if story.journal is not None:
                story.journal.close()
