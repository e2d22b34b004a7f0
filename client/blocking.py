"""A realm and its robots for scripts, notebooks and tests without asyncio.

    with connect() as realm:
        arm = realm["arm-1"]
        arm.go_to(x="30 cm", y=0, z=0.4, twist=0, within="20 s")
        move = arm.go_to.start(x=0.3, y=0.1, z=0.4, twist=0)
        print(move.progress)
        move.cancel()
        for reading in arm.readings(hz=20):
            print(reading.z)
        typed = realm.get("arm-1", Arm)

Everything is that of `robotree.client.asynchronous`, on an event loop in a thread of its own: each method
waits for the one of the same name there. A command ends with the block, on Ctrl-C, or with the program.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import threading
import weakref
from collections.abc import AsyncGenerator, Callable, Coroutine, Generator, Iterator
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, Self, TypeVar, cast, overload

from robotree.client.asynchronous import AsyncCall, AsyncCommand, AsyncReadings, AsyncRealm, connect_async
from robotree.files import forks
from robotree.vr.author.child import readable
from robotree.vr.author.kind import Kind
from robotree.vr.author.readings import Record
from robotree.vr.base.errors import BadArgument, NoAnswer, TransportClosed, Unreachable, VrError

if TYPE_CHECKING:
    from types import TracebackType

    from robotree.vr.base.requests import State

FAREWELL = 5.0
"""[s] for the commands to be ended when a realm is left."""

_P = ParamSpec("_P")
_T = TypeVar("_T")
_K = TypeVar("_K", bound=Kind)


def connect(realm: str | None = None) -> Realm:
    """Join a realm whose robots run, until the `with` block or the program ends.

    Args:
        realm: its name; None: that of `$ROBOTREE_REALM`, else `default`.

    Raises:
        BadName: it cannot be a name.
        TransportError: the realm cannot be joined.
    """
    return Realm(realm)


class _Loop:
    """An event loop in a thread of its own, and the realm that was joined there."""

    def __init__(self, realm: str | None) -> None:
        """Join; see `connect`."""
        self._entered: Future[AsyncRealm] = Future()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._over = asyncio.Event()
        self._thread = threading.Thread(target=self._run, args=(realm,), name="robotree", daemon=True)
        self._thread.start()
        self.realm = self._entered.result()

    def _run(self, realm: str | None) -> None:
        try:
            asyncio.run(self._be_there(realm))
        except BaseException as error:  # noqa: BLE001 # raised where the realm was to be joined
            if not self._entered.done():
                self._entered.set_exception(error)

    async def _be_there(self, realm: str | None) -> None:
        self._loop = asyncio.get_running_loop()
        async with connect_async(realm) as entered:
            self._entered.set_result(entered)
            await self._over.wait()

    def wait_for(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Have something done on the loop, and wait for it; it is cancelled where the wait is interrupted."""
        try:
            loop = self.expect_open()
        except BaseException:
            work.close()
            raise
        future = asyncio.run_coroutine_threadsafe(work, loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def expect_open(self) -> asyncio.AbstractEventLoop:
        """Return the loop.

        Raises:
            TransportClosed: the realm was left.
        """
        forks.expect_parent()  # the loop runs in the parent alone
        loop = self._loop
        if loop is None or loop.is_closed() or self._over.is_set():
            raise TransportClosed(key=self.realm.name)
        return loop

    def close(self) -> None:
        """End the commands that still run, and leave. Twice is once."""
        loop = self._loop
        if loop is not None and self._thread.is_alive():
            with contextlib.suppress(RuntimeError):  # it has just ended
                loop.call_soon_threadsafe(self._over.set)
            self._thread.join(FAREWELL)


def _waits_for(
    method: Callable[Concatenate[AsyncRealm, _P], Coroutine[Any, Any, _T]],
) -> Callable[Concatenate[Realm, _P], _T]:
    """Return the method of the same name without asyncio."""

    @functools.wraps(method)
    def waits(self: Realm, /, *values: _P.args, **arguments: _P.kwargs) -> _T:
        return self.wait_for(method(self.behind, *values, **arguments))

    waits.__qualname__ = f"Realm.{method.__name__}"  # what `print` and errors of arguments say
    return waits


class Realm:
    """A realm: its robots by name, and what a supervisor does with them. See `AsyncRealm` for each method."""

    def __init__(self, realm: str | None = None) -> None:
        """Join; see `connect`."""
        self._loop = _Loop(realm)
        self.behind = self._loop.realm
        """The realm for asyncio, on its own event loop: use it in coroutines for `wait_for`."""
        self._caller = ""
        self._close = weakref.finalize(self, self._loop.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<realm {self.name}>"

    def close(self) -> None:
        """End the commands that still run, and leave. Twice is once."""
        self._close()

    @property
    def name(self) -> str:
        """The realm's name."""
        return self.behind.name

    def __getitem__(self, robot: str) -> Robot:
        """Return the robot of a name, whether it runs at the moment or not."""
        return Robot(self, robot)

    @overload
    def get(self, robot: str, kind: None = None) -> Robot: ...
    @overload
    def get(self, robot: str, kind: type[_K]) -> _K: ...
    def get(self, robot: str, kind: type[_K] | None = None) -> Robot | _K:
        """Return a robot that runs and is of a kind; editors and type checkers know its commands then."""
        self.wait_for(self.behind.get(robot, kind))
        return cast("_K", self[robot])

    def wait_for(self, work: Coroutine[Any, Any, _T]) -> _T:
        """Wait for something of the realm for asyncio; an error comes without the lines that it passed there.

        Raises:
            TransportClosed: the realm was left.
        """
        try:
            return self._loop.wait_for(work)
        except VrError as error:
            raise error.with_traceback(None) from error.__cause__

    @property
    def caller(self) -> str:
        """Key under which this program is present from its first call on.

        Raises:
            TransportClosed: the realm was left.
        """
        self._loop.expect_open()
        if not self._caller:
            self._caller = self.wait_for(self.behind.realm_client.caller())
        return self._caller

    # -- who is there -----------------------------------------------------------------------------

    ls = _waits_for(AsyncRealm.ls)
    tree = _waits_for(AsyncRealm.tree)
    describe = _waits_for(AsyncRealm.describe)
    log = _waits_for(AsyncRealm.log)
    look = _waits_for(AsyncRealm.look)

    def watch(self) -> Generator[tuple[str, State]]:
        """Yield the name and the new state of a robot, whenever one publishes its state."""
        return _each(self, self.behind.watch())

    # -- robots on top of robots ------------------------------------------------------------------

    def create(self, page: str, robot: str, *, host: str = "", wanted: str = "", **settings: Any) -> Robot:
        """Make a virtual robot from a page; see `AsyncRealm.create`."""
        self.wait_for(self.behind.create(page, robot, host=host, wanted=wanted, **settings))
        return self[robot]

    reload = _waits_for(AsyncRealm.reload)
    migrate = _waits_for(AsyncRealm.migrate)
    enslave = _waits_for(AsyncRealm.enslave)
    release = _waits_for(AsyncRealm.release)
    delete = _waits_for(AsyncRealm.delete)

    # -- what they do -----------------------------------------------------------------------------

    cancel = _waits_for(AsyncRealm.cancel)
    pause = _waits_for(AsyncRealm.pause)
    step = _waits_for(AsyncRealm.step)
    go_on = _waits_for(AsyncRealm.go_on)
    stop = _waits_for(AsyncRealm.stop)
    resume = _waits_for(AsyncRealm.resume)


class Robot:
    """A robot of a realm; its attributes are its commands, and `readings`."""

    def __init__(self, realm: Realm, name: str) -> None:
        """Made by access to a realm."""
        self._realm, self._robot, self._name = realm, realm.behind[name], name

    def __str__(self) -> str:
        return self._name

    def __repr__(self) -> str:
        return repr(self._robot)

    @property
    def readings(self) -> Readings:
        """The robot's readings, as it publishes them."""
        return Readings(self._realm, self._robot.readings)

    def __getattr__(self, command: str) -> Command:
        if command.startswith("_"):
            raise AttributeError(command)
        found = vars(self)[command] = Command(self._realm, getattr(self._robot, command))
        return found


class Command:
    """One command of a robot; see `AsyncCommand`."""

    def __init__(self, realm: Realm, command: AsyncCommand) -> None:
        """Made by access to a robot's attribute."""
        self._realm, self._command = realm, command

    def __call__(self, *values: Any, **arguments: Any) -> Any:
        """Have the command carried out, and return its result.

        The calling thread itself asks and waits; the event loop behind the realm is needed only where the
        robot has to be looked for. An error comes without the lines of ours that it passed.
        """
        try:
            return self._carry_out(values, arguments)
        except VrError as error:
            raise error.with_traceback(None) from error.__cause__

    def _carry_out(self, values: tuple[Any, ...], arguments: dict[str, Any]) -> Any:
        realm, command = self._realm, self._command
        address = realm.behind.realm_client.find(command.robot)
        if address is None or not command.knows(values, arguments):
            return realm.wait_for(command(*values, **arguments))
        deadline, named = command.prepared(values, arguments)
        try:
            value = realm.behind.realm_client.call_from_thread(
                address, command.name, named, deadline=deadline, caller=realm.caller
            )
        except BadArgument:
            command.forget()
            raise
        except (NoAnswer, Unreachable) as error:
            realm.wait_for(realm.behind.realm_client.expect_awake(error))
            raise
        return readable(value)

    def start(self, *values: Any, **arguments: Any) -> Call:
        """Start the command and return at once; it ends with the realm's block at the latest."""
        return Call(self._realm, self._realm.wait_for(self._command.start(*values, **arguments)))

    @contextlib.contextmanager
    def attended(self, held: Callable[[], bool], *values: Any, **arguments: Any) -> Generator[Call]:
        """Start a command that goes on only while somebody holds a key, and end it with the block.

        `held` is asked on the thread behind the realm, so it may not wait; else as `AsyncCommand.attended`.
        """
        block = self._command.attended(held, *values, **arguments)
        call = self._realm.wait_for(block.__aenter__())
        try:
            yield Call(self._realm, call)
        finally:
            self._realm.wait_for(block.__aexit__(None, None, None))

    def tell(self, *values: Any, **arguments: Any) -> None:
        """Send the command and wait only until the robot has accepted it; it may outlive the program."""
        self._realm.wait_for(self._command.tell(*values, **arguments))


class Call:
    """A command under way."""

    def __init__(self, realm: Realm, call: AsyncCall) -> None:
        """Made by `Command.start`."""
        self._realm, self._call = realm, call

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        return self._call.done

    @property
    def progress(self) -> float:
        """How far it is, 0 to 1; NaN before the first report."""
        return self._call.progress

    @property
    def note(self) -> str:
        """The latest text about its progress."""
        return self._call.note

    def result(self, timeout: float | None = None) -> Any:
        """Wait for the end and return the result.

        Args:
            timeout: [s] to wait; None: until it ends.

        Raises:
            VrError: it was refused, failed or was ended.
            TimeoutError: it still runs, and goes on.
        """
        return self._realm.wait_for(_result(self._call, timeout))

    def cancel(self) -> None:
        """End it."""
        self._realm.wait_for(self._call.cancel())


class Readings:
    """The readings of a robot; see `AsyncReadings`. `arm.readings.z` asks for the present value."""

    def __init__(self, realm: Realm, readings: AsyncReadings) -> None:
        """Made by access to a robot's attribute."""
        self._realm, self._readings = realm, readings

    def now(self) -> Record:
        """Ask for the present values."""
        return self._realm.wait_for(self._readings.now())

    def __call__(self, *, hz: float = 10.0) -> Iterator[Record]:
        """Yield each new reading; if several came since the last one, the latest. Ends only by an error."""
        return _each(self._realm, self._readings(hz=hz))

    def __getattr__(self, name: str) -> float:
        if name.startswith("_"):
            raise AttributeError(name)
        value: float = getattr(self.now(), name)
        return value

    def __getitem__(self, name: str) -> float:
        value: float = self.now()[name]
        return value


async def _result(call: AsyncCall, timeout: float | None) -> Any:
    async with asyncio.timeout(timeout):
        await call.ended()
    return await call


def _each(realm: Realm, items: AsyncGenerator[_T]) -> Generator[_T]:
    """Wait for one thing after the other, until the loop over them is left."""
    try:
        while True:
            yield realm.wait_for(_next(items))
    finally:
        with contextlib.suppress(TransportClosed):
            realm.wait_for(_end(items))


async def _next(items: AsyncGenerator[_T]) -> _T:
    return await anext(items)


async def _end(items: AsyncGenerator[Any]) -> None:
    await items.aclose()
