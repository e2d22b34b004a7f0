"""An asyncio event loop in virtual time: it waits as everything else does, in a `VirtualRunner`.

Several of them, one for each simulated process, run in one operating system thread: each has a greenlet of
its own. What a program gives to a thread pool (`asyncio.to_thread`, `run_in_executor`) runs in a greenlet. It
watches no files: sockets, pipes and child processes of the operating system take no virtual time.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import threading
from asyncio import base_events, events
from collections.abc import Callable, Coroutine
from typing import Any, ParamSpec, TypeVar

from robotree.vr.world.virtual_runner import VirtualProcess, VirtualRunner

_P = ParamSpec("_P")
_R = TypeVar("_R")


class VirtualLoop(base_events.BaseEventLoop):
    """See the module."""

    def __init__(self, runner: VirtualRunner | VirtualProcess, boot: str = "virtual machine") -> None:
        """Make the loop; `run_forever` belongs into the greenlet of its process.

        Args:
            runner: what it waits in, and whose clock it shows.
            boot: names the simulated machine; loops on the same one have the same clock.
        """
        super().__init__()
        self.runner, self.boot = runner, boot
        self._waiter = runner.waiter()
        self._selector = _Selector(self)

    def time(self) -> float:
        """Return the virtual time [s]."""
        return self.runner.now()

    def run_forever(self) -> None:
        """Run until `stop`; while it waits, other greenlets run."""
        self._check_closed()  # type: ignore[attr-defined]
        previous = events._get_running_loop()  # noqa: SLF001 # of the greenlet that is left for this one
        self._thread_id = threading.get_ident()
        events._set_running_loop(self)  # noqa: SLF001
        try:
            while True:
                self._run_once()  # type: ignore[attr-defined]
                if self._stopping:  # type: ignore[has-type]
                    break
        finally:
            self._stopping = False
            self._thread_id = None  # type: ignore[assignment] # as asyncio does
            events._set_running_loop(previous)  # noqa: SLF001

    def wait(self, timeout: float | None) -> None:
        """Let others run until there is something to do, or for `timeout` [s]."""
        events._set_running_loop(None)  # noqa: SLF001
        try:
            if timeout is None or timeout > 0:
                self._waiter.wait(timeout)
            else:
                self.runner.point()
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
            for task in asyncio.all_tasks(self):
                task._log_destroy_pending = False  # type: ignore[attr-defined] # noqa: SLF001 # that is the point
                coroutine: Any = task.get_coro()
                with contextlib.suppress(BaseException):
                    coroutine.close()
        finally:
            events._set_running_loop(previous)  # noqa: SLF001
        self._ready.clear()  # type: ignore[attr-defined]
        self._scheduled.clear()  # type: ignore[attr-defined]
        self._thread_id = None  # type: ignore[assignment]
        self.close()

    def _from_greenlet(self, callback: Callable[..., object], *args: Any) -> None:
        if not self.is_closed():
            self.call_soon_threadsafe(callback, *args)

    def _write_to_self(self) -> None:
        self._waiter.wake()

    def _process_events(self, event_list: list[Any]) -> None:
        """There are none."""


class _Selector:
    """Watches no file: lets the runner wait instead."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[Any]:
        self._loop.wait(timeout)
        return []


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
