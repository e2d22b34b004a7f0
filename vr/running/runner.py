"""The surroundings of running code: threads, waiting, the clock, chance and locks.

`Threads` is the production form: operating system threads and the real clock. `world/virtual_runner.py` is
the other one: greenlets in virtual time, one of which runs at any moment, in an order drawn from a seed. Code
that takes these things from a `Runner` runs unchanged in both.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import random
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager, suppress
from contextvars import Context
from types import FrameType
from typing import Protocol

from robotree.files import forks

LONGEST_WAIT = 1e6
"""[s] Longest wait that an operating system lock takes."""


class Waiter(Protocol):
    """A binary semaphore: a wake before the wait is kept, and two wakes are one.

    The one who waits looks again at the condition that it waits for.
    """

    def wait(self, timeout: float | None) -> bool:
        """Wait for a wake, `timeout` seconds [s] at most; None: for ever. Returns whether it came."""
        ...

    def wake(self) -> None:
        """End the present wait, or else the next one. From any thread."""
        ...


class Runner(Protocol):
    """The seam between the code of robots and what it runs on."""

    simulated: bool
    """Whether its time is virtual: nothing may block except in a waiter."""

    def spawn(self, work: Callable[[], None], name: str) -> None:
        """Run something beside everything else; it must not raise."""
        ...

    def waiter(self) -> Waiter:
        """Make a waiter."""
        ...

    def lock(self) -> AbstractContextManager[object]:
        """Make a lock that is held for moments only: no wait and no other lock inside."""
        ...

    def now(self) -> float:
        """Return the time [s] on a monotonic clock."""
        ...

    def unix(self) -> float:
        """Return the time [s] since 1970."""
        ...

    def random(self) -> float:
        """Return a number from 0 up to but not including 1."""
        ...

    def here(self) -> int:
        """Return which thread this is."""
        ...

    def pid(self) -> int:
        """Return the number of this process, for people."""
        ...

    def name_thread(self, name: str) -> None:
        """Name this thread, for people who look at threads."""
        ...

    def interrupt(self, thread: int, error: type[BaseException]) -> bool:
        """Raise an error in a thread, between two of its bytecodes; False: a simulation, nothing happens."""
        ...

    def stack_of(self, thread: int) -> FrameType | None:
        """Return the innermost function that a thread is in; None: it has ended, or is simulated."""
        ...


class ThreadWaiter:
    """Puts a thread of the operating system to sleep."""

    __slots__ = ("_lock",)

    def __init__(self) -> None:
        """Begin without a wake."""
        self._lock = threading.Lock()
        self._lock.acquire()

    def wait(self, timeout: float | None) -> bool:
        return self._lock.acquire(timeout=-1 if timeout is None else min(max(timeout, 0.0), LONGEST_WAIT))

    def wake(self) -> None:
        if self._lock.locked():  # else a wake is kept already
            try:  # noqa: SIM105 # `suppress` takes longer than all of the rest
                self._lock.release()
            except RuntimeError:  # another thread wakes it at this moment
                pass


class Threads:
    """The production form of `Runner`."""

    simulated: bool = False
    lock = staticmethod(threading.Lock)
    now = staticmethod(time.monotonic)
    unix = staticmethod(time.time)
    random = staticmethod(random.random)
    here = staticmethod(threading.get_ident)
    pid = staticmethod(os.getpid)

    def waiter(self) -> Waiter:
        return ThreadWaiter()

    def spawn(self, work: Callable[[], None], name: str) -> None:
        """See `Runner.spawn`. The thread is a daemon: whatever it does, its process can end."""
        threading.Thread(target=work, name=name, daemon=True).start()

    def name_thread(self, name: str) -> None:
        threading.current_thread().name = name

    def interrupt(self, thread: int, error: type[BaseException]) -> bool:
        """See `Runner.interrupt` (CPython: `PyThreadState_SetAsyncExc`)."""
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(error))
        return True

    def stack_of(self, thread: int) -> FrameType | None:
        frames = sys._current_frames()  # noqa: SLF001  # pyright: ignore[reportPrivateUsage] # documented
        return frames.get(thread)


def runner_of(loop: object) -> Runner:
    """Return the runner of an event loop: a loop in virtual time names its own, others live in threads."""
    runner: Runner | None = getattr(loop, "runner", None)
    return Threads() if runner is None else runner


def soon(loop: asyncio.AbstractEventLoop, action: Callable[[], object]) -> None:
    """Have an event loop do something, not in the context of whose thread asks for it. From any thread.

    Nothing happens if the loop is closed: then nobody wants to know.
    """
    with suppress(RuntimeError):
        loop.call_soon_threadsafe(action, context=Context())


class SerialWorker:
    """Does one thing after the other, in the order in which they were submitted.

    Its thread lives only while there is something to do. Work that never ends holds up what comes after it,
    and no end of the process.
    """

    def __init__(self, runner: Runner, name: str) -> None:
        """Begin with nothing to do.

        Args:
            runner: that spawns the thread.
            name: of the thread.
        """
        self._runner, self._name = runner, name
        self._lock = runner.lock()
        self._ahead: deque[tuple[Future[bool], Callable[[], bool]]] = deque()
        self._working = False

    def submit(self, work: Callable[[], bool]) -> Future[bool]:
        """Have it done when all that was given before has ended. From any thread.

        Args:
            work: returns whether it went well; raises nothing.

        Returns:
            What it returns, once it has ended. Cancelled before it has begun, it never does.
        """
        turn: Future[bool] = Future()
        with self._lock:
            self._ahead.append((turn, work))
            idle, self._working = not self._working, True
        if idle:
            self._runner.spawn(self._work, self._name)
        return turn

    def _work(self) -> None:
        while True:
            with self._lock:
                if not self._ahead:
                    self._working = False
                    return
                turn, work = self._ahead.popleft()
            if turn.set_running_or_notify_cancel():
                turn.set_result(work())


class Interrupted(BaseException):
    """Raised inside of an author's code that did not listen; no Exception, so that few catch it."""


class InterruptibleThread:
    """A thread for an author's code, which can be interrupted even when that code asks nobody.

    It runs one function and reports how it ended. Python can raise an exception in another thread
    (`Threads.interrupt`); it arrives between two bytecodes, so a pure Python loop ends, while a call that
    never returns to Python does not. The thread is a daemon: its process can end at any time.
    """

    def __init__(
        self, work: Callable[[], object], done: Callable[[object, BaseException | None], None], *, name: str
    ) -> None:
        """Prepare; `start` begins.

        Args:
            work: what runs.
            done: told the value or the error, in the thread itself; must not raise.
            name: of the thread, for debuggers.
        """
        self._work, self._done = work, done
        self._lock = threading.Lock()
        self._inside = True
        self._thread = threading.Thread(target=self.run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def interrupt(self) -> None:
        """Raise Interrupted in the work if it still runs."""
        with self._lock:
            if self._inside:
                Threads().interrupt(self._thread.ident or 0, Interrupted)

    def run(self) -> None:
        """Do the work in the thread that calls this."""
        outcome: tuple[object, BaseException | None] | None = None
        while self._inside:  # an interruption may strike anywhere in here
            with suppress(Interrupted):
                if outcome is None:
                    outcome = (None, Interrupted())
                    outcome = self._run()
                self._leave()
        self._done(*(outcome or (None, Interrupted())))

    def _run(self) -> tuple[object, BaseException | None]:
        try:
            return self._work(), None
        except BaseException as error:  # noqa: BLE001 # the last fence around foreign code
            return None, error
        finally:
            forks.expect_parent()

    def _leave(self) -> None:
        """Let nothing strike from here on: what was raised and has not arrived arrives in the loop.

        It is not taken back by raising NULL instead: CPython 3.11 then looks for it for ever, in all threads,
        and a process that is traced or profiled makes no progress any more.
        """
        with self._lock:
            self._inside = False
        for _ in range(2):  # Python looks for what was raised whenever a loop turns
            pass
