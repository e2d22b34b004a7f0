"""What a running command knows of itself, and what it may ask of whoever runs it.

Kept in a context variable, so that a command that moves and one that reads can run on the same robot at
the same time without knowing of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextvars import ContextVar
from typing import Any, Protocol

import msgspec


class CommandContext(msgspec.Struct, frozen=True, kw_only=True):
    """One command's papers."""

    key: str
    """`command id / path`: unique, passed down to the children and to the wire."""
    command: str
    caller: str
    """Name of whoever called, for people."""
    epoch: int
    """Epoch of the robot when the command was accepted."""
    deadline_at: float
    """[s] on the monotonic clock: when it must be done."""


class CallFuture(Protocol):
    """A child's command under way."""

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        ...

    @property
    def progress(self) -> float:
        """How far it is: 0 to 1, NaN while it has said nothing."""
        ...

    def result(self, timeout: float | None = None) -> Any:
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

    def when_done(self, tell: Callable[[], None]) -> None:
        """Call back once it has ended, from any thread; at once if it has."""
        ...


class Activity(Protocol):
    """One running command, as the code inside of it sees it. All its methods are cancellation points."""

    @property
    def context(self) -> CommandContext:
        """Its papers."""
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

    def progress(self, fraction: float, text: str) -> None:
        """Tell how far the command is."""
        ...

    def start(self, slot: str, command: str, arguments: Mapping[str, Any]) -> CallFuture:
        """Call a child's command."""
        ...

    def tell(self, slot: str, command: str, arguments: Mapping[str, Any]) -> None:
        """Call a child's command and wait only until the child has accepted it."""
        ...


_running: ContextVar[Activity] = ContextVar("robotree_running_command")


def running() -> Activity:
    """Return the command that runs here.

    Raises:
        RuntimeError: none does.
    """
    activity = _running.get(None)
    if activity is None:
        raise RuntimeError("this works only inside a running command (a method marked with @command)")
    return activity


def enter(activity: Activity) -> None:
    """Say which command the present thread runs, from now on to its end."""
    _running.set(activity)
