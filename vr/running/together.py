"""Several parts of a command at once: all of them, or the first that succeeds.

    with self.together() as both:
        both.start(self.left.go_to, x=0.3)
        both.start(self.right.go_to, x=0.3)

A part is a call of a child, or a function of the page on another worker. At the end of the block all have
ended. The first failure ends the others and is what is raised. A group belongs to one frame, the command's or
that of a part; groups may be nested.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import Any, Protocol, Self

from robotree.vr.child import ChildCommand
from robotree.vr.context import CallFuture
from robotree.vr.errors import Failed, VrError
from robotree.vr.running.page_trace import words_of


class Started(CallFuture, Protocol):
    """What a command has started and what may go on beside it, as the command needs it."""

    called_off: bool
    """Whether the page itself has cancelled it before it ended: that is no failure."""

    @property
    def at_rest(self) -> bool:
        """Whether nothing of it uses the page's data any more."""
        ...

    def error(self) -> BaseException | None:
        """Return with what it has failed; None: it has not, or goes on."""
        ...

    def get(self, timeout: float = ...) -> Any:
        """Wait for the end in the command's worker; return the result."""
        ...

    def wait_until_accepted(self) -> None:
        """Wait until the child has accepted it."""
        ...

    def let_go(self) -> None:
        """Have it go on after the command."""
        ...

    def drop(self, reason: str) -> None:
        """Nobody waits for it any more: end it. From any thread."""
        ...

    def end_with(self, cause: VrError, *, final: bool) -> None:
        """The command is asked to end. From any thread."""
        ...


class Opener(Protocol):
    """The frame of a group, as the group needs it."""

    group: Group | None

    def in_this_thread(self) -> object:
        """Return the frame for the present thread."""
        ...

    def open_group(self, group: Group) -> None:
        """What is started from now on belongs to the group."""
        ...

    def close_group(self, group: Group, error: BaseException | None) -> None:
        """Wait for the group, and end what still runs."""
        ...

    def branch(self, work: Callable[[], Any]) -> Started:
        """Carry out a function on another worker, in the innermost group."""
        ...

    def wake(self) -> None:
        """Have the frame look again what it waits for. From any thread."""
        ...


class Part:
    """Tells once that it is done: what calls of children and functions on other workers have in common."""

    called_off: bool = False
    """See `Started.called_off`."""
    _tell: list[Callable[[], None]]

    @property
    def done(self) -> bool:
        """See `CallFuture.done`."""
        raise NotImplementedError

    def when_done(self, tell: Callable[[], None]) -> None:
        """See `CallFuture.when_done`."""
        self._tell.append(tell)
        if self.done:
            self.tell_all()

    def tell_all(self) -> None:
        """Tell that it is done. From any thread, also from several at once."""
        while self._tell:
            try:
                tell = self._tell.pop()
            except IndexError:  # another thread has taken it
                return
            tell()


class Group:
    """See the module. It is the `Together` and the `Race` that the author's code sees."""

    def __init__(self, frame: Opener, *, first: bool) -> None:
        """Made by the frame.

        Args:
            frame: whose parts they are.
            first: the first success decides, not the first failure.
        """
        self._frame, self._first = frame, first
        self.outer: Group | None = None
        """The group around it."""
        self.parts: list[Started] = []
        self._ended: list[Started] = []
        """Those that have ended, in that order."""
        self._results: list[Any] | None = None
        self._open = False

    # -- for the author ---------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._frame.open_group(self)
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open = False
        self._frame.close_group(self, error)

    def start(self, work: Callable[..., Any], /, *values: Any, **arguments: Any) -> CallFuture:
        """Start a child's command (`both.start(self.left.go_to, x=0.3)`) or a function of the page.

        Returns:
            The same as `.start` of a child's command: its result can also be asked for inside the block.
        """
        frame = self._frame
        if not self._open or frame.in_this_thread() is not frame:
            raise RuntimeError("start parts inside of the `with` block, in the thread that has opened it")
        inner, frame.group = frame.group, self
        try:
            if isinstance(work, ChildCommand):
                return work.start(*values, **arguments)
            return frame.branch(partial(work, *values, **arguments))
        finally:
            frame.group = inner

    @property
    def results(self) -> list[Any]:
        """The results of all, in the order in which they were started; after the block.

        None for a part that the page itself has cancelled.
        """
        if self._results is None:
            raise RuntimeError("the results are there after the `with` block")
        return self._results

    @property
    def result(self) -> Any:
        """The result of the first that succeeded; after the block."""
        return self.results[0]

    @property
    def winner(self) -> int:
        """Which one that was, counted from 0 in the order of the starts; after the block."""
        if self._results is None:
            raise RuntimeError("the winner is known after the `with` block")
        assert self._decisive is not None  # noqa: S101 # else the block has raised
        return self.parts.index(self._decisive)

    # -- for the frame ----------------------------------------------------------------------------

    @property
    def _decisive(self) -> Started | None:
        return next(filter(self._decides, self._ended), None)

    def _decides(self, part: Started) -> bool:
        succeeded = part.error() is None
        return succeeded if self._first else not (succeeded or part.called_off)

    @property
    def decided(self) -> str:
        """Why nothing more is to begin, as words; empty: it may."""
        if self._decisive is None:
            return ""
        return "another one has succeeded" if self._first else "another one has failed"

    def is_over(self) -> bool:
        """Whether nothing is to be waited for any more."""
        return self._decisive is not None or all(part.done for part in self.parts)

    def check(self) -> None:
        """Raise the first failure, of this group or of those around it.

        Raises:
            BaseException: what a part has raised.
        """
        if not self._first and self._decisive is not None:
            error = self._decisive.error()
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
            Failed: none of those of which one was to succeed has.
        """
        decisive = self._decisive
        if not self._first:
            self.check()
            self._results = [None if part.called_off else part.get() for part in self.parts]
        elif decisive is not None:
            self._results = [decisive.get()]
        else:
            raise self._none()

    def _none(self) -> Failed:
        if not self.parts:
            return Failed("nothing was started in the block of `first`")
        errors = [part.error() for part in self.parts]
        told = "; ".join(
            str(error) if isinstance(error, VrError) else words_of(error) for error in errors if error
        )
        failed = Failed(f"none of {len(errors)} has succeeded: {told}")
        failed.__cause__ = errors[0]
        return failed

    def _note(self, part: Started) -> None:
        """A part has ended. From any thread."""
        if part not in self.parts:
            return
        self._ended.append(part)
        reason = self.decided
        for other in tuple(self.parts) if reason else ():
            other.drop(reason)
        self._frame.wake()
