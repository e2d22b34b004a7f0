"""An asyncio event loop in virtual time: it waits as everything else does, in a `VirtualRunner`.

Several of them, one for each simulated process, can run in one thread: each has a greenlet of its own. What a
program hands to a thread pool (`asyncio.to_thread`, `run_in_executor`) runs in a greenlet.
"""

from __future__ import annotations

import asyncio
import selectors
import threading
from asyncio import events
from collections.abc import Callable
from typing import Any

from robotree.vr.world.virtual_runner import VirtualRunner


class VirtualLoop(asyncio.SelectorEventLoop):
    """See the module."""

    def __init__(self, runner: VirtualRunner) -> None:
        """Make the loop; `run_forever` belongs into the greenlet of its process."""
        self.runner = runner
        self._waiter = runner.waiter()
        super().__init__(_Selector(self))

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
            except Exception as error:  # noqa: BLE001 # for whoever waits for it
                self.call_soon_threadsafe(settle, future.set_exception, error)
            else:
                self.call_soon_threadsafe(settle, future.set_result, result)

        self.runner.spawn(work, "executor")
        return future

    def _write_to_self(self) -> None:
        self._waiter.wake()


class _Selector(selectors.DefaultSelector):  # type: ignore[misc,valid-type,unused-ignore] # one of several
    """Watches no file: lets the runner wait instead."""

    def __init__(self, loop: VirtualLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self._loop.wait(timeout)
        return []
