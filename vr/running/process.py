"""The threads of a process: workers that carry commands out, their pool, and timers.

A worker has a stack of frames, one for each robot's command (`running/frame.py`).

An interruption, an exception in a thread, is only raised while the author's code of the topmost frame is at
work (`arm`): every way from that code into this project disarms first, so it never strikes our own code.

A thread is made when it is needed and ends when it has had nothing to do for a while; there is no limit to
their number, for a limit would let robots that wait for each other wait for ever (the queues of the robots
are bounded instead). One more thread, the watchdog, does what has its time: deadlines, leases, interruptions.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar

import msgspec

from robotree.files import forks
from robotree.vr.author import context
from robotree.vr.author.context import commander_here
from robotree.vr.base.address import Address
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import RobotCore, RobotState
from robotree.vr.running.runner import Interrupted, Runner, Threads

IDLE = 2.0
"""[s] after which a thread ends that has nothing to do."""

if TYPE_CHECKING:
    import typing_extensions

    R = typing_extensions.TypeVar("R", default=Any)
    """The robots of a process, as their runtimes know each other."""
else:
    R = TypeVar("R")


class StandingFrame(Protocol):
    """A frame."""

    def stand(self) -> None:
        """Wait while its robot is about to leave; see `ice.py`."""
        ...


class Worker:
    """One pooled thread."""

    def __init__(self, process: Process[Any]) -> None:
        """Made by the process; `main` runs in the thread."""
        runner = process.runner
        self.process = process
        self.waiter = runner.waiter()
        self.top: object = None
        """The innermost frame that it carries out; None: there is none."""
        self.jobs: list[Callable[[Worker], None]] = []
        self.thread = 0
        self.dead = False
        """Whether it is abandoned."""
        self.now, self.here = runner.now, runner.here
        self.guard = runner.lock()
        """Orders interruptions with `arm` and `disarm`."""
        self._armed: object = None
        self._struck = False
        self.interrupt_next = False
        self.watched = False
        """Whether code of it that is to end is watched: see `Frame.watch`."""

    def main(self) -> None:
        """Carry out what is given, until the process closes or nothing has come for a while."""
        self.thread = self.here()
        while self.process.wait_for_job(self):
            self.jobs.pop()(self)
            if self.dead:
                return

    def wake(self) -> None:
        """Have it look again at what it waits for. From any thread."""
        if self.here() != self.thread:  # else it does not wait
            self.waiter.wake()

    # -- interruptions ----------------------------------------------------------------------------

    def arm(self, frame: StandingFrame) -> None:
        """The author's code of a frame is at work from now on."""
        if self.process.still:
            frame.stand()
        self._armed = frame

    def disarm(self) -> None:
        """Our own code is at work: nothing strikes from now on, and nothing that was sent is under way."""
        if forks.is_child:
            forks.expect_parent()
        arrived = False
        while True:
            try:
                with self.guard:
                    self._armed = None
                if self._struck and not arrived:
                    # A thread has one place for such an exception: this one replaces what is under way.
                    self.process.runner.interrupt(self.thread, Interrupted)
                    while True:
                        pass  # it arrives here
                self._struck = False
            except Interrupted:
                arrived = True
            else:
                return

    def interrupt(self) -> None:
        """Interrupt the author's code of the topmost frame, now or when it next asks us. From any thread."""
        with self.guard:
            if self._armed is not None and self._armed is self.top:
                self._struck = self.process.runner.interrupt(self.thread, Interrupted)
            else:
                self.interrupt_next = True
        self.waiter.wake()


class Journal(Protocol):
    """Where the events of robots are written, in their order, before they have consequences."""

    def append(self, robot: str, now: float, event: CoreEvent) -> None:
        """Take an event; never blocks.

        Args:
            robot: key of its address.
            now: [s] on the robot's clock: an input of the machine as much as the event is.
            event: as handled, not refused.
        """
        ...

    def commit(self) -> None:
        """Wait until all events that were taken would survive the process, or what follows waits for it."""
        ...


class Process(Generic[R]):
    """See the module. Every method may be called from any thread."""

    def __init__(
        self,
        runner: Runner | None = None,
        journal: Journal | None = None,
        core: Callable[[RobotState], RobotCore] = RobotCore,
    ) -> None:
        """Begin without a thread.

        Args:
            runner: what threads and time are; None: the operating system's.
            journal: where the events of its robots are written; None: nowhere.
            core: makes the machine of a robot, from its state.
        """
        hand_on()
        forks.owns(self)
        self.runner: Runner = Threads() if runner is None else runner
        self.core = core
        self.journal = journal
        self.life = 1
        """How often a process was started with this journal."""
        self.returns = 0.0
        """[s] in which its robots come back after a crash; 0: they do not."""
        self.gap = 0.0
        """[s] for which its robots were away, before it was started."""
        self.keeps_steps = False
        """Whether the journal also takes what the steps of commands give, so that they can go on."""
        self.sync: Callable[[], None] = lambda: None
        """Waits until what the journal has taken would survive a loss of power."""
        self.robots: dict[Address, R] = {}
        """The robots that live here."""
        self.on_raise: Callable[[str, BaseException], None] = lambda _robot, _error: None
        """Told what the commands of each robot raise, as it was raised: over the wire go only words."""
        self.closed = False
        self.still = 0
        """How many robots of it are about to leave, or have left code behind that has not ended."""
        self._idle: list[Worker] = []
        self._lent: dict[int, Worker] = {}
        """The workers of threads that are not workers' own, by thread: see `carry_out`."""
        self._lock = self.runner.lock()
        self._numbers = itertools.count()
        self._timers: list[_Timer] = []
        self._bell = self.runner.waiter()
        self._watching = False

    @property
    def kept_life(self) -> int:
        """How often it was started with the journal by which its robots come back; 0: they do not."""
        return self.life if self.returns else 0

    def in_child(self) -> Iterable[int]:
        """See `forks.Owner`: in a child no command runs."""
        context.in_child(forks.expect_parent)
        return ()

    def close(self) -> None:
        """End the threads that wait; one that runs an author's code ends with that."""
        self.closed = True
        while self._idle:
            self._idle.pop().waiter.wake()
        self._bell.wake()

    # -- work -------------------------------------------------------------------------------------

    def work(self, job: Callable[[Worker], None]) -> None:
        """Have something done by a worker; it must not raise."""
        try:
            worker = self._idle.pop()  # atomic
        except IndexError:
            worker = Worker(self)
            worker.jobs.append(job)
            self.runner.spawn(worker.main, "robot worker")
        else:
            worker.jobs.append(job)
            worker.waiter.wake()

    def carry_out(self, job: Callable[[Worker], None]) -> bool:
        """Do something in this thread, which is not a worker's; returns whether it can still be used."""
        here = self.runner.here()
        worker = self._lent.get(here)
        if worker is None:
            worker = self._lent[here] = Worker(self)
            worker.thread = here
        job(worker)
        if worker.dead:
            del self._lent[here]
        return not worker.dead

    def wait_for_job(self, worker: Worker) -> bool:
        """Wait in a worker's thread until it has something to do; False: it is to end."""
        if worker.jobs:
            return True
        self._idle.append(worker)
        while not worker.jobs:
            if self.closed:
                return False
            if not worker.waiter.wait(IDLE) and not worker.jobs:
                try:
                    self._idle.remove(worker)
                except ValueError:
                    continue  # something is just being given to it
                return False
        return True

    # -- time -------------------------------------------------------------------------------------

    def at(self, when: float, action: Callable[[], None]) -> Callable[[], None]:
        """Do something at a time [s] of the runner's clock, in the watchdog's thread; it must not block.

        Returns:
            How to have it not done.
        """
        timer = _Timer(when, next(self._numbers), action)
        with self._lock:
            if self.closed:
                return timer.cancel
            earliest = not self._timers or timer < self._timers[0]
            heapq.heappush(self._timers, timer)
            spawn, self._watching = not self._watching, True
        if spawn:
            self.runner.spawn(self._watch, "robot watchdog")
        elif earliest:
            self._bell.wake()
        return timer.cancel

    def _watch(self) -> None:
        idle_until = self.runner.now() + IDLE
        while True:
            now = self.runner.now()
            with self._lock:
                timers = self._timers
                while timers and timers[0].cancelled:
                    heapq.heappop(timers)
                if self.closed or (not timers and now >= idle_until):
                    self._watching = False
                    return
                due = heapq.heappop(timers) if timers and timers[0].when <= now else None
                wait = timers[0].when - now if timers else idle_until - now
            if due is not None:
                due.action()
                idle_until = now + IDLE
            else:
                self._bell.wait(wait)


class _Timer(msgspec.Struct, order=True):
    """Something to be done at a time; timers are compared by the time, then by their number."""

    when: float
    number: int
    action: Callable[[], None]
    cancelled: bool = False

    def cancel(self) -> None:
        """Have it not done."""
        self.cancelled = True


_submit = ThreadPoolExecutor.submit


def hand_on() -> None:
    """Have thread pools work for the command that gives them work, as if it called the function itself.

    Python hands the context of a thread on to `asyncio.to_thread`, but not to `concurrent.futures`: without
    this, a function that a page gives to a `ThreadPoolExecutor` could not call a child. What it calls has
    keys that follow from the order in which the work was given, not from which thread is quicker.

    In a simulation no thread can wait in virtual time: there the work is done at once, in the order in which
    it is given. Twice is once.
    """
    ThreadPoolExecutor.submit = _hand_on  # type: ignore[assignment, method-assign] # there is no hook


def _hand_on(
    pool: ThreadPoolExecutor, work: Callable[..., Any], /, *values: Any, **arguments: Any
) -> Future[Any]:
    commander = commander_here()
    if commander is None:
        return _submit(pool, work, *values, **arguments)
    run = commander.handed_on(work)
    if not commander.simulated:
        return _submit(pool, run, *values, **arguments)
    future: Future[Any] = Future()
    try:
        future.set_result(run(*values, **arguments))
    except Exception as error:  # noqa: BLE001 # raised where the result is asked for
        future.set_exception(error)
    return future
