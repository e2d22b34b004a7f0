"""The processes of a rehearsal that keep something: a page, as a host keeps it, and the space, in memory."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from robotree.testing.journal import Journal
from robotree.testing.parts import Stage
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.run import kept_by
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.entry import entry_of, revived, template_of
from robotree.vr.base.requests import FOR_EVER, AnyRequest, EntriesFound, EntryLeased, FindEntries, WriteEntry
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import RobotState
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.records import KeptPage
from robotree.vr.journal.recovery import rebase
from robotree.vr.running.process import Process
from robotree.vr.space.service import SpaceService
from robotree.vr.space.store import MemoryStore
from robotree.vr.world.disk import LogClocks, Medium, MemoryDisk
from robotree.vr.world.world import SimulatedProcess

FOLDER = Path("/rehearsal")
_PAGE = KeptPage("", "")
"""It is made again of its class, not of a source."""


class Home:
    """The process of a page: it keeps its robot as a host does, and can crash and come back.

    The journal is that of a host, on a disk in memory. A crash ends the process at once; its next life reads
    what was written, and the command goes on at its next step.
    """

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


# -- the space: what a test puts there for the page, and what the page has left ----------------------


SPACE = "space"
"""Its name."""
MOST = 1000
"""Entries that one call returns at most."""
_T = TypeVar("_T")

Ask = Callable[[str, AnyRequest, type[Any]], Any]
"""Asks the agent under a key, lets time pass until it has answered, and returns the answer."""


class TeamSpace:
    """`Team.space`; its methods raise what those of a page's `self.space` raise.

    team = rehearse(Porter)
    team.space.write(Delivery("hall"))
    team.call("work")
    assert team.space.take(Report) == Report("hall")
    """

    def __init__(self, ask: Ask) -> None:
        """Made by a team; `live` is its process."""
        self._ask = ask
        self.key = ""
        """Of its agent; empty: it does not live yet."""

    async def live(self, process: SimulatedProcess) -> None:
        """Be the space."""
        loop = asyncio.get_running_loop()
        service = SpaceService(process.transport, SPACE, MemoryStore(SPACE, loop.time))
        await service.start()
        self.key = service.address.key
        await asyncio.Event().wait()

    def write(self, entry: object, *, lease: float = FOR_EVER, key: str = "") -> None:
        """Put an entry into it; `lease` [s]."""
        self._ask(self.key, WriteEntry(entry=entry_of(entry), term=lease, key=key), EntryLeased)

    def read(self, wanted: type[_T], /, **fields: Any) -> _T | None:
        """Return the oldest entry that matches; None: there is none."""
        return next(iter(self._find(wanted, fields, take=False)), None)

    def read_all(self, wanted: type[_T], /, **fields: Any) -> list[_T]:
        """Return the entries that match, the oldest first."""
        return self._find(wanted, fields, take=False, most=MOST)

    def take(self, wanted: type[_T], /, **fields: Any) -> _T | None:
        """As `read`, but take it out."""
        return next(iter(self._find(wanted, fields, take=True)), None)

    def _find(self, wanted: type[_T], fields: dict[str, Any], *, take: bool, most: int = 1) -> list[_T]:
        kind, given = template_of(wanted, fields)
        request = FindEntries(kind=kind, fields=given, take=take, most=most)
        found = self._ask(self.key, request, EntriesFound)
        return [revived(entry, wanted) for _, entry in found.entries]
