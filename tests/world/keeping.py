"""Hosts that keep their robots on disks of the World, and end at a chosen moment of their own work."""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.host import Host
from robotree.vr.agents.run import kept_by
from robotree.vr.base.errors import VrError
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import RobotCore, RobotState, decode_state, encode_state
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.records import KeptPage
from robotree.vr.journal.recovery import KeptRobot
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.running.process import Process
from robotree.vr.world.disk import LogClocks, Medium, MemoryDisk
from robotree.vr.world.virtual_runner import VirtualProcess
from robotree.vr.world.world import SimulatedProcess, World
from tests.world.realm import Realm

RETURNS = 3.0
"""[s] that the children of a host's robots wait for it."""
MOMENTS = (
    *("before write", "within write", "after write", "before create", "after create", "before sync"),
    *(
        "after sync",
        "before mark",
        "before unlink",
        "after unlink",
        "before lock",
        "after event",
        "robot back",
    ),
    *("before send", "after send", "before reply", "after reply", "switch"),
)
"""At which a host can end."""


class Shadow:
    """What a journal was given of one robot, beside the journal: it judges what the next host finds."""

    def __init__(self, state: RobotState) -> None:
        self.first = encode_state(state)
        self.events: list[tuple[float, CoreEvent]] = []
        self.count = 0
        """Events that the journal has."""
        self.acknowledged = self.synced = -1
        """Events that must outlive the process, and the power; -1: not even the robot must."""
        self.gone = self.gone_for_good = False
        """Whether it was deleted, and whether it must not be found again after the end of the process."""

    def states(self, least: int) -> list[bytes]:
        """Return the states that may be found: after so many events at least."""
        core = RobotCore(decode_state(self.first))
        found = [self.first] if least <= 0 else []
        for number, (now, event) in enumerate(self.events, 1):
            core.handle(event, now)
            if number >= least:
                found.append(encode_state(core.state))
        return found


class Keep:
    """What a host leaves behind: its disk, and what it must find there."""

    def __init__(self, name: str) -> None:
        self.name, self.folder = name, Path("/keep") / name
        self.medium = Medium()
        self.boots = 0
        """How often its machine was started again."""
        self.shadows: dict[str, Shadow] = {}
        self.lost_power = self.replaced = False
        """Whether it happened since the last life of the host began."""
        self.slow = 0.0
        """[s] that an operation of the disk takes at most."""

    def check(self, found: list[KeptRobot]) -> list[str]:
        """Return what is not as it was acknowledged."""
        if self.replaced:
            return []
        wrong: list[str] = []
        states = {robot.key: robot for robot in found}
        for key, shadow in self.shadows.items():
            least = shadow.synced if self.lost_power else shadow.acknowledged
            if key not in states:
                if least >= 0 and not shadow.gone:
                    wrong.append(f"{key} is lost")
            elif shadow.gone_for_good and not self.lost_power:
                wrong.append(f"{key} is back, and was deleted")
            elif least >= 0 and encode_state(states[key].state) not in shadow.states(least):
                wrong.append(
                    f"{key} is found in another state than any that it had since it was acknowledged"
                )
        return wrong


class WatchedJournal(HostJournal):
    """A journal beside which a judge notes what it was given, and what must be found again."""

    def __init__(self, keep: Keep, clocks: LogClocks, disk: MemoryDisk, moment: Callable[[str], Any]) -> None:
        self._keep, self._moment = keep, moment
        super().__init__(keep.folder, clocks, boot=f"boot {keep.boots}", disk=disk)

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        shadow = self._keep.shadows.get(robot) if robot in self._numbers else None
        if shadow is not None:
            shadow.events.append((now, event))
        super().append(robot, now, event)
        if shadow is not None:
            shadow.count += 1
        self._moment("after event")

    def made(self, key: str, name: str, page: KeptPage, look: Any) -> None:
        def watched(enter: Callable[[RobotState], None]) -> None:
            def both(state: RobotState) -> None:
                if key not in self._keep.shadows:
                    self._keep.shadows[key] = Shadow(state)
                enter(state)

            look(both)

        super().made(key, name, page, watched)

    def arrived(self, key: str, *more: Any) -> None:
        self._keep.shadows.pop(key, None)  # of an earlier time, when it was here before
        super().arrived(key, *more)

    def gone(self, key: str) -> None:
        super().gone(key)
        if key in self._keep.shadows:
            self._keep.shadows[key].gone = True

    def barrier(self) -> None:
        marks = self._marks()
        super().barrier()
        self._acknowledge(marks)

    def begin(self) -> None:
        marks = self._marks()
        super().begin()
        self._acknowledge(marks, synced=True)

    def sync(self) -> None:
        marks = self._marks()
        super().sync()
        self._acknowledge(marks, synced=True)

    def _clear(self) -> None:
        for shadow in self._keep.shadows.values():  # a full disk keeps nothing, and says so
            shadow.acknowledged, shadow.synced, shadow.gone_for_good = -1, -1, False
        super()._clear()

    def _marks(self) -> list[tuple[Shadow, int, bool]]:
        shadows = self._keep.shadows
        return [(shadow, shadow.count, shadow.gone) for shadow in shadows.values()]

    def _acknowledge(self, marks: list[tuple[Shadow, int, bool]], *, synced: bool = False) -> None:
        if self.suspended or self._sealed:
            return
        for shadow, count, gone in marks:
            shadow.acknowledged = max(shadow.acknowledged, count)
            shadow.gone_for_good = gone
            if synced:
                shadow.synced = max(shadow.synced, count)


class Door:
    """A transport with moments around what leaves by it. What comes by it is its process's turn."""

    def __init__(self, transport: Any, process: VirtualProcess, moment: Callable[[str], Any]) -> None:
        self._transport, self._process, self._moment = transport, process, moment
        self.presence, self.identity = transport.presence, transport.identity

    def __getattr__(self, name: str) -> Any:
        return getattr(self._transport, name)

    def ask(self, *values: Any, on_reply: Callable[[Any], None], **options: Any) -> None:
        def hear(reply: Any) -> None:
            self._process.runner.turning = self._process
            on_reply(reply)

        self._moment("before send")
        self._transport.ask(*values, on_reply=hear, **options)
        self._moment("after send")

    def publish(self, *values: Any) -> None:
        self._moment("before send")
        self._transport.publish(*values)
        self._moment("after send")

    async def serve(self, key: str, take: Any, *, rank: int = 0) -> Any:
        return await self._transport.serve(key, lambda incoming: take(self._watched(incoming)), rank=rank)

    def _watched(self, incoming: Any) -> Any:
        def at_moments(send: Callable[..., None]) -> Callable[..., None]:
            def sends(body: bytes | None = None) -> None:
                self._moment("before reply")
                send(body)
                self._moment("after reply")

            return sends

        self._process.runner.turning = self._process
        incoming.reply, incoming.end = at_moments(incoming.reply), at_moments(incoming.end)
        return incoming


class WatchedHost(Host):
    """A host with a moment after each robot that is back."""

    moment: Callable[[str], Any]

    async def _settle(self, agent: RobotAgent) -> None:
        await super()._settle(agent)
        self.moment("robot back")


class KeepingRealm(Realm):
    """A realm whose hosts keep their robots, each on a disk of its own."""

    def __init__(self, world: World) -> None:
        self.keeps = {name: Keep(name) for name in ("host-1", "host-2")}
        self.armed: dict[str, list[tuple[str, int]]] = {}
        """At which moments of its next lives each host ends: what, and the how manieth."""
        self.count: dict[str, int] = {}
        self.offset = 0.0
        """[s] by which the monotonic clock of the machine is ahead of the World's."""
        self.complain: Callable[[str], None] = lambda _: None
        self._disks = random.Random(f"{world.seed} disks")
        super().__init__(world, lookups=1, hosts=2, carts=2)
        self._preempt = world.runner.preempt
        world.runner.preempt = self._preempted  # type: ignore[method-assign] # a moment at each switch

    def start(self, name: str) -> SimulatedProcess:
        self.count.pop(name, None)
        self.processes[name] = self.world.start(name, self._main_of(name), offset=self.offset)
        return self.processes[name]

    def moment(self, name: str, what: str) -> None:
        """A host comes to a moment of its work: it ends here, if it is the chosen one."""
        armed, process = self.armed.get(name), self.processes[name]
        if not armed or armed[0][0] != what or not process.alive or self.world.runner.acting:
            return
        left = self.count.get(name, armed[0][1]) - 1
        self.count[name] = left
        if left <= 0:
            self.world.note(name, f"ends: {what}")
            del armed[0]
            process.kill()
            self.world.runner.leave()

    def _preempted(self) -> None:
        process = self.world.runner.turning
        if process is not None and process.name in self.keeps and not process.ended:
            self.moment(process.name, "switch")
        self._preempt()

    async def _host(self, process: SimulatedProcess) -> None:
        keep, runner = self.keeps[process.name], process.runner

        def moment(what: str) -> None:
            if not runner.ended:
                self.moment(keep.name, what)

        def on_disk(what: str) -> None:
            moment(what)
            if keep.slow and what.startswith("before") and self._disks.random() < 0.2:
                runner.waiter().wait(self._disks.random() * keep.slow)

        disk = MemoryDisk(keep.medium, moment=on_disk, chance=self._disks.random)
        process.on_exit.append(disk.end)
        try:
            await self._be_host(process, keep, disk, moment)
        except (OSError, VrError) as error:  # the command line prints it, and ends
            self.world.note(process.name, "cannot start", f"{type(error).__name__}: {error}")
            if process.alive and keep.medium.room == inf and not keep.medium.broken:
                self.complain(f"{process.name} cannot start: {type(error).__name__}: {error}")

    async def _be_host(
        self, process: SimulatedProcess, keep: Keep, disk: MemoryDisk, moment: Callable[[str], None]
    ) -> None:
        journal = WatchedJournal(keep, LogClocks(process.runner), disk, moment)

        def end_process() -> None:
            process.kill()
            self.world.runner.leave()

        journal.end_process = end_process
        for wrong in keep.check(journal.found.robots):
            self.complain(f"{process.name}: {wrong}")
        keep.shadows.clear()
        keep.lost_power = keep.replaced = False
        home: Process[Any] = Process(process.runner, journal, self.world.core)
        door: Any = Door(process.transport, process.runner, moment)
        transport = kept_by(journal, home, door, RETURNS)
        host = WatchedHost(
            transport,
            process.name,
            registrar=Registrar(transport),
            process=home,
            limit=inf,
            journal=journal,
        )
        host.moment = moment
        host.moves.moment = lambda place: moment(f"move {place}")  # type: ignore[method-assign]
        self.hosts[process.name] = host
        await host.start()
        await host.restore()
        self.world.note(process.name, "is back", journal.life)
        await asyncio.Event().wait()
