"""An asyncio event loop in virtual time: it waits as everything else does, in a `VirtualRunner`.

Several of them, one for each simulated process, run in one operating system thread: each has a greenlet of
its own. What a program gives to a thread pool (`asyncio.to_thread`, `run_in_executor`) runs in a greenlet. It
watches no files: sockets, pipes and child processes of the operating system take no virtual time.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import heapq
import threading
from asyncio import base_events, events
from collections import deque
from collections.abc import Callable, Coroutine
from typing import Any, ParamSpec, TypeVar

from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner

TICK = 1e-9
"""[s] Timers that are due within it are due now, as asyncio has it."""

MOST_CANCELLED = 100
"""Timers that may lie about cancelled, as in asyncio."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


class VirtualLoop(base_events.BaseEventLoop):
    """See the module."""

    def __init__(self, runner: VirtualRunner | VirtualProcess) -> None:
        """Make the loop; `run_forever` belongs into the greenlet of its process.

        Args:
            runner: what it waits in, and whose clock it shows.
        """
        super().__init__()
        self.runner = runner
        self.time = runner.now  # type: ignore[method-assign] # [s]; asked for at every step
        self._waiter = runner.waiter()
        self._queue: deque[asyncio.Handle] = self._ready  # type: ignore[attr-defined] # where asyncio puts them
        self._timers: list[asyncio.TimerHandle] = self._scheduled  # type: ignore[attr-defined]

    def run_forever(self) -> None:
        """Run until `stop`; while it waits, other greenlets run."""
        self._check_closed()  # type: ignore[attr-defined]
        previous = events._get_running_loop()  # noqa: SLF001 # of the greenlet that is left for this one
        self._thread_id = threading.get_ident()
        events._set_running_loop(self)  # noqa: SLF001
        try:
            while True:
                self._step()
                if self._stopping:  # type: ignore[has-type]
                    break
        finally:
            self._stopping = False
            self._thread_id = None  # type: ignore[assignment] # as asyncio does
            events._set_running_loop(previous)  # noqa: SLF001

    def _step(self) -> None:
        """Do what is to be done now, as `BaseEventLoop._run_once` does; if it is nothing, wait for it."""
        queue, timers = self._queue, self._timers
        if len(timers) > MOST_CANCELLED and self._timer_cancelled_count > len(timers) / 2:
            self._tidy_up()
        while timers and timers[0].cancelled():
            self._timer_cancelled_count -= 1
            _forget(heapq.heappop(timers))
        if queue:
            if self.runner.others_wait():
                self._let_others(None, at_once=True)
        else:
            self._let_others(max(timers[0].when() - self.time(), 0.0) if timers else None)
        now = self.time() + TICK
        while timers and timers[0].when() < now:
            due = heapq.heappop(timers)
            _forget(due)
            queue.append(due)
        for _ in range(len(queue)):
            handle = queue.popleft()
            if not handle.cancelled():
                handle._run()  # noqa: SLF001

    def _tidy_up(self) -> None:
        """Forget the timers that were cancelled."""
        for handle in self._timers:
            if handle.cancelled():
                _forget(handle)
        self._timers[:] = [handle for handle in self._timers if not handle.cancelled()]
        heapq.heapify(self._timers)
        self._timer_cancelled_count = 0

    def _let_others(self, timeout: float | None, *, at_once: bool = False) -> None:
        """Let other greenlets run, until there is something to do or for `timeout` [s]."""
        events._set_running_loop(None)  # noqa: SLF001
        try:
            if at_once:
                self.runner.point()
            else:
                self._waiter.wait(timeout)
        finally:
            events._set_running_loop(self)  # noqa: SLF001

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        """Run something in a greenlet of its own."""
        del executor
        future: asyncio.Future[Any] = self.create_future()

        def settle(set_it: Callable[[Any], None], value: Any) -> None:
            if not future.done():
                set_it(value)

        def work() -> None:
            try:
                result = func(*args)
            except Exception as error:  # noqa: BLE001 # for the one who waits for it
                self._from_greenlet(settle, future.set_exception, error)
            else:
                self._from_greenlet(settle, future.set_result, result)

        self.runner.spawn(work, "executor")
        return future

    def drop(self) -> None:
        """Close the loop of a process that was ended from outside; its tasks never go on.

        Each of them is closed, which runs its `finally` blocks up to their first `await`.
        """
        self.set_exception_handler(lambda _loop, _context: None)
        previous = events._get_running_loop()  # noqa: SLF001
        events._set_running_loop(self)  # noqa: SLF001
        try:
            closed: set[asyncio.Task[Any]] = set()
            while tasks := asyncio.all_tasks(self) - closed:  # a `finally` may have made more
                closed |= tasks
                for task in tasks:
                    task._log_destroy_pending = False  # type: ignore[attr-defined] # noqa: SLF001
                    coroutine: Any = task.get_coro()
                    with contextlib.suppress(BaseException):
                        coroutine.close()
        finally:
            events._set_running_loop(previous)  # noqa: SLF001
        self._queue.clear()
        self._timers.clear()
        self._thread_id = None  # type: ignore[assignment]
        self.close()

    def _from_greenlet(self, callback: Callable[..., object], *args: Any) -> None:
        if not self.is_closed():
            self.call_soon_threadsafe(callback, *args)

    def _write_to_self(self) -> None:
        self._waiter.wake()


def _forget(handle: asyncio.TimerHandle) -> None:
    """A timer is in the heap no longer: to cancel it counts no more."""
    handle._scheduled = False  # type: ignore[attr-defined] # noqa: SLF001


def run_in_virtual_time(story: Coroutine[Any, Any, _R], seed: int = 0) -> _R:
    """Run a story to its end, and what it left behind, in no time.

    Args:
        story: what to run.
        seed: of the order in which greenlets run.

    Raises:
        RuntimeError: everybody waits, and nothing will ever happen.
    """
    runner = VirtualRunner(seed)
    try:
        with asyncio.Runner(loop_factory=lambda: VirtualLoop(runner)) as tasks:
            return tasks.run(story)
    finally:
        runner.close()


def in_virtual_time(story: Callable[_P, Coroutine[Any, Any, None]]) -> Callable[_P, None]:
    """Make a plain function, for instance a test, of a story that runs in virtual time."""

    @functools.wraps(story)
    def tell(*args: _P.args, **kwargs: _P.kwargs) -> None:
        run_in_virtual_time(story(*args, **kwargs))

    return tell
