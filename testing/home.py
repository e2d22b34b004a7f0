"""The process of a page in a rehearsal: it keeps its robot as a host does, and can crash and come back.

The journal is that of a host, on a disk in memory. A crash ends the process at once; its next life reads what
was written, and the command goes on at its next step.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from robotree.testing.journal import Journal
from robotree.testing.parts import Stage
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.run import kept_by
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import RobotState
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.records import KeptPage
from robotree.vr.journal.recovery import rebase
from robotree.vr.running.process import Process
from robotree.vr.world.disk import LogClocks, Medium, MemoryDisk
from robotree.vr.world.world import SimulatedProcess

FOLDER = Path("/rehearsal")
_PAGE = KeptPage("", "")
"""It is made again of its class, not of a source."""


class Home:
    """See the module."""

    def __init__(self, team: Stage, path: str, make: Callable[[], VirtualRobot]) -> None:
        """Begin with an empty disk.

        Args:
            team: of the rehearsal.
            path: slot of the page's robot.
            make: makes the robot, now and for each further life of the process.
        """
        self._team, self._path, self._make = team, path, make
        self._medium = Medium()
        self._robot: VirtualRobot | None = make()

    async def live(self, process: SimulatedProcess) -> None:
        """Live one life: the first one, or another one after a crash."""
        disk = MemoryDisk(self._medium)
        process.on_exit.append(disk.end)
        kept = HostJournal(FOLDER, LogClocks(process.runner), disk=disk)
        kept.end_process = process.world.runner.leave  # what still runs of a killed process writes nothing
        threads = self._team.threads(process, _Both(self._team.journal, kept))
        transport = kept_by(kept, threads, process.transport)
        state = self._restored(kept, threads)
        robot, self._robot = self._robot or self._make(), None
        agent = RobotAgent(robot, transport, process=threads, state=state)
        kept.made(agent.address.key, agent.robot.name, _PAGE, agent.runtime.look)
        kept.begin()
        await agent.start()
        if state is not None:
            await agent.take_back()
            agent.go_on()
        self._team.lives(self._path, agent)
        await asyncio.Event().wait()

    def _restored(self, kept: HostJournal, threads: Process) -> RobotState | None:
        """Return the robot's state from the life before; None: there was none."""
        if not kept.found.robots:
            return None
        state, now = kept.found.robots[0].state, threads.runner.now()
        threads.gap = max(0.0, now - kept.found.latest - kept.shift)
        rebase([state], kept.shift, now)
        return state


class _Both:
    """Writes events into the record of the rehearsal and into the journal of a process."""

    def __init__(self, record: Journal, kept: HostJournal) -> None:
        self._record, self._kept = record, kept

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        self._record.append(robot, now, event)
        self._kept.append(robot, now, event)

    def commit(self) -> None:
        self._kept.commit()
