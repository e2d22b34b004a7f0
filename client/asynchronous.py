"""A realm and its robots for programs with asyncio.

    async with connect_async() as realm:
        arm = realm["arm-1"]
        await arm.go_to(x="30 cm", y=0, z=0.4, twist=0, within="20 s")
        move = await arm.go_to.start(x=0.3, y=0.1, z=0.4, twist=0)
        print(move.progress)
        await move.cancel()
        async for reading in arm.readings(hz=20):
            print(reading.z)

A robot looks as a child does in a page: its attributes are its commands, units are given as text or are those
that the command declares, and errors have the same classes (`robotree.vr`). All else is asked of the realm.
A command ends with the block that has started it, or with the program, however that ends; `tell` is for
commands that go on.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import AsyncGenerator, Callable, Coroutine, Generator, Sequence
from typing import TYPE_CHECKING, Any

from robotree.client.joining import joined
from robotree.vr.author.child import readable
from robotree.vr.author.fitting import misfit
from robotree.vr.author.kind import Kind, promises_of
from robotree.vr.author.readings import Record
from robotree.vr.base.address import parted
from robotree.vr.base.arguments import named_arguments
from robotree.vr.base.errors import (
    BadArgument,
    CommandCancelled,
    EmptyRealm,
    NotAttended,
    NotThisKind,
    VrError,
)
from robotree.vr.base.extras import explained
from robotree.vr.base.units import seconds
from robotree.vr.exchange.calling import OnProgress
from robotree.vr.exchange.client import DEFAULT_DEADLINE
from robotree.vr.network.realms import all_realms, robots_in
from robotree.vr.network.rendezvous import realm_name

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from robotree.vr.base.description import CommandSpec, Listing, RobotDescription
    from robotree.vr.base.requests import LoggedLine, Reloaded, State
    from robotree.vr.exchange.attendance import Attendance
    from robotree.vr.supervision.realm_client import RealmClient


from collections.abc import Iterator, Mapping
from typing import TypeVar

from robotree.vr.base.description import Listing, RobotDescription, SlotSpec

WITHIN = "within"
"""The argument of a call that limits its time, as in a page."""

SHOWN = 5
"""Robots of another realm that are named."""

LOOKS = 0.1
"""[s] between two looks whether a key is held."""

SILENCE = 3.0
"""[s] without a published state, after which a robot is asked whether it lives; it publishes each second."""


@contextlib.asynccontextmanager
async def connect_async(realm: str | None = None) -> AsyncGenerator[AsyncRealm]:
    """Join a realm for the time of a block.

    Args:
        realm: its name; None: that of `$ROBOTREE_REALM`, else `default`.

    Raises:
        BadName: it cannot be a name.
        TransportError: the realm cannot be joined.
    """
    async with joined(realm_name(realm)) as realm_client:
        entered = AsyncRealm(realm_client)
        try:
            yield entered
        finally:
            await entered.end_calls()


class AsyncRealm:
    """A realm: its robots by name, and what a supervisor does with them. All methods raise only `VrError`."""

    def __init__(self, realm_client: RealmClient) -> None:
        """Made by `connect_async`."""
        self.realm_client = realm_client
        self._calls: set[AsyncCall] = set()

    @property
    def name(self) -> str:
        """The realm's name."""
        return self.realm_client.realm

    def __getitem__(self, robot: str) -> AsyncRobot:
        """Return the robot of a name, or of `SITE:NAME`, whether it runs at the moment or not.

        Raises:
            BadName: it cannot be a name.
        """
        parted(robot)
        return AsyncRobot(self, robot)

    async def get(self, robot: str, kind: type[Kind] | None = None) -> AsyncRobot:
        """Return a robot that runs and is of a kind.

        Args:
            robot: its name.
            kind: from `robotree.kinds`, or written by `robotree stubs`; None: any.

        Raises:
            NoSuchRobot: no running robot has the name.
            NotThisKind: it is of another kind, or lacks a command of this one.
        """
        described = await self.describe(robot)
        if kind is not None:
            wanted, kinds = kind.__name__, (described.kind, *described.kinds)
            reason = "" if wanted in kinds else f"it is of kind {described.kind}"
            if reason := reason or misfit(described, promises_of(kind), ()):
                raise NotThisKind(robot=robot, kind=wanted, reason=reason)
        return self[robot]

    # -- who is there -----------------------------------------------------------------------------

    async def ls(self) -> Robots[Listing]:
        """Return the free robots and the top ones, as the lookup services list them.

        Raises:
            EmptyRealm: nobody is in the realm; it names those of this user that have robots.
        """
        self._check_inhabited()
        return Robots(self.realm_client.robots())

    async def tree(self) -> Robots[RobotDescription]:
        """Describe all robots: those that nobody commands by name, then their children, and so on down.

        Raises:
            EmptyRealm: as `ls`.
        """
        self._check_inhabited()
        return Robots(await self.realm_client.tree())

    def _check_inhabited(self) -> None:
        if not self.realm_client.inhabited():
            robots: dict[str, list[str]] = {}  # realms of one name in two runtime directories are told as one
            for folder in all_realms():
                if names := robots_in(folder):
                    robots.setdefault(folder.name, []).extend(names)
            others = ", ".join(f"{realm} ({', '.join(names[:SHOWN])})" for realm, names in robots.items())
            hint = f", but there is {others}" if others else "; start something first"
            raise EmptyRealm(realm=self.name, hint=hint)

    async def describe(self, robot: str) -> RobotDescription:
        """Return what a robot is: commands, slots, readings, and its state now."""
        return await self.realm_client.describe(robot)

    async def log(self, robot: str) -> Sequence[LoggedLine]:
        """Return the log of a robot, the oldest line first."""
        return await self.realm_client.read_log(robot)

    async def watch(self) -> AsyncGenerator[tuple[str, State]]:
        """Yield the name and the new state of a robot, whenever one publishes its state."""
        queue: asyncio.Queue[tuple[str, State]] = asyncio.Queue()
        watching = await self.realm_client.watch_state(
            None, lambda name, state: queue.put_nowait((name, state))
        )
        try:
            while True:
                yield await queue.get()
        finally:
            await watching.close()

    async def look(
        self, view: str, camera: str = "", *, width: int = 320, height: int = 180
    ) -> NDArray[np.uint8]:
        """Return one picture of a view: rows, columns, and red, green, blue from 0 to 255."""
        from io import BytesIO

        try:
            import numpy as np
            from PIL import Image
        except ImportError as error:
            raise explained(error) from None

        picture = await self.realm_client.look(view, camera=camera, width=width, height=height)
        return np.asarray(Image.open(BytesIO(picture.jpeg)).convert("RGB"))

    # -- robots on top of robots ------------------------------------------------------------------

    async def create(
        self, page: str, robot: str, *, host: str = "", wanted: str = "", **settings: Any
    ) -> AsyncRobot:
        """Make a virtual robot from a page.

        Args:
            page: its file, on this machine.
            robot: its name.
            host: on which it shall live; empty: the first that takes it.
            wanted: name of the class; empty: the only one in the file.
            **settings: those that are not the defaults: in the declared units, or as text with units.
        """
        await self.realm_client.create(str(page), robot, host, wanted, settings)
        return self[robot]

    async def reload(self, robot: str, page: str = "", *, now: bool = False) -> Reloaded:
        """Have a virtual robot go on with its page as it is in the file now, or with another page."""
        return await self.realm_client.reload(robot, str(page), now=now)

    async def migrate(self, robot: str, host: str) -> str:
        """Have a virtual robot go on in another host; returns a sentence for people."""
        return await self.realm_client.migrate(robot, host)

    async def enslave(self, slot: str, child: str) -> None:
        """Bind a child to a slot, `mover.arm`."""
        parent, _, name = slot.partition(".")
        await self.realm_client.enslave(parent, name, child)

    async def release(self, slot: str) -> None:
        """Release the child in a slot, `mover.arm`, or all of a group, `team.rovers`."""
        parent, _, name = slot.partition(".")
        await self.realm_client.release(parent, name)

    async def delete(self, robot: str) -> str:
        """End a virtual robot. Returns what is left of it, as a sentence; empty: nothing."""
        return await self.realm_client.delete(robot)

    # -- what they do -----------------------------------------------------------------------------

    async def cancel(self, robot: str) -> None:
        """End all commands of a robot."""
        await self.realm_client.cancel(robot)

    async def pause(self, robot: str) -> str:
        """Have a virtual robot, and those below it, wait before each step. Returns a note for people."""
        return await self.realm_client.pause(robot)

    async def step(self, robot: str) -> str:
        """Let one step of a paused robot, or of one below it, pass. Returns the step in words.

        Raises:
            NotPaused: it is not paused.
            NothingHeld: nothing of it waits before a step.
        """
        return await self.realm_client.step(robot)

    async def go_on(self, robot: str) -> str:
        """End the pause of a robot and of those below it (`robotree continue`). Returns a note for people."""
        return await self.realm_client.go_on(robot)

    async def stop(self, robot: str | None = None) -> Sequence[str]:
        """Protective stop of one robot, or of all. Returns the names of those that have confirmed it.

        Raises:
            NotConfirmed: one has not confirmed it; it names all of these.
        """
        return await self.realm_client.stop(robot)

    async def resume(self, robot: str | None = None) -> Sequence[str]:
        """Release the protective stop of one robot, or of all. Returns those that were in one."""
        return await self.realm_client.resume(robot)

    # -- for robots -------------------------------------------------------------------------------

    def keep(self, call: AsyncCall) -> None:
        """Take note of a call that ends with the block at the latest."""
        self._calls.add(call)
        call.when_done(lambda: self._calls.discard(call))

    async def end_calls(self) -> None:
        """End the commands that still run."""
        await asyncio.gather(*(call.cancel() for call in tuple(self._calls)))


class AsyncRobot:
    """A robot of a realm; its attributes are its commands, and `readings`."""

    def __init__(self, realm: AsyncRealm, name: str) -> None:
        """Made by access to a realm."""
        self._realm, self._name = realm, name

    def __str__(self) -> str:
        return self._name

    def __repr__(self) -> str:
        return f"<robot {self._name} of realm {self._realm.name}>"

    @property
    def readings(self) -> AsyncReadings:
        """The robot's readings, as it publishes them."""
        return AsyncReadings(self._realm, self._name)

    def __getattr__(self, command: str) -> AsyncCommand:
        if command.startswith("_"):
            raise AttributeError(command)
        found = vars(self)[command] = AsyncCommand(self._realm, self._name, command)
        return found


class AsyncCommand:
    """One command of a robot."""

    def __init__(self, realm: AsyncRealm, robot: str, name: str) -> None:
        """Made by access to a robot's attribute."""
        self._realm, self.robot, self.name = realm, robot, name
        self._spec: CommandSpec | None = None
        """As the robot described it when it was asked last; it may have another page since."""

    async def __call__(self, *values: Any, **arguments: Any) -> Any:
        """Have the command carried out, and return its result; a result of several parts reads as `info.z`.

        `within=5` or `within="500 ms"` limits its time, unless the command has a parameter of this name; else
        the limit is 60 s. It ends if the task that waits is cancelled.

        Raises:
            CommandError: it was refused or did not succeed.
            LeaseError: the robot has a parent, which alone commands it.
            TransportError: the robot cannot be reached or does not answer.
        """
        return await (await self.start(*values, **arguments))

    async def start(self, *values: Any, **arguments: Any) -> AsyncCall:
        """Start the command and return at once; see `__call__`."""
        return await self._start(values, arguments)

    @contextlib.asynccontextmanager
    async def attended(
        self, held: Callable[[], bool], *values: Any, **arguments: Any
    ) -> AsyncGenerator[AsyncCall]:
        """Start a command that goes on only while somebody holds a key, and end it with the block.

        Args:
            held: whether the person holds a key, a pedal or a button; asked ten times a second. The robot
                ends the command 2 s after the last yes, also when this program hangs or is cut off.
            *values: of the command's parameters.
            **arguments: the same by name, and `within`.

        Raises:
            NotAttended: the command does not end without a key.
            VrError: it was refused.
            Exception: what `held` has raised; the command has ended then.
        """
        from robotree.vr.exchange.attendance import Attendance  # it brings the core, which few programs need

        self._spec = (await self._realm.describe(self.robot)).command(self.name)
        if self._spec is not None and not self._spec.attended:
            raise NotAttended(robot=self.robot, command=self.name)
        keys = Attendance()
        call = await self._start(values, arguments, keys)
        pressing = asyncio.ensure_future(_press(keys, held))
        try:
            yield call
        finally:
            failed = pressing.done()
            pressing.cancel()
            await call.cancel()
            if failed:
                pressing.result()

    async def _start(
        self, values: tuple[Any, ...], arguments: dict[str, Any], keys: Attendance | None = None
    ) -> AsyncCall:
        await self.learn(values, arguments)
        deadline, named = self.prepared(values, arguments)
        call = AsyncCall(self.robot, self.name)
        call.begin(self._carry_out(named, deadline, call.note_progress, keys))
        self._realm.keep(call)
        return call

    async def tell(self, *values: Any, **arguments: Any) -> None:
        """Send the command and wait only until the robot has accepted it; it may outlive the program."""
        await self.learn(values, arguments)
        deadline, named = self.prepared(values, arguments)
        await self._realm.realm_client.tell(self.robot, self.name, named, deadline=deadline)

    async def _carry_out(
        self, named: dict[str, Any], deadline: float, on_progress: OnProgress, keys: Attendance | None
    ) -> Any:
        realm_client = self._realm.realm_client
        try:
            return await realm_client.call(
                self.robot, self.name, named, deadline=deadline, on_progress=on_progress, attendance=keys
            )
        except BadArgument:
            self.forget()
            raise

    def knows(self, values: tuple[Any, ...], arguments: dict[str, Any]) -> bool:
        """Whether a call with these arguments can be prepared without asking the robot for its parameters."""
        return self._spec is not None or not (values or WITHIN in arguments)

    async def learn(self, values: tuple[Any, ...], arguments: dict[str, Any]) -> None:
        """Ask the robot for its parameters, if a call with these arguments needs their names.

        Raises:
            VrError: the robot cannot be asked.
        """
        if not self.knows(values, arguments):
            self._spec = (await self._realm.describe(self.robot)).command(self.name)

    def forget(self) -> None:
        """Ask again next time: perhaps it has other parameters by now."""
        self._spec = None

    def prepared(self, values: tuple[Any, ...], arguments: dict[str, Any]) -> tuple[float, dict[str, Any]]:
        """Return the time limit [s] of a call and its arguments by name.

        Raises:
            BadArgument: one cannot travel, or the limit is none.
        """
        label, spec = f"{self.robot}.{self.name}", self._spec
        names = [] if spec is None else [field.name for field in spec.parameters]
        named = named_arguments(label, values, arguments, lambda: names)
        return self._deadline(label, spec, named), named

    def _deadline(self, label: str, spec: CommandSpec | None, named: dict[str, Any]) -> float:
        """Take the time limit [s] out of the arguments, if it is none of the command."""
        if WITHIN not in named or (spec is not None and WITHIN in spec.by_name):
            return DEFAULT_DEADLINE
        try:
            return seconds(named.pop(WITHIN))
        except (TypeError, ValueError) as error:
            raise BadArgument(command=label, parameter=WITHIN, reason=str(error)) from None


async def _press(keys: Attendance, held: Callable[[], bool]) -> None:
    """Pass a key on as long as it is held."""
    while True:
        if held():
            keys.press()
        await asyncio.sleep(LOOKS)


class AsyncCall:
    """A command under way; waiting for it gives its result."""

    def __init__(self, robot: str, command: str) -> None:
        """Nothing is known of it yet."""
        self.robot, self.command = robot, command
        self.progress = math.nan
        """How far it is, 0 to 1; NaN before the first report."""
        self.note = ""
        """The latest text about its progress."""

    def begin(self, work: Coroutine[Any, Any, Any]) -> None:
        """Carry it out."""
        self._task: asyncio.Task[Any] = asyncio.ensure_future(work)

    def note_progress(self, fraction: float, text: str) -> None:
        """Take how far it is."""
        self.progress, self.note = fraction, text

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        return self._task.done()

    def __await__(self) -> Generator[Any, None, Any]:
        """Wait for its result; it is ended if the task that waits is cancelled.

        Raises:
            CommandCancelled: `cancel` has ended it.
            VrError: it was refused or did not succeed.
        """
        try:
            yield from self.ended().__await__()
        except asyncio.CancelledError:
            self._task.cancel()
            raise
        if self._task.cancelled():
            reason = "the program cancelled it"
            raise CommandCancelled(robot=self.robot, command=self.command, reason=reason)
        try:
            return readable(self._task.result())
        except VrError as error:
            raise error.with_traceback(None) from error.__cause__  # its lines are ours, not the program's

    async def ended(self) -> None:
        """Wait until it has ended, well or badly."""
        await asyncio.wait([self._task])

    async def cancel(self) -> None:
        """End it."""
        self._task.cancel()
        await self.ended()

    def when_done(self, callback: Callable[[], None]) -> None:
        """Call back once it has ended, on the event loop."""
        self._task.add_done_callback(lambda _: callback())


class AsyncReadings:
    """The readings of a robot. The names are those of `robotree show NAME`; numbers in SI units."""

    def __init__(self, realm: AsyncRealm, robot: str) -> None:
        """Made by access to a robot's attribute."""
        self._realm, self._robot = realm, robot

    async def now(self) -> Record:
        """Ask for the present values.

        Raises:
            VrError: the robot cannot be asked.
        """
        return Record((await self._realm.describe(self._robot)).readings)

    async def __call__(self, *, hz: float = 10.0) -> AsyncGenerator[Record]:
        """Yield each new reading; if several came since the last one, the latest. Ends only by an error.

        A robot publishes ten times a second while one of its commands runs, else at each change and once a
        second.

        Args:
            hz: [1/s] how many are yielded at most.

        Raises:
            ValueError: `hz` is not above 0.
            VrError: the robot has ended or hangs.
        """
        if not hz > 0.0:
            raise ValueError(f"readings(hz={hz!r}): give a rate above 0, such as 5")
        latest: dict[str, float] = {}
        news = asyncio.Event()

        def take(_: str, state: State) -> None:
            nonlocal latest
            latest = state.readings
            news.set()

        watching = await self._realm.realm_client.watch_state(self._robot, take)
        try:
            while True:
                try:
                    async with asyncio.timeout(SILENCE):
                        await news.wait()
                except TimeoutError:
                    latest = (await self._realm.describe(self._robot)).readings  # raises if it has ended
                news.clear()
                yield Record(latest)
                await asyncio.sleep(1.0 / hz)
        finally:
            await watching.close()


# -- robots as a program gets them: short in a notebook, and printed as trees ------------------------


_T = TypeVar("_T", Listing, RobotDescription)

MOST = 12
"""Names that are shown in one line."""


class Robots(tuple[_T, ...]):
    """Robots, each with `name`, `kind` and more. `print` draws parents above their children."""

    __slots__ = ()

    def __repr__(self) -> str:
        names = ", ".join(robot.name for robot in self[:MOST])
        return f"<{len(self)} robots{': ' if self else ''}{names}{' …' if len(self) > MOST else ''}>"

    def __str__(self) -> str:
        known = {robot.address.key: robot for robot in self}
        children = {slot.child.key for robot in self for slot in _slots(robot) if slot.child}
        roots = [robot for key, robot in known.items() if key not in children]
        return "\n".join(line for root in roots for line in _lines(root, known, "", ""))


def _slots(robot: Listing | RobotDescription) -> Sequence[SlotSpec]:
    """Return the places for children; a listing does not name them."""
    return robot.slots if isinstance(robot, RobotDescription) else ()


def _lines(
    robot: Listing | RobotDescription, known: Mapping[str, Listing | RobotDescription], lead: str, below: str
) -> Iterator[str]:
    """Draw a robot and all below it; a circle of parents, which is a fault, has no root and is not drawn."""
    yield f"{lead}{robot.name} ({robot.kind})"
    slots = _slots(robot)
    for number, slot in enumerate(slots, 1):
        elbow, bar = ("└─ ", "   ") if number == len(slots) else ("├─ ", "│  ")
        place = f"{below}{elbow}{slot.name}: "
        child = known.get(slot.child.key) if slot.child else None
        if child is not None:
            yield from _lines(child, known, place, below + bar)
        elif slot.child:
            yield f"{place}{slot.child.name} (does not answer)"
        elif slot.watched:
            yield f"{place}watches {slot.watched.name}"
        else:
            yield f"{place}empty ({slot.kind})"
