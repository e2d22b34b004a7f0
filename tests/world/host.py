"""Stories of one host: parents and children on it, groups and clean-up, two operators, and a slow disk.

A story lasts 13 s. Until 7.5 s the operators call, cancel, stop, release, bind anew, reload and delete; one
of them is killed at times. Threads lose the processor where the seed has it so. Then all is healed, and at
11.5 s a call through the whole tree must succeed.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
from collections.abc import Callable, Generator
from functools import partial
from math import inf
from types import ModuleType
from typing import Any, ClassVar

from greenlet import getcurrent

from robotree.vr.base.errors import CommandFailed, VrError
from robotree.vr.bundle import Bundle
from robotree.vr.core.events import CoreEffect, CoreEvent
from robotree.vr.core.machine import RobotCore, RobotState, encode_state
from robotree.vr.exchange.client import HostClient
from robotree.vr.running.process import Process
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.virtual_runner import VirtualProcess
from robotree.vr.world.world import SimulatedProcess, TracedCore
from tests.world.machine import MachineWorld, network_is_whole, play_on_machine
from tests.world.realm import be_lookup, be_operator, host_in
from tests.world.story import Deeds, Laws

_BEGIN = """
from robotree.vr import Child, VirtualRobot, command, state
from tests.world.host import block, noted, toil
"""
_WHEEL = '''
class Wheel(VirtualRobot):
    """A wheel, whose commands note when they begin and end."""
    turns: int = state(0)

    @command
    def turn(self, ticket: float, seconds: float) -> float:
        with noted(self, ticket):
            self.sleep(seconds)
            self.turns += 1
        return ticket

    @command
    def grind(self, ticket: float, seconds: float) -> float:
        """Compute, and ask nobody if it is cancelled."""
        with noted(self, ticket):
            for _ in range(5):
                toil(seconds)
                self.progress(0.5)
        return ticket

    @command
    def ignore(self, ticket: float, seconds: float) -> float:
        """Catch what ends it, once."""
        with noted(self, ticket):
            try:
                toil(10 * seconds)
            except BaseException:
                toil(seconds)
        return ticket

    @command
    def hang(self, ticket: float, seconds: float) -> float:
        """Wait in a call that nothing interrupts."""
        block(15 * seconds)
        return ticket

    @command(effect="read")
    def where(self, ticket: float, seconds: float) -> float:
        return ticket

'''
_AXLE = '''
class Axle(VirtualRobot):
    """Two wheels, which can live on the same host."""
    left = Child("Wheel")
    right = Child("Wheel")

    @command
    def nested(self, ticket: float, seconds: float) -> float:
        with noted(self, ticket):
            self.left.turn(ticket=ticket + 0.1, seconds=seconds)
            self.right.turn(ticket=ticket + 0.2, seconds=seconds)
        return ticket

    @command
    def both(self, ticket: float, seconds: float) -> float:
        with self.together() as pair:
            pair.start(self.left.turn, ticket=ticket + 0.1, seconds=seconds)
            pair.start(self.right.turn, ticket=ticket + 0.2, seconds=2 * seconds)
        return ticket + sum(pair.results) - sum(pair.results)

    @command
    def race(self, ticket: float, seconds: float) -> float:
        with self.first() as winner:
            winner.start(self.left.turn, ticket=ticket + 0.1, seconds=seconds)
            winner.start(self.right.turn, ticket=ticket + 0.2, seconds=3 * seconds)
        return ticket if winner.result else 0.0

    @command
    def started(self, ticket: float, seconds: float) -> float:
        """Start both, wait for one; the other ends with this command."""
        left = self.left.turn.start(ticket=ticket + 0.1, seconds=seconds)
        self.right.turn.start(ticket=ticket + 0.2, seconds=10 * seconds)
        left.result()
        return ticket

    @command
    def told(self, ticket: float, seconds: float) -> float:
        self.left.turn.tell(ticket=ticket + 0.7, seconds=seconds)
        return self.right.turn(ticket=ticket + 0.2, seconds=seconds) - 0.2

    @command
    def detached(self, ticket: float, seconds: float) -> float:
        self.left.turn.start(ticket=ticket + 0.8, seconds=5 * seconds).detach()
        self.sleep(seconds)
        return ticket

    @command
    def cleaned(self, ticket: float, seconds: float) -> float:
        try:
            self.left.turn(ticket=ticket + 0.1, seconds=seconds)
        finally:
            with self.cleanup(within=2.0):
                self.right.turn(ticket=ticket + 0.9, seconds=0.01)
        return ticket

    @command
    def watched(self, ticket: float, seconds: float) -> float:
        """Look who is there, again and again."""
        for _ in range(3):
            if self.left and self.right:
                self.left.where(ticket=ticket, seconds=0.0)
            self.sleep(seconds / 3)
        return ticket

    @command
    def grinds(self, ticket: float, seconds: float) -> float:
        with self.first() as winner:
            winner.start(self.left.grind, ticket=ticket + 0.1, seconds=seconds)
            winner.start(self.right.ignore, ticket=ticket + 0.2, seconds=seconds)
        return ticket

    @command(effect="read")
    def reads(self, ticket: float, seconds: float) -> float:
        return self.left.where(ticket=ticket, seconds=0.0)

'''
_CART = '''
class Cart(VirtualRobot):
    """An axle."""
    axle = Child("Axle")

    @command
    def drive(self, ticket: float, seconds: float) -> float:
        self.axle.nested(ticket=ticket, seconds=seconds)
        return ticket

    @command
    def grind(self, ticket: float, seconds: float) -> float:
        self.axle.nested(ticket=ticket, seconds=seconds)
        toil(20 * seconds)
        return ticket
'''

SOURCES = {"Wheel": _BEGIN + _WHEEL, "Axle": _BEGIN + _AXLE, "Cart": _BEGIN + _CART}
"""A page for each kind: a host loads each of its robots anew, and so loads no more than it needs."""

DETACHED = (7, 8, 9)
"""Last digits of tickets that go on without the command that has begun them."""


@contextlib.contextmanager
def noted(robot: Any, ticket: float) -> Generator[None]:
    """Tell the story when a command begins and ends."""
    story = HostStory.playing
    assert story is not None
    story.note(robot.name, "begins", round(ticket, 1))
    try:
        yield
    finally:
        story.note(robot.name, "ends", round(ticket, 1))


def toil(seconds: float) -> None:
    """Compute for some time [s]: only an interruption ends it early."""
    process().runner.toil(seconds)


def block(seconds: float) -> None:
    """Wait in the operating system for some time [s]: nothing ends it early."""
    process().waiter().wait(seconds)


def process() -> VirtualProcess:
    """Return the process in whose thread this is."""
    mine: Any = getcurrent()
    found: VirtualProcess = mine.process
    return found


LENGTH, BUILT, CALM, PROBE = 13.0, 1.5, 7.5, 11.5
"""[s] of a story; from when on operators call; from when on nothing goes wrong; when all must be whole."""
DEADLINE = 4.0
"""[s] of a call."""
ENDS = 12.0
"""[s] after which each call has ended: its deadline, an interruption, and a clean-up."""
AFTERWARDS = 0.5
"""[s] after the end of a command in which what it has started and not detached ends, too."""
ROBOTS = {
    "left": "Wheel",
    "right": "Wheel",
    "axle": "Axle",
    "one": "Wheel",
    "two": "Wheel",
    "rear": "Axle",
    "cart": "Cart",
    "spare": "Wheel",
}
BONDS = (
    ("axle", "left", "left"),
    ("axle", "right", "right"),
    ("rear", "left", "one"),
    ("rear", "right", "two"),
    ("cart", "axle", "rear"),
)
AXLE = ["nested", "both", "race", "started", "told", "detached", "cleaned", "watched", "reads", "grinds"]
COMMANDS = {
    "axle": AXLE,
    "cart": ["drive", "drive", "grind"],
    "spare": ["turn", "grind", "ignore", "hang", "where"],
}
OPERATORS = ("operator-1", "operator-2")


class KeepingCore(TracedCore):
    """A core that keeps what it handled, in its order."""

    __slots__ = ("first", "handled")

    def __init__(self, state: RobotState, world: MachineWorld) -> None:
        super().__init__(state, world)
        self.first, self.handled = encode_state(state), list[CoreEvent]()

    def handle(self, event: CoreEvent, now: float) -> list[CoreEffect]:
        effects = super().handle(event, now)
        self.handled.append(event)
        return effects


class SlowJournal:
    """Keeps all events; its disk is slow at times."""

    def __init__(self, process: SimulatedProcess, slow: float, chance: Callable[[], float]) -> None:
        self._runner, self._slow, self._chance = process.runner, slow, chance
        self.events: list[tuple[str, CoreEvent]] = []

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        del now
        self._runner.runner.point()
        self.events.append((robot, event))
        self._runner.runner.point()

    def commit(self) -> None:
        self._runner.runner.point()
        if self._slow and self._chance() < 0.2:
            self._runner.waiter().wait(self._chance() * self._slow)


class HostStory(Laws, Deeds):
    """What happens on one host, and the laws that hold there."""

    playing: ClassVar[HostStory | None] = None
    """The story that hears what pages note."""
    world: MachineWorld

    def __init__(self, seed: int, world: MachineWorld) -> None:
        super().__init__(world)
        self.chance = random.Random(f"{seed} host")
        self.realm_clients: dict[str, RealmClient] = {}
        self.processes: dict[str, SimulatedProcess] = {}
        self.host: Any = None
        self.cores: list[KeepingCore] = []
        self.journal: Any = None
        self.open: dict[str, float] = {}
        """Calls that have not ended, and when they must have [s]."""
        self.calls = self.done = 0
        self.whole = False
        self._slow_disk = self.chance.choice([0.0, 0.0, 0.01])
        self._running: dict[str, float] = {}
        """The ticket of the moving command that each robot carries out."""
        self._begun: set[tuple[str, float]] = set()
        self._over: dict[float, float] = {}
        """Calls whose callers have their results, and since when [s]."""
        self._resumes = self._resuming = 0
        """Releases that were begun, and those of them that have not succeeded."""
        self._held: dict[str, float] = {}
        """Robots whose stop was confirmed and that nobody has released since."""

    def tell(self) -> None:
        world, chance, at = self.world, self.chance, self.world.runner.at
        preemption = world.runner.preemption
        share = chance.choice([0.0, 0.02, 0.1, 0.3])
        preemption.starve = chance.choice([0.0, 0.0, 0.02])
        HostStory.playing = self
        for name in ("lookup-1", "host-1", *OPERATORS):
            self.start(name)
        at(0.4, lambda: self._as_operator(self._build(), "build"))
        at(BUILT, lambda: setattr(preemption, "share", share))
        for _ in range(24):
            rush = chance.choice([2.0, 3.0, 4.0, 5.0, 6.0])
            at(rush + chance.choice([0.0, 0.0, chance.random()]), self._call)
        for _ in range(chance.randrange(2, 7)):
            at(
                chance.choice([2.0, 4.0, 5.0]) + chance.choice([0.01, chance.random()]),
                chance.choice(self._deeds()),
            )
        at(CALM, lambda: setattr(preemption, "share", 0.0))
        at(CALM, self.processes["host-1"].resume)
        at(CALM + 0.5, lambda: self._as_operator(self._release(), "release"))
        at(CALM + 1.5, lambda: self._as_operator(self._build(), "build again"))
        at(PROBE, self._probe)
        world.run(LENGTH)
        self._check()

    # -- processes --------------------------------------------------------------------------------

    def start(self, name: str) -> None:
        main = {"lookup": be_lookup, "host": self._hosting, "operator": self._operator}[
            name.partition("-")[0]
        ]
        self.processes[name] = self.world.start(name, main)

    async def _hosting(self, process: SimulatedProcess) -> None:
        self.journal = SlowJournal(process, self._slow_disk, self.chance.random)
        home = Process(process.runner, journal=self.journal, core=self._core)
        self.host = host_in(process, home)
        await self.host.start()
        await asyncio.Event().wait()

    async def _operator(self, process: SimulatedProcess) -> None:
        await be_operator(process, self.realm_clients, watches=process.name == OPERATORS[0])

    def _core(self, state: RobotState) -> RobotCore:
        core = KeepingCore(state, self.world)
        self.cores.append(core)
        return core

    # -- operators --------------------------------------------------------------------------------

    async def _build(self) -> None:
        """Create and bind what is missing."""
        realm_client = self.realm_clients["operator-1"]
        host = HostClient(realm_client._transport, await realm_client.directory.resolve("host-1", "host"))
        there = {address.name for address in realm_client.directory.present("robot")}
        for name, kind in ROBOTS.items():
            if name not in there:
                await host.create(Bundle(SOURCES[kind], "/wheels.py", kind), name)
        for parent, slot, child in BONDS:
            with contextlib.suppress(VrError):
                await realm_client.enslave(parent, slot, child)

    async def _release(self, name: str | None = None, operator: str = "operator-1") -> None:
        self._held.clear()
        self._resumes += 1
        self._resuming += 1  # for good, if the operator is killed meanwhile
        await self.realm_clients[operator].resume(name)
        self._resuming -= 1

    def _call(self) -> None:
        name = self.chance.choice(["axle", "axle", "axle", "cart", "spare"])
        command = self.chance.choice(COMMANDS[name])
        operator, seconds = self.chance.choice(OPERATORS), self.chance.choice([0.01, 0.1, 0.3])
        self._begin(name, command, seconds, operator)
        if self.chance.random() < 0.3:
            later = self.chance.choice([0.0, 0.01, 0.1, 0.5])
            self._after(later, lambda: self._cancel(name))

    def _begin(self, name: str, command: str, seconds: float, operator: str) -> None:
        self.calls += 1
        ticket = float(self.calls)
        self._as_operator(self._follow(name, command, ticket, seconds, operator), f"call {ticket}", operator)

    async def _follow(self, name: str, command: str, ticket: float, seconds: float, operator: str) -> None:
        label, realm_client = f"{name}.{command} {ticket}", self.realm_clients[operator]
        self.open[label] = self.world.runner.now() + ENDS
        self.processes[operator].on_exit.append(lambda: self.open.pop(label, None))
        known = True
        try:
            result = await realm_client.call(
                name, command, {"ticket": ticket, "seconds": seconds}, deadline=DEADLINE
            )
        except VrError as error:
            self.world.note(operator, label, f"{type(error).__name__}: {error}")
            known = not isinstance(error, CommandFailed)  # a host that hangs may go on with it
        else:
            self.done += 1
            if abs(result - ticket) > 0.001:
                self.complain(f"{label} returns {result}")
            self.whole = self.whole or self.world.runner.now() > PROBE
        if known:
            self._over[ticket] = self.world.runner.now()
        if self.open.pop(label, None) is None:
            self.complain(f"{label} ends twice")

    # -- what else they do ------------------------------------------------------------------------

    def _deeds(self) -> list[Callable[[], None]]:
        return [
            *[self._stop_and_resume] * 2,
            self._two_stop,
            self._reload,
            self._reload,
            self._delete,
            self._rebind,
            self._kill_operator,
            self._pause_host,
            partial(self._cancel, "axle"),
        ]

    def _cancel(self, name: str) -> None:
        operator = self.chance.choice(OPERATORS)
        if realm_client := self.realm_clients.get(operator):
            self._as_operator(realm_client.cancel(name), f"cancel {name}", operator)

    def _stop_and_resume(self) -> None:
        self._deed("stop")
        name = self.chance.choice([None, None, "axle", "spare"])
        self._as_operator(self._stop(name, "operator-1"), "stop")
        self._after(self.chance.choice([0.05, 0.5]), lambda: self._resume(name, "operator-2"))

    def _two_stop(self) -> None:
        self._deed("two stop")
        for operator in OPERATORS:
            self._as_operator(self._stop(None, operator), "stop", operator)
        self._after(0.3, lambda: self._resume(None, "operator-1"))

    async def _stop(self, name: str | None, operator: str) -> None:
        before = self._resumes
        stopped = await self.realm_clients[operator].stop(name)
        if self._resumes == before and not self._resuming:  # else one may have been released meanwhile
            self._held.update(dict.fromkeys(stopped, self.world.runner.now()))

    def _resume(self, name: str | None, operator: str) -> None:
        self._as_operator(self._release(name, operator), "resume", operator)

    def _reload(self) -> None:
        name = self.chance.choice(["left", "axle", "axle", "cart", "spare"])
        now = self.chance.random() < 0.3
        self._deed(f"reload {name}")

        async def reload() -> None:
            realm_client = self.realm_clients["operator-2"]
            host = HostClient(realm_client._transport, await realm_client.directory.resolve("host-1", "host"))
            kind = ROBOTS[name]
            page = Bundle(f"{SOURCES[kind]}\n# page {self.deeds}\n", "/wheels.py", kind)
            await host.reload(page, name, now=now, within=1.0)

        self._as_operator(reload(), "reload", "operator-2")

    def _delete(self) -> None:
        name = self.chance.choice(["right", "axle", "spare"])
        self._deed(f"delete {name}")

        async def delete() -> None:
            realm_client = self.realm_clients["operator-1"]
            for parent, slot, child in BONDS:
                if child == name:
                    with contextlib.suppress(VrError):
                        await realm_client.release(parent, slot)
            await realm_client.delete(name)
            self._held.pop(name, None)
            await self._build()

        self._as_operator(delete(), "delete")

    def _rebind(self) -> None:
        self._deed("rebind")

        async def rebind() -> None:
            realm_client = self.realm_clients["operator-1"]
            await realm_client.release("axle", "left")
            await realm_client.enslave("axle", "left", "left")

        self._as_operator(rebind(), "rebind")

    def _kill_operator(self) -> None:
        self._end_operator(self._revive_operator)

    def _revive_operator(self) -> None:
        if not self.processes["operator-2"].alive:
            self.start("operator-2")

    def _pause_host(self) -> None:
        self._deed("pause host")
        host = self.processes["host-1"]
        host.pause()
        self._after(self.chance.choice([0.1, 1.0, 3.0]), host.resume)

    # -- the laws ---------------------------------------------------------------------------------

    def note(self, robot: str, what: str, ticket: float) -> None:
        """A command of a page begins or ends: one at a time, none twice, none after its caller's end."""
        now = self.world.runner.now()
        self.world.note(robot, what, ticket)
        if what == "ends":
            if self._running.get(robot) == ticket:
                del self._running[robot]
            return
        before = self._running.get(robot)
        if before is not None:
            self.complain(f"{robot} begins {ticket} while it carries out {before}")
        if (robot, ticket) in self._begun:
            self.complain(f"{robot} carries out {ticket} twice")
        self._running[robot] = ticket
        self._begun.add((robot, ticket))
        if robot in self._held and now > self._held[robot]:
            self.complain(f"{robot} begins {ticket} after its stop was confirmed")
        call, digit = float(int(ticket)), round(ticket * 10) % 10
        if digit not in DETACHED and now > self._over.get(call, inf) + AFTERWARDS:
            self.complain(f"{robot} begins {ticket} after its call has ended")

    def _probe(self) -> None:
        self._begin("cart", "drive", 0.1, "operator-1")

    def _check(self) -> None:
        for wrong in self._undone(self.open, self.host.agents):
            self.complain(wrong)
        self.broken += [f"complaint: {complaint}" for complaint in self.world.complaints]
        self.broken += [f"logged: {one}" for one in self.world.logged if "abandoned" not in one]
        if not self.whole:
            self.complain("the realm is not whole again")
        self.broken += network_is_whole(self.processes.values())  # type: ignore[arg-type] # of a machine
        for core in self.cores:
            self._check_journal(core)

    def _check_journal(self, core: KeepingCore) -> None:
        """What is written is what has happened, in its order."""
        key = core.state.address.key
        written = [event for robot, event in self.journal.events if robot == key]
        if len(written) != len(core.handled) or any(
            a is not b for a, b in zip(written, core.handled, strict=True)
        ):
            self.complain(f"the journal of {core.state.address.name} has another order than what happened")


def play(seed: int, among: tuple[ModuleType, ...] = ()) -> tuple[str, HostStory]:
    """Play one seed to its end: see `play_on_machine`."""
    try:
        return play_on_machine(HostStory, seed, among)
    finally:
        HostStory.playing = None
