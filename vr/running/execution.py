"""Commands while they run: an author's code in its own thread, or a call passed through to a child.

The thread may block as it likes; it reaches the event loop only through the methods of `Activity`, and each
of those raises once the command has been cancelled. Code that does not listen is interrupted after a grace
period, and code that cannot be interrupted is abandoned: it can no longer reach any child, and it is told of
for as long as it runs.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import math
import threading
from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from typing import Any, Protocol, TypeVar, cast

from robotree.vr import context as contexts
from robotree.vr.child import Record
from robotree.vr.context import CallFuture, CommandContext
from robotree.vr.errors import CommandCancelled, VrError
from robotree.vr.running.interruptible import InterruptibleThread

GRACE = 1.0
"""[s] between a cancel and the interruption of code that does not listen."""
ATTEMPTS = 3
"""Interruptions, a grace period apart, before the code is abandoned."""
LONGEST_END = GRACE * (ATTEMPTS + 1)
"""[s] from a cancel to the moment when its command has ended or is known not to end."""

_T = TypeVar("_T")
OnProgress = Callable[[float, str], None]


class Children(Protocol):
    """How a running command reaches the children. All on the event loop."""

    async def call(
        self,
        slot: str,
        command: str,
        arguments: Mapping[str, Any],
        *,
        key: str,
        context: CommandContext,
        oneway: bool = False,
        on_progress: OnProgress | None = None,
    ) -> Any:
        """Call the child in a slot under the bond's epoch, within the caller's deadline."""
        ...


class Run(Protocol):
    """One running command, as the agent sees it."""

    @property
    def outcome(self) -> asyncio.Future[Any]:
        """Its result or error."""
        ...

    @property
    def over(self) -> asyncio.Future[None]:
        """Done when nothing of it runs any more. If its outcome is there before, it was abandoned."""
        ...

    def cancel(self, cause: VrError) -> None:
        """End it; `outcome` becomes the cause unless it succeeds after all. The first cause counts."""
        ...


class Forward:
    """An exposed command: passed on to the child without a thread."""

    def __init__(self, work: Coroutine[Any, Any, Any]) -> None:
        """Begin to pass it on."""
        self.outcome: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self.over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._cause: VrError | None = None
        self._task = asyncio.get_running_loop().create_task(work)
        self._task.add_done_callback(self._settle)

    def cancel(self, cause: VrError) -> None:
        """See `Run.cancel`."""
        if self._cause is None:
            self._cause = cause
            self._task.cancel()

    def _settle(self, task: asyncio.Task[Any]) -> None:
        self.over.set_result(None)
        if task.cancelled():
            self.outcome.set_exception(self._cause or asyncio.CancelledError())
        elif error := task.exception():
            self.outcome.set_exception(error)
        else:
            self.outcome.set_result(task.result())


class CommandThread:
    """An author's command in its thread. It is the `Activity` that the code inside sees."""

    def __init__(
        self,
        robot: str,
        context: CommandContext,
        work: Callable[[], Any],
        children: Children | None,
        on_progress: OnProgress,
    ) -> None:
        """Begin.

        Args:
            robot: its name.
            context: the papers of the command.
            work: the command with its arguments; returns plain values.
            children: the way to them; None: this robot has none.
            on_progress: told on the event loop how far it is.
        """
        self._loop = asyncio.get_running_loop()
        self.outcome: asyncio.Future[Any] = self._loop.create_future()
        self.over: asyncio.Future[None] = self._loop.create_future()
        self._robot, self._context, self._work = robot, context, work
        self._children, self._on_progress = children, on_progress
        self._cause: VrError | None = None
        self._steps = 0
        self._tasks: set[asyncio.Task[Any]] = set()
        self._lock = threading.Lock()
        self._news: tuple[float, str] | None = None
        self._alarm: asyncio.TimerHandle | None = None
        self._thread = InterruptibleThread(self._main, self._report, name=f"{robot}.{context.command}")
        self._thread.start()

    # -- on the event loop ------------------------------------------------------------------------

    def cancel(self, cause: VrError) -> None:
        """See `Run.cancel`."""
        if self._cause is not None or self.outcome.done():
            return
        self._cause = cause
        for task in self._tasks:
            task.cancel()
        self._alarm = self._loop.call_later(GRACE, self._insist, ATTEMPTS)

    def _insist(self, attempts: int) -> None:
        if attempts:
            self._thread.interrupt()
            self._alarm = self._loop.call_later(GRACE, self._insist, attempts - 1)
        else:
            self._settle(None, self._cause)

    def _end(self, value: Any, error: BaseException | None) -> None:
        self.over.set_result(None)
        self._settle(value, error)

    def _settle(self, value: Any, error: BaseException | None) -> None:
        if self._alarm is not None:
            self._alarm.cancel()
        if self.outcome.done():
            return
        if error is None:
            self.outcome.set_result(value)
        else:
            for task in self._tasks:  # nobody watches over what it has started
                task.cancel()
            self.outcome.set_exception(self._cause or error)

    async def _step(self, work: Callable[[], Coroutine[Any, Any, _T]]) -> _T:
        """Do something for the thread; ends when the command is cancelled."""
        task = asyncio.current_task()
        if self._cause is not None or task is None:
            raise asyncio.CancelledError
        self._tasks.add(task)
        try:
            return await work()
        finally:
            self._tasks.discard(task)

    def _tell_progress(self) -> None:
        with self._lock:
            news, self._news = self._news, None
        if news is not None:
            self._on_progress(*news)

    # -- in the thread ----------------------------------------------------------------------------

    def _main(self) -> Any:
        contexts.enter(self)
        return self._work()

    def _report(self, value: Any, error: BaseException | None) -> None:
        with contextlib.suppress(RuntimeError):  # the loop is closed: nobody wants to know
            self._loop.call_soon_threadsafe(self._end, value, error)

    def _submit(self, work: Callable[[], Coroutine[Any, Any, _T]]) -> concurrent.futures.Future[_T]:
        step = self._step(work)
        try:
            return asyncio.run_coroutine_threadsafe(step, self._loop)
        except RuntimeError:
            step.close()
            raise self._cancelled("its host has ended") from None

    def _cancelled(self, reason: str) -> CommandCancelled:
        return CommandCancelled(robot=self._robot, command=self._context.command, reason=reason)

    @property
    def context(self) -> CommandContext:
        """See `Activity.context`."""
        return self._context

    @property
    def cancelled(self) -> bool:
        """See `Activity.cancelled`."""
        return self._cause is not None

    def check(self) -> None:
        """See `Activity.check`."""
        cause = self._cause
        if cause is not None:
            raise type(cause)(**cause.data)

    def sleep(self, seconds: float) -> None:
        """See `Activity.sleep`."""
        self.check()
        if math.isnan(seconds):  # it would upset the timers of all robots here
            raise ValueError("cannot sleep for NaN seconds")
        self.wait(self._submit(lambda: asyncio.sleep(max(seconds, 0.0))), None)

    def progress(self, fraction: float, text: str) -> None:
        """See `Activity.progress`."""
        self.check()
        news = (float(fraction), str(text))
        with self._lock:
            waiting, self._news = self._news is not None, news
        if not waiting:
            self._loop.call_soon_threadsafe(self._tell_progress)

    def start(self, slot: str, command: str, arguments: Mapping[str, Any]) -> CallFuture:
        """See `Activity.start`."""
        return self._call(slot, command, arguments, oneway=False)

    def tell(self, slot: str, command: str, arguments: Mapping[str, Any]) -> None:
        """See `Activity.tell`."""
        self._call(slot, command, arguments, oneway=True).result()

    def _call(self, slot: str, command: str, arguments: Mapping[str, Any], *, oneway: bool) -> ChildCall:
        self.check()
        if self._children is None:
            raise RuntimeError(f"{self._robot} has no children")
        self._steps += 1
        call = ChildCall(self)
        work = partial(
            self._children.call,
            slot,
            command,
            arguments,
            key=f"{self._context.key}/{self._steps}",
            context=self._context,
            oneway=oneway,
            on_progress=call.note,
        )
        call.future = self._submit(work)
        return call

    def wait(self, future: concurrent.futures.Future[_T], timeout: float | None) -> _T:
        """Block the thread until a step has ended.

        Raises:
            CommandCancelled: this command, or the step alone, was cancelled.
        """
        try:
            return future.result(timeout)
        except (concurrent.futures.CancelledError, asyncio.CancelledError):
            self.check()
            raise self._cancelled("its call of a child was cancelled") from None
        except TimeoutError:
            self.check()
            raise


class ChildCall:
    """A child's command under way, seen from the thread that started it."""

    future: concurrent.futures.Future[Any]

    def __init__(self, thread: CommandThread) -> None:
        """Made by the thread, which fills in the future."""
        self._thread = thread
        self._fraction = math.nan

    def note(self, fraction: float, text: str) -> None:
        """Take in how far the child is."""
        del text
        self._fraction = fraction

    @property
    def done(self) -> bool:
        """See `CallFuture.done`."""
        return self.future.done()

    @property
    def progress(self) -> float:
        """See `CallFuture.progress`."""
        return self._fraction

    def result(self, timeout: float | None = None) -> Any:
        """See `CallFuture.result`."""
        value = self._thread.wait(self.future, timeout)
        return Record(cast("dict[str, Any]", value)) if isinstance(value, dict) else value

    def cancel(self) -> None:
        """See `CallFuture.cancel`."""
        self.future.cancel()

    def when_done(self, tell: Callable[[], None]) -> None:
        """See `CallFuture.when_done`."""
        self.future.add_done_callback(lambda _: tell())
