"""One rehearsal: the World with the page, the robots below it and an operator, and what a test does to it.

Every robot lives in a simulated process of its own, so that it can be killed and frozen alone; the messages
between them take a millisecond of virtual time. A call runs the World until it has ended, and no further.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import re
import traceback
from collections import Counter
from collections.abc import Awaitable, Callable, Coroutine, Generator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import msgspec

from robotree.testing import watch
from robotree.testing.home import Home, TeamSpace
from robotree.testing.journal import Commanded, Journal, Step
from robotree.testing.parts import Fault, Page, PageSource, Part, Parts
from robotree.testing.watch import Endless, watched
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.author.fields import settings_spec
from robotree.vr.author.readings import Record
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import VirtualRobot, slots_of
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import AnyRequest
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.loader import built
from robotree.vr.core.machine import ATTENTION
from robotree.vr.exchange.asking import ask, fresh_key
from robotree.vr.exchange.attendance import RATE
from robotree.vr.exchange.client import RobotClient
from robotree.vr.running.process import Journal as EventJournal
from robotree.vr.running.process import Process
from robotree.vr.world.world import SimulatedProcess, World

USUAL_DEADLINE = 60.0
"""[s] of virtual time that a call has, unless the test says otherwise."""
ASSEMBLY = 60.0
"""[s] of virtual time for all robots to begin to live."""
PERIOD = 0.01
"""[s] between two looks at whether something has happened."""
OPERATOR = "operator"

_open: list[Team] = []
"""The rehearsals that have not ended, in the order in which they began."""


def unended() -> list[Team]:
    """Return the rehearsals that have not ended, the latest first."""
    return _open[::-1]


class Going:
    """A command of the page under way, made by `Team.start`."""

    def __init__(self, team: Team, command: str, key: str) -> None:
        """Nothing is known of it yet."""
        self.command, self.key = command, key
        self.progress: list[tuple[float, str]] = []
        """Its reports of progress: how far, 0 to 1, and a text."""
        self._team = team
        self._outcome: tuple[Any, BaseException | None] | None = None

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        return self._outcome is not None

    def settle(self, value: Any, error: BaseException | None) -> None:
        """Take how it ended."""
        self._outcome = value, error

    def result(self) -> Any:
        """Let time pass until it has ended; return its result, one of several parts as a `Record`.

        Raises:
            VrError: it did not succeed. If the page itself raised something else, that is its cause.
        """
        self._team.wait_until(lambda: self.done)
        assert self._outcome is not None  # noqa: S101 # just waited for
        value, error = self._outcome
        if error is not None:
            raise self._team.explained(error)
        return Record(cast("dict[str, Any]", value)) if isinstance(value, dict) else value


class Team:
    """A page and the robots below it, in virtual time; made by `rehearse`."""

    def __init__(
        self, page: PageSource, children: Mapping[str, Parts], *, seed: int, settings: Mapping[str, Any]
    ) -> None:
        """Let them live; see `rehearse`.

        Raises:
            RuntimeError: it is called where an event loop runs.
        """
        if asyncio.events._get_running_loop() is not None:  # noqa: SLF001 # asks without an error
            raise RuntimeError("a rehearsal has event loops of its own: make the test a plain function")
        self.world = World(seed)
        self.mistake: Exception | None = None
        """The error that a function of the test itself has raised."""
        self.struck: list[tuple[float, str]] = []
        """The faults that have happened: when [s], and in words."""
        self._parts: dict[str, Part] = {}
        self._paths: dict[str, str] = {}
        """Slot of each robot, by its name."""
        self._agents: dict[str, RobotAgent] = {}
        self._processes: dict[str, SimulatedProcess] = {}
        self._homes: dict[str, Home] = {}
        """Where the pages live."""
        self._bonds: list[tuple[str, str, str]] = []
        """The bonds to make: parent, slot, child."""
        self._counts: Counter[tuple[str, str]] = Counter()
        self._faults: list[Fault] = []
        """Of the team as a whole: at the how-manieth command of any child."""
        self._raised: dict[str, BaseException] = {}
        """The latest error of each robot's code, by its name."""
        self._calls: list[Going] = []
        self._space: TeamSpace | None = None
        self._key: object | None = None
        """What the operator holds down; each time is another one."""
        self.journal = Journal(self._paths, self.world.runner.now)
        self.journal.on_step = self._on_step
        self.world.__enter__()
        _open.append(self)
        try:
            self._operator = self.start_process(OPERATOR, _wait_for_ever)
            self.start_page("", "", page, settings, children)
            self._assemble()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the rehearsal; what was commanded stays to be looked at. Twice is once."""
        if self in _open:
            _open.remove(self)
            self.world.__exit__(None, None, None)

    # -- what happened ----------------------------------------------------------------------------

    @property
    def steps(self) -> Sequence[Step]:
        """All calls of all robots, also of the page itself and those that only read, with their times."""
        return self.journal.steps

    @property
    def commanded(self) -> Commanded:
        """The commands of the robots below the page, in this order; those that only read are left out."""
        return Commanded(step.entry for step in self.steps if step.robot and not step.reads)

    @property
    def progress(self) -> list[tuple[float, str]]:
        """The progress reports of the latest call of the page."""
        return self._calls[-1].progress if self._calls else []

    @property
    def now(self) -> float:
        """[s] of virtual time since the rehearsal began."""
        return self.world.runner.now()

    def __getitem__(self, path: str) -> Any:
        """Return what is in a slot: `team["arm"]`, `team["mover.arm"]`."""
        return self._parts[path]

    def describe(self, path: str = "") -> RobotDescription:
        """Return what a robot says of itself now; empty: the page."""
        return self._agents[path].description()

    def story(self) -> str:
        """Tell what has happened, a line for each call and each fault, in their order."""
        told = [(step.at, str(step)) for step in self.steps] + self.struck
        return "\n".join(line for _, line in sorted(told, key=lambda each: each[0]))

    @property
    def space(self) -> TeamSpace:
        """The space that the page finds as `self.space`; it begins to live when it is first used here."""
        if self._space is None:
            self._space = space = TeamSpace(self._ask)
            self.start_process("space", space.live)
            self.wait_until(lambda: space.key != "", within=ASSEMBLY)
        return self._space

    def _ask(self, key: str, request: AnyRequest, answer: type[Any]) -> Any:
        return self._do(lambda: ask(self._operator.transport, key, request, answer, timeout=USUAL_DEADLINE))

    # -- what a test does -------------------------------------------------------------------------

    def call(self, command: str, /, *, within: float = USUAL_DEADLINE, **arguments: Any) -> Any:
        """Call a command of the page as an operator does, and return its result.

        Args:
            command: its name.
            within: [s] of virtual time that it has.
            **arguments: numbers in declared units, or text with units: `x="30 cm"`.

        Raises:
            VrError: it was refused or did not succeed, as the operator sees it. If the page itself raised
                something else, that is its cause.
        """
        return self.start(command, within=within, **arguments).result()

    def call_robot(
        self, path: str, command: str, /, *, within: float = USUAL_DEADLINE, **arguments: Any
    ) -> Any:
        """Call a command of a robot below the page, past the page; else as `call`."""
        return self._start(path, command, within, arguments).result()

    def start(self, command: str, /, *, within: float = USUAL_DEADLINE, **arguments: Any) -> Going:
        """Call a command and do not wait for its end; else as `call`. Time passes by `wait` or `result`."""
        return self._start("", command, within, arguments)

    def _start(self, path: str, command: str, within: float, arguments: Mapping[str, Any]) -> Going:
        going = Going(self, command, fresh_key())
        self._calls.append(going)
        client, key = self._client(path), self._key
        attended = ATTENTION if key is not None else 0.0

        async def press() -> None:
            while not going.done and key is self._key:
                client.press(going.key)
                await asyncio.sleep(1 / RATE)

        async def call() -> None:
            try:
                value = await client.call(
                    command,
                    arguments,
                    deadline=within,
                    caller=OPERATOR,
                    key=going.key,
                    on_progress=lambda share, text: going.progress.append((share, text)),
                    attended=attended,
                )
            except Exception as error:  # noqa: BLE001 # raised again where it is waited for
                going.settle(None, error)
            else:
                going.settle(value, None)

        self._on_operator(call)
        if key is not None:
            self._on_operator(press)
        return going

    @contextlib.contextmanager
    def holding(self) -> Generator[None]:
        """Have the operator hold a key for the time of a block, for commands with `attended=True`.

        Those that are called within it go on while it lasts, and 2 s longer.
        """
        self._key = object()
        try:
            yield
        finally:
            self._key = None

    def wait(self, seconds: float) -> None:
        """Let virtual time pass [s]."""
        with watched(self.world.runner):
            self.world.run(self.now + seconds)
        self._raise_mistake()

    def wait_until(self, happened: Callable[[], bool], within: float = math.inf) -> None:
        """Let virtual time pass until something is so.

        Args:
            happened: looked at every 10 ms of virtual time.
            within: [s]

        Raises:
            TimeoutError: it did not happen.
        """
        end = self.now + within
        with watched(self.world.runner):
            while not happened():
                if self.now >= end:
                    raise TimeoutError(f"it did not happen within {within:g} s of virtual time")
                self.world.run(self.now + PERIOD)
                self._raise_mistake()

    def cancel(self, *, at: int | None = None, after: float | None = None) -> None:
        """Cancel what the page is doing.

        Args:
            at: when the how-manieth command of any child begins, from 1; None: no matter.
            after: [s] from now, or from that moment. Neither of both: now, and wait until it is confirmed.
        """
        self._act(Fault(what="cancel", at=at, after=after or 0.0), at, after)

    def stop(
        self, why: str = "the test stops it", *, at: int | None = None, after: float | None = None
    ) -> None:
        """Stop the page and all robots below it by a protective stop; else as `cancel`."""
        self._act(Fault(what="stop", at=at, after=after or 0.0, why=why), at, after)

    def resume(self) -> None:
        """Release the protective stop, and wait until that is confirmed."""
        self._do(lambda: self._client().resume())

    def lose(self, path: str, *, after: float | None = None) -> None:
        """Kill the process of a robot, now or in some time [s]."""
        self._at(after or 0.0, self._processes[path].kill)
        if after is None:
            self.wait(PERIOD)

    def crash(
        self, path: str = "", *, at: int | None = None, after: float | None = None, away: float = 1.0
    ) -> None:
        """Kill the process of the page, as `kill -9` does to its host, and start it again.

        Args:
            path: slot of another page, for `Page(…)`.
            at: when the how-manieth command of any child begins, from 1; None: no matter.
            after: [s] from now, or from that moment. Neither of both: now, and wait until the page is back.
            away: [s] until it is started again.

        Raises:
            KeyError: there is no page at this path.
        """
        home = self._homes[path]
        fault = Fault(what="crash", at=at, after=after or 0.0, by=away, path=path)
        if at is not None:
            self._faults.append(fault)
        else:
            self._at(fault.after, partial(self._crash, home, fault))
        if at is None and after is None:
            self.wait(PERIOD)
            self.wait_until(lambda: path in self._agents, within=away + ASSEMBLY)

    def _crash(self, home: Home, fault: Fault) -> None:
        page = fault.path or "the page"
        self._note(f"{page} is killed")
        self._agents.pop(fault.path, None)
        self._processes[fault.path].kill()

        def start() -> None:
            self._note(f"{page} is started again")
            self.start_process(fault.path, home.live)

        self._at(fault.by, start)

    def fill(self, slot: str, part: Part) -> None:
        """Put another robot into an empty slot of the page."""
        self._enter(slot, "", slot, part)
        self._assemble()

    def release(self, slot: str) -> None:
        """Take the robot out of a slot of the page."""
        self._do(lambda: self._client().free(slot))

    # -- for parts --------------------------------------------------------------------------------

    @property
    def page(self) -> VirtualRobot:
        """The robot of the page; another one after a crash."""
        return cast("VirtualRobot", self._agents[""].robot)

    def start_robot(self, path: str, robot: Robot) -> None:
        """Let a robot live in a process of its own."""

        async def live(process: SimulatedProcess) -> None:
            agent = RobotAgent(robot, process.transport, process=self.threads(process))
            await agent.start()
            self.lives(path, agent)
            await asyncio.Event().wait()

        self.start_process(path, live)

    def threads(self, process: SimulatedProcess, journal: EventJournal | None = None) -> Process:
        """Return what carries the commands of a simulated process out, and writes them down.

        Args:
            process: the process.
            journal: where; None: in that of the rehearsal.
        """
        threads = Process(process.runner, self.journal if journal is None else journal)
        threads.on_raise = self._hear_error
        return threads

    def _hear_error(self, robot: str, error: BaseException) -> None:
        self._raised[robot] = error
        if isinstance(error, Endless):
            where = "".join(traceback.format_tb(error.__traceback__)[-1:]).strip()
            self.mistake = RuntimeError(
                f"{robot} computes without waiting for {watch.LIMIT:g} s; have it sleep, or call "
                f"self.check() and do not catch all errors: {where}"
            )

    def start_process(
        self, path: str, live: Callable[[SimulatedProcess], Coroutine[Any, Any, None]]
    ) -> SimulatedProcess:
        """Let something live in a process of its own; it calls `lives` when its robot can be called."""
        process = self._processes[path] = self.world.start(path or "page", live)
        return process

    def lives(self, path: str, agent: RobotAgent) -> None:
        """Take note that a robot can be called."""
        self._agents[path] = agent
        part = self._parts.get(path)
        if isinstance(part, Page):
            part.robot = cast("VirtualRobot", agent.robot)

    def start_page(
        self,
        path: str,
        name: str,
        page: PageSource,
        settings: Mapping[str, Any],
        children: Mapping[str, Parts],
    ) -> None:
        """Make a robot of a page, let it live, and those that are meant for its slots.

        Raises:
            TypeError: it has no such slot or setting.
            BundleError: its file cannot be used.
        """
        cls = _class_of(page)
        slots = slots_of(cls)
        for slot in children.keys() - slots.keys():
            known = ", ".join(slots) or "none"
            raise TypeError(f"{cls.__name__} has no child slot {slot!r}; it has: {known}")
        name = name or self._new_name(_snake(cls.__name__))
        self._paths[name] = path
        home = self._homes[path] = Home(self, path, partial(_made, cls, name, settings))
        self.start_process(path, home.live)
        for slot, parts in children.items():
            below = f"{path}.{slot}" if path else slot
            if isinstance(parts, list | tuple):
                for number, part in enumerate(parts):
                    self._enter(f"{below}[{number}]", path, f"{slot}[{number}]", part)
            else:
                self._enter(below, path, slot, parts)

    def _enter(self, path: str, parent: str, slot: str, part: object) -> None:
        if not isinstance(part, Part):
            raise TypeError(f"{path}: {part!r} cannot be in a slot; give Fake(KIND), cell() or Page(CLASS)")
        name = self._new_name(re.sub(r"\W+", "-", path).strip("-"))
        self._paths[name] = path
        self._parts[path] = part
        self._agents.pop(path, None)  # of one that was lost
        part.enter(self, path, name)
        self._bonds.append((parent, slot, path))

    # -- inside -----------------------------------------------------------------------------------

    def _new_name(self, wanted: str) -> str:
        name, number = wanted, 1
        while name in self._paths:
            number += 1
            name = f"{wanted}-{number}"
        return name

    def _assemble(self) -> None:
        """Wait until all live, and bind them, from the bottom up.

        Raises:
            VrError: one refuses.
        """
        expected = {*self._parts, ""}
        self.wait_until(lambda: expected <= self._agents.keys(), within=ASSEMBLY)
        bonds, self._bonds = self._bonds, []
        for parent, slot, child in sorted(bonds, key=lambda bond: bond[2].count("."), reverse=True):
            self._do(partial(self._client(parent).enslave, slot, self._agents[child].address))

    def _client(self, path: str = "") -> RobotClient:
        return RobotClient(self._operator.transport, self._agents[path].address)

    def _on_operator(self, work: Callable[[], Awaitable[None]]) -> None:
        loop = self._operator.loop
        loop.call_soon_threadsafe(lambda: asyncio.ensure_future(work(), loop=loop))

    def _do(self, work: Callable[[], Awaitable[Any]]) -> Any:
        """Have the operator do something, and wait for its end."""
        ended: list[tuple[Any, BaseException | None]] = []

        async def do() -> None:
            try:
                ended.append((await work(), None))
            except Exception as error:  # noqa: BLE001 # raised again below
                ended.append((None, error))

        self._on_operator(do)
        self.wait_until(lambda: bool(ended))
        value, error = ended[0]
        if error is not None:
            raise error
        return value

    def _note(self, what: str) -> None:
        self.struck.append((self.now, f"{self.now:8.3f} s  * {what}"))

    def _at(self, seconds: float, action: Callable[[], None]) -> None:
        self.world.runner.at(self.now + seconds, action)

    def _raise_mistake(self) -> None:
        mistake, self.mistake = self.mistake, None
        if mistake is not None:
            raise mistake

    def raised_in(self, error: BaseException) -> BaseException | None:
        """Return what the code of the robot that an error names has raised, with its traceback, or None."""
        robot = error.data.get("robot", "") if isinstance(error, VrError) else ""
        return self._raised.get(str(robot))

    def explained(self, error: BaseException) -> BaseException:
        """Give an error the cause that it had in the page, with its traceback."""
        raised = self.raised_in(error)
        cause = raised.__cause__ if isinstance(raised, VrError) else raised
        if error.__cause__ is None and cause is not error:
            error.__cause__ = cause
        return error

    # -- faults -----------------------------------------------------------------------------------

    def plan(self, fault: Fault) -> None:
        """Have something go wrong at the how-manieth command of any child."""
        self._faults.append(fault)

    def agents(self) -> Sequence[tuple[str, RobotAgent]]:
        """Return the agents of the robots whose processes live, with their slots."""
        return [(path, agent) for path, agent in self._agents.items() if self._processes[path].alive]

    def stands_still(self, path: str) -> bool:
        """Whether the process of a robot is frozen now."""
        return self._processes[path].runner.halted

    def _act(self, fault: Fault, at: int | None, after: float | None) -> None:
        if at is not None:
            self._faults.append(fault)
        elif after is not None:
            self._at(after, lambda: self._strike_page(fault))
        else:
            self._do(lambda: self._order(fault))

    def _order(self, fault: Fault) -> Awaitable[Any]:
        client = self._client()
        return client.cancel() if fault.what == "cancel" else client.safe_stop(fault.why)

    def _strike_page(self, fault: Fault) -> None:
        async def order() -> None:
            try:
                await self._order(fault)
            except VrError as error:
                self._note(f"{fault.what} is refused: {error}")

        self._on_operator(order)

    def _on_step(self, step: Step) -> None:
        """See which faults are due; called while a robot accepts a call, so nothing may wait here."""
        part = self._parts.get(step.robot)
        if part is None:
            return
        counts = self._counts
        counts[step.robot, step.command] += 1
        if not step.reads:
            counts[step.robot, ""] += 1
            counts["", ""] += 1
        for fault in part.faults:
            if _is_due(fault, step, counts[step.robot, fault.command]):
                self._strike(step, part, fault)
        for fault in self._faults:
            if _is_due(fault, step, counts["", ""]):
                self._strike(step, part, fault)

    def _strike(self, step: Step, part: Part, fault: Fault) -> None:
        if fault.what != "crash":  # it says so itself, when it happens
            self._note(f"{step.robot}: {fault}")
        process = self._processes[step.robot]
        match fault.what:
            case "lose":
                self._at(fault.after, process.kill)
            case "freeze":
                self._at(fault.after, process.pause)
                self._at(fault.after + fault.by, process.resume)
            case "crash":
                self._at(fault.after, partial(self._crash, self._homes[fault.path], fault))
            case "stop" | "cancel":
                self._at(fault.after, lambda: self._strike_page(fault))
            case "refuse" | "delay":
                part.struck(step, fault)  # the same moment: its code looks at it when it begins


def _is_due(fault: Fault, step: Step, count: int) -> bool:
    meant = step.command == fault.command if fault.command else not step.reads
    return meant and fault.at in {None, count}


def _class_of(page: object) -> type[VirtualRobot]:
    if isinstance(page, type) and issubclass(page, VirtualRobot):
        return page
    if isinstance(page, str | Path):
        path, colon, wanted = str(page).rpartition(":")
        return Bundle.read(Path(path), wanted).load() if colon else Bundle.read(page).load()
    raise TypeError(f"{page!r} is no page: give a class that derives from VirtualRobot, or a file's path")


def _made(cls: type[VirtualRobot], name: str, settings: Mapping[str, Any]) -> VirtualRobot:
    spec = msgspec.structs.replace(settings_spec(cls), name="create")
    return built(cls, name, check_arguments(spec, settings, robot=name))


def _snake(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


async def _wait_for_ever(_: SimulatedProcess) -> None:
    await asyncio.Event().wait()
