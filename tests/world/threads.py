"""Scenes of threads that meet in one object, and lose the processor before any statement of it.

They are for locks that exclude others for moments only: a whole story comes too seldom to such a moment.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import msgspec

from robotree.vr.agents import callers, outside
from robotree.vr.agents.callers import Callers
from robotree.vr.agents.outside import OutsideCalls
from robotree.vr.author.robot import Robot
from robotree.vr.base import presence
from robotree.vr.base.address import Address
from robotree.vr.base.errors import DamagedJournal
from robotree.vr.base.os_files import AT_ONCE
from robotree.vr.base.policy import OPEN
from robotree.vr.base.presence import Presence
from robotree.vr.base.principal import Credentials
from robotree.vr.core import events as on
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.events import CoreEffect, CoreEvent
from robotree.vr.core.machine import Calls, RobotCore, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.journal import journal
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.records import Happened, KeptPage, LogRecord, decoder
from robotree.vr.journal.segments import Segments
from robotree.vr.network import mesh, readers, refusals, rendezvous
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.readers import Readers, Sockets, What
from robotree.vr.network.realms import keys_of
from robotree.vr.network.refusals import Refusals
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.running import log, process, robot_runtime, runner
from robotree.vr.running.log import Log
from robotree.vr.running.process import Process, Worker
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.runner import Interrupted, SerialWorker
from robotree.vr.world.disk import LogClocks, Medium, MemoryDisk
from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner, virtual_runner
from tests.world.machine import ROOT, Machine
from tests.world.points import at_every_statement

THREADS = 3
SENT = 20
"""Bytes that come one by one."""
LENGTH = 10.0
"""[s] of virtual time; the threads begin at 0."""
Law = Callable[[], bool]
"""Whether all is well at the end."""


class Stage:
    """Where threads play: a runner, a process in it, and its system."""

    def __init__(self, runner: VirtualRunner, seed: int) -> None:
        self.runner = runner
        self.process = VirtualProcess(runner, "process")
        self.system = Machine(runner, seed).boot(self.process)
        self.undo = contextlib.ExitStack()
        self.broken: list[str] = []
        """What is wrong."""

    def change(self, module: ModuleType, name: str, value: object) -> None:
        """Give something of a module another value until the scene ends."""
        self.undo.callback(setattr, module, name, getattr(module, name))
        setattr(module, name, value)

    def pass_by(self, _: str) -> None:
        """Come to a point, as an operation of a disk does."""
        self.runner.point()

    def start(self, work: Callable[[int], None]) -> None:
        """Have each thread do something, with its number."""
        for number in range(THREADS):
            self.process.spawn(partial(work, number), "thread")


def _presence(stage: Stage) -> Law:
    """Processes come and go under one key: the watcher is told each change once, and nobody is left."""
    table = Presence(held=lambda _: [], unheard=lambda _: [], lock=stage.system.rlock())
    changes: list[bool] = []
    table.watch("robot/*/*", lambda _, there: changes.append(there))

    def work(_: int) -> None:
        for there in (True, False, True, False):
            table.count("robot/a/1", there=there)

    stage.start(work)
    return lambda: table.keys("**") == [] and changes == [True, False] * (len(changes) // 2)


class _Logger:
    def __init__(self, lines: list[str]) -> None:
        self._lines = lines

    def warning(self, _form: str, text: str) -> None:
        self._lines.append(text)


def _refusals(stage: Stage) -> Law:
    """A kind of refusal is one line a second, however many threads refuse."""
    lines: list[str] = []
    kept = Refusals(cast("Any", _Logger(lines)), system=stage.system)
    stage.start(lambda number: kept.note("user", f"user {number}"))
    return lambda: len(lines) == 1


def _log(stage: Stage) -> Law:
    """Each line has a number of its own."""
    kept = Log(stage.process.now, stage.process.unix, stage.runner.lock())

    def work(number: int) -> None:
        for _ in range(3):
            kept.say("info", f"{number}")

    stage.start(work)

    def law() -> bool:
        numbers = [line.number for line in kept.since(0)]
        return numbers == list(range(1, 3 * THREADS + 1))

    return law


def _serial_worker(stage: Stage) -> Law:
    """All that is submitted is done, one after the other."""
    worker = SerialWorker(stage.process, "worker")
    done: list[int] = []

    def do(number: int) -> bool:
        done.append(number)
        return True

    def work(number: int) -> None:
        for _ in range(3):
            worker.submit(partial(do, number))

    stage.start(work)
    return lambda: Counter(done) == dict.fromkeys(range(THREADS), 3)


def _timers(stage: Stage) -> Law:
    """Each timer goes off once, at most as late as threads are."""
    home = Process[Any](stage.process)
    rung: list[float] = []

    def ring(when: float) -> None:
        rung.append(stage.runner.now() - when)

    def work(number: int) -> None:
        for seconds in (0.1 * number, process.IDLE + 0.1 * number, 0.0):
            when = stage.runner.now() + seconds
            home.at(when, partial(ring, when))
            stage.process.waiter().wait(process.IDLE)

    stage.start(work)
    return lambda: len(rung) == 3 * THREADS and max(rung) < 0.1


def _worker(stage: Stage) -> Law:
    """An interruption strikes an author's code only."""
    home = Process[Any](stage.process)
    worker = Worker(home)
    struck: list[bool] = []

    def carry_out() -> None:
        worker.thread = worker.here()
        for _ in range(20):
            worker.top = frame = object()
            begun = False
            while worker.top is frame:
                try:
                    if not begun:
                        begun = True
                        worker.arm(frame)
                        stage.runner.point()
                    worker.disarm()
                    worker.top = None
                except Interrupted:
                    continue
            try:
                for _ in range(4):
                    stage.runner.point()
            except Interrupted:
                struck.append(True)
            stage.process.waiter().wait(0.002)

    def interrupt() -> None:
        for _ in range(20):
            worker.interrupt()
            stage.process.waiter().wait(0.002)

    stage.process.spawn(carry_out, "worker")
    stage.process.spawn(interrupt, "who interrupts")
    return lambda: not struck


def _callers(stage: Stage) -> Law:
    """The loop is woken once for each caller."""
    woken: list[str] = []

    class Runtime:
        process = Process[Any](stage.process)

        def attend(self, key: str, caller: str) -> None: ...

    class Loop:
        def call_soon_threadsafe(self, watch: partial[None], *, context: object) -> None:
            del context
            woken.extend(watch.args)

    async def make() -> Callers:
        return Callers(cast("Any", Runtime()), cast("Any", None))

    made = asyncio.run(make())
    made._loop = cast("Any", Loop())
    stage.start(lambda number: made.attend("caller/a/1", f"key {number}"))
    return lambda: woken == ["caller/a/1"]


def _rendezvous(stage: Stage) -> Law:
    """What is written down is what is held."""
    place = Rendezvous("r", ROOT, system=stage.system)
    key = "robot/a{}/1".format

    def work(number: int) -> None:
        place.hold(key(number))
        place.hold(key(f"{number}b"))
        place.drop(key(number))

    def begin() -> None:
        place.register()
        stage.start(work)

    found: list[list[str] | None] = []
    stage.process.spawn(begin, "begin")
    stage.runner.at(LENGTH - 1.0, lambda: stage.process.spawn(look, "look"))

    def look() -> None:
        found.append(keys_of(place.directory, place.tag, stage.system))

    wanted = sorted(key(f"{number}b") for number in range(THREADS))
    return lambda: sorted(found[0] or []) == wanted


def _readers(stage: Stage) -> Law:
    """There is always a thread that reads, though each carries out what it has read."""
    system, sockets = stage.system, Sockets(stage.system)
    near, far = system.socketpair()
    nudged, nudge = system.socketpair()
    for end in (near, nudged):
        end.setblocking(False)
    come: list[bytes] = []

    def work(seconds: float) -> bool:
        stage.process.waiter().wait(seconds)
        return True

    def wake() -> None:
        nudge.send(b"x", AT_ONCE)

    def serve(what: What, _events: int) -> bool:
        if what is wake:
            nudged.recv(100)
            return False
        try:
            come.append(near.recv(1))
        except BlockingIOError:
            return False
        pool.after_reading(partial(work, 0.01 * (len(come) % 3)))
        return True

    pool = Readers(
        sockets,
        serve=serve,
        tick=lambda: None,
        period=1000.0,
        system=system,
        wake=wake,
        release=come.clear,
    )

    def begin() -> None:
        pool.due = 1000.0
        sockets.add(near, lambda: None)
        sockets.add(nudged, wake)
        pool.start()
        for _ in range(SENT):
            far.sendall(b"x")
            system.sleep(0.01)

    stage.process.spawn(begin, "begin")
    return lambda: len(come) == SENT


def _mesh(stage: Stage) -> Law:
    """Another process knows what is wanted here, though many threads change it."""
    machine = stage.system.machine
    other = machine.boot(VirtualProcess(stage.runner, "other"))
    here, there = (Mesh(Rendezvous("r", ROOT, system=system)) for system in (stage.system, other))
    for one in (here, there):
        one.place.system.spawn(one.open, "open")

    def work(_: int) -> None:
        for _ in range(3):
            here.unsubscribe(here.subscribe("robot/*/1", lambda _key, _body: None))

    stage.runner.at(1.0, lambda: stage.start(work))

    def law() -> bool:
        peer = there._peers.get(here.place.tag)
        return peer is not None and all(keys == set(here._known[topic]) for topic, keys in peer.known.items())

    return law


class _Book:
    """A journal, and the core whose events it takes; both in the order in which they got them."""

    def __init__(self) -> None:
        self.written: list[CoreEvent] = []
        self.handled: list[CoreEvent] = []

    def append(self, _robot: str, _now: float, event: CoreEvent) -> None:
        self.written.append(event)

    def commit(self) -> None: ...

    def core(self, state: RobotState) -> RobotCore:
        book = self

        class Core(RobotCore):
            def handle(self, event: CoreEvent, now: float) -> list[CoreEffect]:
                book.handled.append(event)
                return super().handle(event, now)

        return Core(state)


def _state(stage: Stage) -> RobotState:
    """Return the state of a robot that has just been made."""
    return RobotState(
        address=Address("robot", "a", "1"),
        home="host",
        lease=GrantedLease.free("a", term=5.0, unix=stage.process.unix()),
        slots=Slots("a"),
        calls=Calls(),
        stop=Stop(),
    )


def _robot(stage: Stage) -> Law:
    """The journal has the order of what has happened."""
    book = _Book()
    home = Process[Any](stage.process, journal=book)
    state = _state(stage)
    identity = Credentials(stage.process.pid(), stage.system.user())
    runtime = RobotRuntime(
        Robot("a"),
        book.core(state),
        home,
        execute=cast("Any", None),
        transport=cast("Any", SimpleNamespace(identity=identity, gate=OPEN)),
        describe_child=cast("Any", None),
        follow_child=cast("Any", None),
        obeyed=None,
        on_effect=lambda _: None,
    )

    def work(number: int) -> None:
        for turn in range(3):
            runtime.post(on.Set(values={"number": 10 * number + turn}))

    stage.start(work)
    return lambda: book.written == book.handled and len(book.written) == 3 * THREADS


def _journal(stage: Stage) -> Law:
    """What was appended is in the log, once and in its order; a sync keeps all that was before it."""
    medium, folder = Medium(), Path("/keep/a")
    state = _state(stage)
    kept = HostJournal(folder, LogClocks(stage.process), disk=MemoryDisk(medium, moment=stage.pass_by))
    synced: list[int] = []

    def begin() -> None:
        kept.begin()
        kept.made(state.address.key, "a", KeptPage("", ""), lambda query: query(state))
        stage.start(work)

    def work(number: int) -> None:
        for turn in range(3):
            kept.append(state.address.key, 0.0, on.Set(values={f"{number}": turn}))
            before = kept._appended
            (kept.sync, kept.barrier)[(number + turn) % 2]()
            if (number + turn) % 2 == 0:
                synced.append(kept._synced - before)

    def law() -> bool:
        medium.locks.clear()
        events = [record.event for record in _records(folder, medium) if isinstance(record, Happened)]
        turns = [[event.values[f"{n}"] for event in events if f"{n}" in event.values] for n in range(THREADS)]
        return turns == [[0, 1, 2]] * THREADS and all(ahead >= 0 for ahead in synced)

    stage.process.spawn(begin, "begin")
    return law


def _syncs(stage: Stage) -> Law:
    """A file that is synchronised is not closed meanwhile, though a new one begins whenever there is much."""
    stage.change(journal, "LONG", 100)
    kept = HostJournal(Path("/keep/a"), LogClocks(stage.process), disk=MemoryDisk(moment=stage.pass_by))
    late: list[int] = []

    def begin() -> None:
        kept.begin()
        kept.made("robot/a/1", "a", KeptPage("", ""), lambda _: None)
        kept._numbers["robot/a/1"] = 1
        stage.start(work)

    def work(_: int) -> None:
        for _ in range(4):
            kept.append("robot/a/1", 0.0, on.Set(values={"a": "b" * 60}))
            own = kept._appended
            kept.sync()
            if kept._synced < own:
                late.append(own)

    stage.process.spawn(begin, "begin")
    return lambda: not late and not kept.suspended and kept._synced >= 4 * THREADS


def _records(folder: Path, medium: Medium) -> list[LogRecord]:
    """Return what a log says; nothing, if it cannot be read."""
    frames = Segments(folder, MemoryDisk(medium)).frames()
    try:
        return [record for frame in frames for record in decoder.decode(frame)]
    except (msgspec.DecodeError, DamagedJournal):
        return []


def _outside_calls(stage: Stage) -> Law:
    """Calls that come while a host goes on are all begun, each once."""
    runtime = SimpleNamespace(process=Process[Any](stage.process), robot=Robot("a"))
    calls = OutsideCalls(
        cast("Any", runtime), is_open=lambda: True, attend=lambda _caller, _key: None, waits=True
    )
    begun: list[int] = []

    def work(number: int) -> None:
        if number == 0:
            calls.go_on()
        else:
            call = partial(begun.append, number)
            if not calls._has_to_wait(call):
                call()

    stage.start(work)
    return lambda: sorted(begun) == list(range(1, THREADS))


SCENES: dict[str, tuple[Callable[[Stage], Law], ModuleType]] = {
    "presence": (_presence, presence),
    "refusals": (_refusals, refusals),
    "log": (_log, log),
    "serial worker": (_serial_worker, runner),
    "timers": (_timers, process),
    "worker": (_worker, process),
    "callers": (_callers, callers),
    "rendezvous": (_rendezvous, rendezvous),
    "mesh": (_mesh, mesh),
    "readers": (_readers, readers),
    "robot": (_robot, robot_runtime),
    "journal": (_journal, journal),
    "syncs": (_syncs, journal),
    "calls that wait": (_outside_calls, outside),
}
"""Each scene, and the module before whose statements threads lose the processor."""


def play(scene: str, seed: int) -> tuple[str, Stage]:
    """Play a scene; returns what follows from its seed, and where it was played."""
    begin, module = SCENES[scene]
    with virtual_runner(seed) as runner, at_every_statement((module,), runner.point):
        stage = Stage(runner, seed)
        law = begin(stage)
        runner.preemption.share, runner.preemption.starve = 0.3, 0.01
        try:
            with stage.undo:
                runner.run(LENGTH)
        except Exception as error:  # noqa: BLE001 # a fault of the program, which the seed has found
            stage.broken.append(f"raised: {type(error).__name__}: {error}")
        runner.preemption.share = 0.0
        if not stage.broken and not law():
            stage.broken.append(f"not so: {begin.__doc__}")
        return f"{runner.switches} {runner.preemption.count}", stage
