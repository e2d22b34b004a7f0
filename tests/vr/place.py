"""A host with a journal, in a network in memory, that may be started again."""

from __future__ import annotations

import asyncio
from pathlib import Path

from robotree.vr.agents.host import Host
from robotree.vr.bundle.admission import Gate
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.journal.journal import HostJournal
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of
from robotree.vr.world.network import MemoryNetwork


class HostPlace:
    """See the module."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.network, self.gate = folder, MemoryNetwork(), Gate()

    async def start(self) -> None:
        runner = runner_of(asyncio.get_running_loop())
        self.journal = HostJournal(self.folder / "journal", runner)
        process, transport = Process(runner, self.journal), self.network.join("host-1")
        self.host = Host(transport, "host-1", process=process, journal=self.journal, gate=self.gate)
        self.client = HostClient(self.network.join("operator"), self.host.address)
        await self.host.start()
        await self.host.restore()

    async def end(self) -> None:
        await self.host.close()
        self.journal.close()

    def robot(self, name: str) -> RobotClient:
        return RobotClient(self.network.join(), self.host.agents[name].address)
