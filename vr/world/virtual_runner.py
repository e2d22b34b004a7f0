"""Greenlets in virtual time: the form of `Runner` for the World and for tests.

One greenlet runs at any moment, until it waits. Which of those that can go on is next is drawn from the seed;
when none can, time jumps to the next timer. So the same seed gives the same order of events every time, and
an hour passes in a moment. Code that blocks elsewhere than in a waiter (`time.sleep`, a socket, a thread of
its own) takes no virtual time, and an endless loop stops the whole world.
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import random
import threading
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from typing import Any

from greenlet import GreenletExit, getcurrent, greenlet

BEGINNING = 1_000_000_000.0
"""[s] since 1970, at which virtual time begins."""

THROWS = 20
"""How often a greenlet that catches its end is ended, before it is left alone."""


class VirtualRunner:
    """See the module. It belongs to the thread and the greenlet that made it."""

    simulated = True

    def __init__(self, seed: int = 0) -> None:
        """Begin at time 0.

        Args:
            seed: of the order in which greenlets run, and of `random`.
        """
        self.chance = random.Random(seed)
        self.random = self.chance.random
        self.switches = 0
        """How often the runner has let a greenlet run."""
        self.held = 0
        """Locks that are held at the moment: 0 or 1."""
        self._thread = threading.get_ident()
        self._time = 0.0
        self._order = itertools.count()
        self._timers: list[tuple[float, int, Callable[[], None]]] = []
        self._ready: list[greenlet] = []
        self._main = getcurrent()
        self._hub = greenlet(self._schedule)
        self._all: set[greenlet] = set()
        self._ended: set[greenlet] = set()
        """Greenlets that never run again, though they have not finished: those of a crashed process."""
        self._error: BaseException | None = None

    # -- a Runner ---------------------------------------------------------------------------------

    def now(self) -> float:
        """See `Runner.now`."""
        return self._time

    def unix(self) -> float:
        """See `Runner.unix`."""
        return BEGINNING + self._time

    def here(self) -> int:
        """See `Runner.here`."""
        return id(getcurrent())

    def lock(self) -> AbstractContextManager[object]:
        """See `Runner.lock`: nothing else runs meanwhile, and it is an error to wait or to lock twice."""
        return _VirtualLock(self)

    def waiter(self) -> VirtualWaiter:
        """See `Runner.waiter`."""
        return VirtualWaiter(self)

    def spawn(self, work: Callable[[], None], name: str) -> None:
        """See `Runner.spawn`."""
        self.start(work, name)

    def interrupt(self, thread: int, error: type[BaseException]) -> None:
        """See `Runner.interrupt`: nobody computes without end here."""

    # -- what only a simulation can do ------------------------------------------------------------

    def start(self, work: Callable[[], None], name: str) -> greenlet:
        """Run something beside everything else; the greenlet can be ended by `end`."""
        del name

        def run() -> None:
            try:
                work()
            except GreenletExit:
                pass
            except BaseException as error:  # noqa: BLE001 # whoever runs the world has to hear of it
                self._error = self._error or error
                self.resume(self._main)
            finally:
                self._all.discard(one)

        one = greenlet(run, parent=self._hub)
        self._all.add(one)
        self.resume(one)
        return one

    def end(self, greenlets: set[greenlet]) -> None:
        """Never let these run again, as when their process is killed: not even their `finally` runs."""
        self._ended |= greenlets

    def at(self, when: float, action: Callable[[], None]) -> None:
        """Do something at a virtual time [s], between two greenlets; it must not wait."""
        heapq.heappush(self._timers, (max(when, self._time), next(self._order), action))

    def point(self) -> None:
        """Let others go first, perhaps."""
        if self._ready and not self.held:
            self.resume(getcurrent())
            self.switch()

    def run(self, until: float) -> None:
        """Let time pass [s] up to a moment. Called by the greenlet that made the runner."""
        waiter = self.waiter()
        while self._time < until:
            waiter.wait(until - self._time)

    def close(self) -> None:
        """End all greenlets that are left; their `finally` runs, those of crashed processes excepted."""
        for one in list(self._all - self._ended):
            for _ in range(THROWS):
                if one.dead:
                    break
                with contextlib.suppress(BaseException):
                    one.throw(GreenletExit)

    # -- inside -----------------------------------------------------------------------------------

    def switch(self) -> None:
        """Let the runner choose who goes on; returns when it is this greenlet's turn again.

        Raises:
            RuntimeError: nothing can ever happen again, or a lock is held, or the thread is another one.
            BaseException: in the main greenlet, what another one has raised.
        """
        if self.held:
            raise RuntimeError("waits while it holds a lock")
        if threading.get_ident() != self._thread:
            raise RuntimeError("a thread of its own cannot wait in virtual time")
        self._hub.switch()
        if self._error is not None and getcurrent() is self._main:
            error, self._error = self._error, None
            raise error

    def resume(self, one: greenlet) -> None:
        """Have a greenlet go on when it is chosen."""
        self._ready.append(one)

    def _schedule(self) -> None:
        ready = self._ready
        while True:
            while ready:
                chosen = int(self.random() * len(ready)) if len(ready) > 1 else 0
                ready[chosen], ready[-1] = ready[-1], ready[chosen]
                one = ready.pop()
                if not one.dead and one not in self._ended:
                    self.switches += 1
                    one.switch()
            if self._timers:
                self._time, _, action = heapq.heappop(self._timers)
                action()
            else:
                self._error = RuntimeError("everybody waits, and nothing will ever happen")
                ready.append(self._main)


class _VirtualLock:
    """Nothing else runs between two waits, so this only checks that nobody waits while holding it."""

    __slots__ = ("_runner",)

    def __init__(self, runner: VirtualRunner) -> None:
        self._runner = runner

    def __enter__(self) -> None:
        if self._runner.held:
            raise RuntimeError("takes a lock while it holds one")
        self._runner.held = 1

    def __exit__(self, *_: object) -> None:
        self._runner.held = 0


class VirtualWaiter:
    """See `runner.Waiter`."""

    __slots__ = ("_number", "_runner", "_waiting", "_woken")

    def __init__(self, runner: VirtualRunner) -> None:
        """Made by the runner."""
        self._runner = runner
        self._waiting: Any = None
        self._woken = False
        self._number = 0
        """Of the present wait: a timer of an earlier one does nothing."""

    def wait(self, timeout: float | None) -> bool:
        """See `Waiter.wait`."""
        runner = self._runner
        if not self._woken:
            self._waiting = getcurrent()
            self._number += 1
            number = self._number
            if timeout is not None:
                runner.at(runner.now() + max(timeout, 0.0), lambda: self._time_out(number))
            try:
                runner.switch()
            finally:
                self._waiting = None
        woken, self._woken = self._woken, False
        return woken

    def wake(self) -> None:
        """See `Waiter.wake`."""
        if not self._woken:
            self._woken = True
            self._go_on()

    def _time_out(self, number: int) -> None:
        if number == self._number:
            self._go_on()

    def _go_on(self) -> None:
        if self._waiting is not None:
            self._runner.resume(self._waiting)
            self._waiting = None
            self._number += 1


@contextlib.contextmanager
def virtual_runner(seed: int = 0) -> Generator[VirtualRunner]:
    """A runner inside the block; all that still runs ends with it."""
    runner = VirtualRunner(seed)
    try:
        yield runner
    finally:
        runner.close()
