"""The context of a running command, and its requests to the robot that runs it.

Kept in a context variable, so that a command that moves and one that reads can run on the same robot at
the same time without knowing of each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, TypeVar

import msgspec

from robotree.vr.base.requests import AnyRequest, Level, Reply, State
from robotree.vr.base.units import seconds as seconds_of

T = TypeVar("T")


class CommandContext(msgspec.Struct, frozen=True, kw_only=True):
    """The identity of one running command, and its deadline."""

    key: str
    """`command id / path`: unique, passed down to the children and to the wire."""
    command: str
    caller: str
    """Name of the caller, for people."""
    epoch: int
    """Epoch of the robot when the command was accepted."""
    deadline_at: float
    """[s] on the monotonic clock: when it must be done."""
    witness: str = ""
    """If an earlier process of the robot may have carried it out: who remembers that, see `Call.witness`."""


class StepInDoubt(NamedTuple):
    """A call of a child of which nobody knows whether it was carried out."""

    slot: str
    """Of the child, as the page names it."""
    command: str
    arguments: Mapping[str, Any]
    """As they were given."""
    detail: str
    """Why nobody knows, as a clause."""

    @property
    def name(self) -> str:
        """The call as it stands in the page, without its arguments: `arm.grip`."""
        return f"{self.slot}.{self.command}"


class CallLimit(NamedTuple):
    """The time that one call of a child, or one wait, may take."""

    seconds: float
    text: str
    """As its author wrote it, for people."""

    @classmethod
    def of(cls, given: float | str | None) -> CallLimit | None:
        """Read what an author gave, [s] or text with a unit; None: no limit.

        Raises:
            TypeError, ValueError: it is no time.
        """
        if given is None:
            return None
        return cls(seconds_of(given), given if isinstance(given, str) else f"{given:g} s")


if TYPE_CHECKING:
    import typing_extensions

    R_co = typing_extensions.TypeVar("R_co", covariant=True, default=Any)
else:
    R_co = TypeVar("R_co", covariant=True)


class CallFuture(Protocol[R_co]):
    """A child's command under way."""

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        ...

    @property
    def progress(self) -> float:
        """Progress, 0 to 1; NaN before the first report."""
        ...

    def result(self, timeout: float | None = None) -> R_co:
        """Wait for the end and return the result.

        Args:
            timeout: [s] to wait; None: until the deadline of the running command.

        Raises:
            VrError: what the child raised.
            TimeoutError: it is still under way.
        """
        ...

    def cancel(self) -> None:
        """Ask the child to end it."""
        ...

    def detach(self) -> CallFuture[R_co]:
        """Have it go on when the running command ends. Waits until the child has accepted it.

        From then on it ends by itself, with the bond, by a stop, by `cancel`, or when an operator cancels it
        at the child.

        Returns:
            The future itself.
        """
        ...

    def when_done(self, tell: Callable[[], None]) -> None:
        """Call back once it has ended, from any thread; at once if it has."""
        ...


WhichValue = Literal["each", "newest", "next", "latest"]
"""Which value of a stream is meant: see `Activity.next_sample`."""


class Activity(Protocol):
    """One running command, as the code inside of it sees it. All its methods are cancellation points."""

    def in_this_thread(self) -> Activity:
        """Return the part of it that the present thread carries out: another thread is a part of its own."""
        ...

    @property
    def simulated(self) -> bool:
        """Whether it runs in virtual time."""
        ...

    def is_here(self) -> bool:
        """Whether the present thread already works for it."""
        ...

    def handed_on(self, work: Callable[..., T]) -> Callable[..., T]:
        """Return a function that works for it in another thread, with keys of its own."""
        ...

    @property
    def context(self) -> CommandContext:
        """Its identity and its deadline."""
        ...

    @property
    def call_key(self) -> str:
        """Key of the robot's call that it belongs to; a part of a command has a key of its own beside it."""
        ...

    @property
    def cancelled(self) -> bool:
        """Whether it has been asked to end."""
        ...

    def check(self) -> None:
        """Raise CommandCancelled or DeadlineExceeded if the command has been asked to end."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait [s]."""
        ...

    def now(self) -> float:
        """Return the time [s] on a monotonic clock. Not a step: a command asks by `Robot.now`."""
        ...

    def random(self) -> float:
        """Return a number from 0 up to but not including 1. Not a step either."""
        ...

    def wait_for(self, condition: Callable[[], bool], timeout: float = math.inf) -> bool:
        """Wait until something is so, `timeout` [s] at most; returns whether it is. See `wake`."""
        ...

    def wake(self) -> None:
        """Have `wait_for` and `receive` look again. From any thread."""
        ...

    def receive(self, look: Callable[[], T | None], every: float) -> T:
        """Wait for something from outside, as one step: after a crash the same is received in the same order.

        Args:
            look: returns it as plain data, or None: there is nothing yet. It may read, and takes no steps.
            every: [s] after which it is asked again at the latest; see `wake`.
        """
        ...

    def is_under_way(self, command: str) -> bool:
        """Whether a command of the robot has begun and not ended; after a crash also before it goes on."""
        ...

    def next_reading(self, slot: str, after: int, at: float) -> tuple[int, Any]:
        """Wait until `at` [s], and then for readings of a child that are newer than those of a number."""
        ...

    def reading(self, slot: str) -> Any:
        """Return the latest readings of a child; waits for the first."""
        ...

    def next_sample(
        self, slot: str, stream: str, which: WhichValue, *, at: float = 0.0, limit: CallLimit | None = None
    ) -> Any:
        """Return a value of a stream of the robot that is watched in a slot.

        Args:
            slot: in which it is watched.
            stream: name of the stream.
            which: `each`: the oldest that was not read yet; `newest`: the newest of these, from `at` on;
                `next`: one that comes from now on; `latest`: the newest one, read or not.
            at: [s] before which nothing is returned.
            limit: how long to wait; None: until the command ends.

        Raises:
            TimeoutError: none came in time.
            SlotEmpty: nobody is watched.
        """
        ...

    def published(self, slot: str) -> State | None:
        """Return the latest state that the child in a slot has published; None: none yet. Never waits."""
        ...

    def wait_until(self, condition: Callable[[], object], limit: CallLimit | None) -> None:
        """Wait until a condition on readings of children is true; see `Robot.wait_until`."""
        ...

    def progress(self, fraction: float, text: str) -> None:
        """Tell how far the command is."""
        ...

    def observe(self, look: Callable[[], Any]) -> Any:
        """Read something that may be another thing the next time: the clock, chance, who is in a slot."""
        ...

    def keep(self, change: Callable[[], None]) -> None:
        """Change what the robot keeps. No cancellation point: a command that ends may still note why."""
        ...

    def kept(self, name: str, value: Any) -> Any:
        """Return what the robot keeps in a field, at this place of the page.

        Args:
            name: of the field.
            value: what it keeps now: that counts, unless the command takes steps again after a crash.
        """
        ...

    def keep_values(self, values: dict[str, Any], change: Callable[[dict[str, Any]], None]) -> None:
        """Have the robot keep other values in fields, by `change`. No cancellation point."""
        ...

    def move_to(self, host: str) -> None: ...

    def host_of(self, slot: str) -> str:
        """Return the host on which the child in a slot lives, or one that is beside it."""
        ...

    def checkpoint(self) -> None: ...

    def say(self, level: Level, text: str, *, piece: bool = False) -> None:
        """Enter a text, or a piece of a line, in the robot's log. No cancellation point."""
        ...

    def call(
        self, slot: str, command: str, arguments: Mapping[str, Any], limit: CallLimit | None = None
    ) -> Any:
        """Call a child's command, wait for its end and return the result."""
        ...

    def start(
        self, slot: str, command: str, arguments: Mapping[str, Any], limit: CallLimit | None = None
    ) -> CallFuture:
        """Call a child's command; it ends with the running command at the latest."""
        ...

    def tell(self, slot: str, command: str, arguments: Mapping[str, Any]) -> None:
        """Call a child's command and wait only until the child has accepted it; it goes on by itself."""
        ...

    def together(self, *, first: bool) -> Any:
        """Return a `Together`, or a `Race` in which the first success decides."""
        ...

    def open_group(self, group: Any, /) -> None:
        """Have what is started from now on belong to a `together.Group`."""
        ...

    def close_group(self, group: Any, error: BaseException | None, /) -> None:
        """Wait until a group is over, unless its block has raised an error; end what still runs of it."""
        ...

    def start_part(
        self, group: Any, work: Callable[..., Any], values: tuple[Any, ...], arguments: dict[str, Any], /
    ) -> CallFuture:
        """Start a child's command, or a function of the page on another worker, as a part of a group."""
        ...

    def result_of(self, part: Any, timeout: float, /) -> Any:
        """Wait for a `together.Started`, `timeout` [s] at most, and return its result."""
        ...

    def let_go_on(self, part: Any, /) -> None:
        """Let a part go on after the command, as soon as the child has accepted it."""
        ...

    def ask_space(self, space: str, request: AnyRequest) -> Reply:
        """Ask a space, and wait for its answer."""
        ...

    def send_to_space(self, space: str, request: AnyRequest) -> None:
        """Tell a space something, without waiting. No cancellation point: a command that ends may do so."""
        ...

    def cleanup(self, within: float) -> AbstractContextManager[None]:
        """Let the code inside the block command children though the command has been asked to end."""
        ...


_running: ContextVar[Activity] = ContextVar("robotree_running_command")


_end_child: Callable[[], None] | None = None
"""Ends this process if it is a forked child: in it no command runs."""


def in_child(end: Callable[[], None]) -> None:
    """From now on no command runs here; `end` is called where code asks for one."""
    global _end_child  # noqa: PLW0603 # it is so once, and for good
    _end_child = end


def running() -> Activity:
    """Return the command that runs here.

    Raises:
        RuntimeError: none does.
    """
    if _end_child is not None:
        _end_child()
    activity = _running.get(None)
    if activity is None:
        raise RuntimeError(
            "this works only inside a running command (a method marked with @command); a thread of your own "
            "works for the command if it runs contextvars.copy_context().run, a ThreadPoolExecutor does so "
            "by itself"
        )
    return activity.in_this_thread()


def activity_here() -> Activity | None:
    """Return the command that runs here, or None."""
    activity = _running.get(None)
    return None if activity is None or _end_child is not None else activity.in_this_thread()


def commander_here() -> Activity | None:
    """Return the command for which the present thread works; None: for none.

    A context alone does not say so: event loops and timers take it over from the thread that calls them.
    """
    activity = _running.get(None)
    return activity if activity is not None and _end_child is None and activity.is_here() else None


enter: Callable[[Any], object] = _running.set
"""Says which command runs in the present context."""
