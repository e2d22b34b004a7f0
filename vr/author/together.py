"""Several parts of a command at once: all of them, or the first that succeeds.

    with self.together() as both:
        both.start(self.left.go_to, x=0.3)
        both.start(self.right.go_to, x=0.3)

A part is a call of a child, or a function of the page on another worker. At the end of the block all have
ended. The first failure ends the others and is what is raised. A group belongs to the thread that has opened
it; groups may be nested.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Any, ParamSpec, Self, TypeVar

from robotree.vr.author.context import Activity, CallFuture
from robotree.vr.base.errors import Failed, VrError, words_of

P = ParamSpec("P")
R = TypeVar("R")


class Started(CallFuture[Any], ABC):
    """Work that a command has started and that may go on beside it: a child's call, a page's function."""

    called_off: bool = False
    """Whether the page itself has cancelled it before it ended: that is no failure."""
    at_rest: bool = True
    """Whether nothing of it uses the page's data any more."""

    _on_done: list[Callable[[], None]]
    """Callbacks for its end."""

    @property
    @abstractmethod
    def activity(self) -> Activity:
        """The command, or the part of it, that has started it."""

    @abstractmethod
    def error(self) -> BaseException | None:
        """Return with what it has failed; None: it has not, or goes on."""

    @abstractmethod
    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker; return the result.

        Raises:
            TimeoutError: it is still under way after `timeout` [s].
        """

    @abstractmethod
    def wait_until_accepted(self) -> None:
        """Wait until the child has accepted it."""

    @abstractmethod
    def let_go(self) -> None:
        """Have it go on after the command."""

    @abstractmethod
    def drop(self, reason: str) -> None:
        """End it, for nobody waits for it any more. From any thread."""

    @abstractmethod
    def end_with_command(self) -> None:
        """Take note that the command is asked to end. From any thread."""

    def result(self, timeout: float | None = None) -> Any:
        """Wait for the end and return the result."""
        return self.activity.in_this_thread().result_of(self, math.inf if timeout is None else timeout)

    def detach(self) -> Self:
        """Have it go on when the running command ends; waits until the child has accepted it."""
        self.activity.in_this_thread().let_go_on(self)
        return self

    def when_done(self, tell: Callable[[], None]) -> None:
        """Call back once it has ended, from any thread; at once if it has."""
        self._on_done.append(tell)
        if self.done:
            self.tell_all()

    def tell_all(self) -> None:
        """Call back those who wait for its end. From any thread, also from several at once."""
        while self._on_done:
            try:
                tell = self._on_done.pop()
            except IndexError:  # another thread has taken it
                return
            tell()


class Group:
    """A block in which several parts of a command run at once; see the module."""

    first_decides = False
    """Whether the first success decides, not the first failure."""

    def __init__(self, activity: Activity) -> None:
        """Prepare the block.

        Args:
            activity: the command, or the part of it, whose parts they are.
        """
        self._activity = activity
        self.outer: Group | None = None
        """The group around it."""
        self.parts: list[Started] = []
        self._ended: list[Started] = []
        """Those that have ended, in that order."""
        self._results: list[Any] | None = None
        self._open = False
        self._decided_before: Started | None = None
        """The part that decided it before its process was started again."""

    # -- for the author ---------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._activity.open_group(self)
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open = False
        self._activity.close_group(self, error)

    def start(self, work: Callable[P, R], /, *values: P.args, **arguments: P.kwargs) -> CallFuture[R]:
        """Start a child's command, or a function of the page that calls children one after the other.

        Args:
            work: `self.left.go_to`, or a function.
            *values: of its arguments, in their order.
            **arguments: by name.

        Returns:
            Its future; inside the block one can wait for it alone.
        """
        activity = self._activity
        if not self._open or activity.in_this_thread() is not activity:
            raise RuntimeError("start parts inside of the `with` block, in the thread that has opened it")
        return activity.start_part(self, work, values, arguments)

    @property
    def results(self) -> list[Any]:
        """The results of all, in the order in which they were started; after the block.

        None for a part that the page itself has cancelled.
        """
        if self._results is None:
            raise RuntimeError("the results are there after the `with` block")
        return self._results

    # -- for the running command ------------------------------------------------------------------

    @property
    def decisive(self) -> Started | None:
        """The part that has decided how the group ends; None: none has yet."""
        if (before := self._decided_before) is not None:
            return before if before.done else None
        return next(filter(self._decides, self._ended), None)

    @property
    def number_of_decisive(self) -> int | None:
        """The number of that part, counted from 0; None: none has decided."""
        decisive = self.decisive
        return None if decisive is None else self.parts.index(decisive)

    def decide(self, number: int | None) -> None:
        """Have the part of a number decide, as it did before; None: none does."""
        if number is not None:
            self._decided_before = self.parts[number]

    def _decides(self, part: Started) -> bool:
        succeeded = part.error() is None
        return succeeded if self.first_decides else not (succeeded or part.called_off)

    @property
    def decided(self) -> str:
        """Why nothing more is to begin, as words; empty: it may."""
        if self.decisive is None:
            return ""
        return "another one has succeeded" if self.first_decides else "another one has failed"

    def is_over(self) -> bool:
        """Whether nothing is to be waited for any more."""
        return self.decisive is not None or all(part.done for part in self.parts)

    def check(self) -> None:
        """Raise the first failure, of this group or of those around it.

        Raises:
            BaseException: the error of a part.
        """
        if not self.first_decides and (decisive := self.decisive) is not None:
            error = decisive.error()
            assert error is not None  # noqa: S101 # it has failed
            raise error
        if self.outer is not None:
            self.outer.check()

    def add(self, part: Started) -> None:
        """Take a part in."""
        self.parts.append(part)
        part.when_done(lambda: self._note(part))

    def leave(self, part: Started) -> None:
        """Let a part go on by itself."""
        if part in self.parts:
            self.parts.remove(part)

    def take_results(self) -> None:
        """Read the results when it is over.

        Raises:
            BaseException: the first failure.
        """
        self.check()
        self._results = [None if part.called_off else part.get() for part in self.parts]

    def _note(self, part: Started) -> None:
        """Take note that a part has ended. From any thread."""
        if part not in self.parts:
            return
        self._ended.append(part)
        reason = self.decided
        for other in tuple(self.parts) if reason else ():
            other.drop(reason)
        self._activity.wake()


class Together(Group):
    """Several parts of a command at once: see `Robot.together`."""


class Race(Group):
    """Several ways to do the same: see `Robot.first`."""

    first_decides = True

    @property
    def result(self) -> Any:
        """The result of the first that succeeded; after the block."""
        return self.results[0]

    @property
    def winner(self) -> int:
        """The number of that part, counted from 0 in the order of the starts; after the block."""
        if self._results is None:
            raise RuntimeError("the winner is known after the `with` block")
        decisive = self.decisive
        assert decisive is not None  # noqa: S101 # else the block has raised
        return self.parts.index(decisive)

    def take_results(self) -> None:
        """Read the result when it is over.

        Raises:
            Failed: no part has succeeded; names all errors.
        """
        decisive = self.decisive
        if decisive is None:
            raise self._none()
        self._results = [decisive.get()]

    def _none(self) -> Failed:
        if not self.parts:
            return Failed("nothing was started in the block of `first`")
        errors = [error for part in self.parts if (error := part.error())]
        reasons = (str(error) if isinstance(error, VrError) else words_of(error) for error in errors)
        failed = Failed(f"none of {len(self.parts)} has succeeded: {'; '.join(reasons)}")
        failed.__cause__ = errors[0] if errors else None
        return failed
