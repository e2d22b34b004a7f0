"""Greenlets in virtual time: the form of `Runner` for the World and for tests.

One greenlet runs at any moment, until it waits, or until it comes to a point at which a thread could lose the
processor and the seed has it so (`Preemption`). Which of those that can go on is next is drawn from the seed;
event loops take their turns among them. When none can go on, time jumps to the next timer. So the same seed
gives the same order of events every time, and an hour passes in a moment. Code that blocks elsewhere than in
a waiter (`time.sleep`, a socket, a thread of its own) takes no virtual time, and an endless loop stops the
whole world.

`VirtualProcess` is the view that one simulated process has of it: with a clock of its own, and it can be
paused (as by SIGSTOP) and ended (as by SIGKILL).
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import random
import threading
from asyncio import events, tasks
from collections import deque
from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from functools import partial
from heapq import heapify, heappop, heappush
from math import inf, nextafter
from types import FrameType
from typing import Any, Protocol, cast

from greenlet import GreenletExit, getcurrent, greenlet

BEGINNING = 1_000_000_000.0
"""[s] since 1970, at which virtual time begins."""

_set_running_loop = events._set_running_loop  # noqa: SLF001 # asyncio offers no other way
_enter_task, _leave_task = tasks._enter_task, tasks._leave_task  # noqa: SLF001 # as above

STARVED = 0.3
"""Share of the threads that lose the processor and wait for some time."""

THROWS = 20
"""How often a greenlet that catches its end is ended, before it is left alone."""

MOST_SWITCHES = 1_000_000
"""Switches at one moment after which time is thought to stand still: some code wakes itself without end."""

FIRST_PID = 1000
"""Numbers of simulated processes begin above it."""

MOST_DISCARDED = 100
"""Timers that may lie about though their action was called off."""


class _Fiber(greenlet):
    """A greenlet that knows its process."""

    process: VirtualProcess | None = None
    thrown = 0
    """How often it has caught its end."""
    toils: VirtualWaiter | None = None
    """In which it waits while it computes."""


class Preemption:
    """Where a seed takes the processor from one thread and gives it to another.

    A thread can lose it at its points: when it takes or gives back a lock, before each system call, and
    before and after the journal. Nothing is drawn while `share` is 0.
    """

    def __init__(self, seed: int) -> None:
        """Begin without any."""
        self.random = random.Random(f"{seed} preemption").random
        self.share = 0.0
        """Of all points at which a thread loses the processor."""
        self.starve = 0.0
        """[s] that some of these threads wait at most for their next turn; the others wait for no time."""
        self.count = 0
        """How often it has happened."""


class Turns(Protocol):
    """Something that has to be done now and then, in the greenlet of the runner: an event loop."""

    process: VirtualProcess | None
    """To which it belongs."""
    dead: bool
    """False; as greenlets have it."""

    def switch(self) -> None:
        """Do what is to be done now."""
        ...


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
        self.preemption = Preemption(seed)
        self.struck: dict[greenlet | None, type[BaseException]] = {}
        """Exceptions to raise in threads at their next points; of None see `interrupt_running`."""
        self._struck_running_at = 0
        self.holding: dict[greenlet, VirtualLock] = {}
        """The locks for moments (`lock`) that are held."""
        self._thread = threading.get_ident()
        self._time = 0.0
        self._number = itertools.count().__next__
        self._timers: list[tuple[float, int, Callable[[], object]]] = []
        self.discarded = 0
        """Timers whose action was called off."""
        self._ready: list[greenlet | Turns] = []
        self.resume: Callable[[greenlet | Turns], None] = self._ready.append
        """Has a greenlet or an event loop go on when it is chosen."""
        self._main = getcurrent()
        self._hub = _Fiber(self._schedule)
        self._hubs: list[_Fiber] = []
        """Greenlets that have chosen before and wait to do it again."""
        self._all: dict[_Fiber, None] = {}
        self.pids = itertools.count(FIRST_PID + 1)
        """Numbers for processes."""
        self._closed = False
        self._error: BaseException | None = None
        self.turning: VirtualProcess | None = None
        """Which process has its turn."""
        self._acting = False
        """Whether an action of the agenda is under way, and nothing else."""
        self.entered: Any = None
        """The event loop that asyncio takes for the running one."""

    # -- a Runner ---------------------------------------------------------------------------------

    def now(self) -> float:
        return self._time

    def unix(self) -> float:
        return BEGINNING + self._time

    def here(self) -> int:
        return id(getcurrent())

    def lock(self) -> AbstractContextManager[object]:
        """See `Runner.lock`: it is an error to wait or to take a second one while it is held."""
        return VirtualLock(self, brief=True)

    def waiter(self) -> VirtualWaiter:
        return VirtualWaiter(self)

    def event(self) -> VirtualEvent:
        """Make what `System.event` makes."""
        return VirtualEvent(self)

    def spawn(self, work: Callable[[], None], name: str) -> None:
        self.start(work, name)

    def pid(self) -> int:
        return FIRST_PID

    def name_thread(self, name: str) -> None:
        """See `Runner.name_thread`: greenlets have no names."""

    def interrupt(self, thread: int, error: type[BaseException]) -> bool:
        """See `Runner.interrupt`: it is raised at the thread's next point, or while it computes (`toil`)."""
        if thread == self.here():
            self.struck.pop(getcurrent(), None)  # a thread has one place for it: this one replaces that
            raise error
        for one in self._all:
            if id(one) == thread:
                self.struck[one] = error
                if one.toils is not None:
                    one.toils.wake()
                return True
        return False

    def interrupt_running(self, error: type[BaseException]) -> None:
        """Raise an error at the next point of the greenlet that runs now, unless another one runs by then.

        It may be called by another thread of the operating system.
        """
        self._struck_running_at = self.switches
        self.struck[None] = error

    def stack_of(self, thread: int) -> FrameType | None:
        return next((one.gr_frame for one in self._all if id(one) == thread), None)

    # -- what only a simulation can do ------------------------------------------------------------

    def point(self) -> None:
        """Let others go on here, if the seed has it so; raise what was sent to this thread meanwhile."""
        share = self.preemption.share
        if share and self.preemption.random() < share:
            self.preempt()
        if self.struck:
            error = self.struck.pop(getcurrent(), None)
            if error is None and self.switches == self._struck_running_at:
                error = self.struck.pop(None, None)
            if error is not None:
                raise error

    def preempt(self) -> None:
        """Let others go on, perhaps for some time; not within an action of the agenda."""
        me, chosen = getcurrent(), self.preemption
        process = self.turning
        if self._closed or self._acting or me is self._main or (process is not None and process.ended):
            return
        chosen.count += 1
        if chosen.starve and chosen.random() < STARVED:
            self.at(self._time + chosen.random() * chosen.starve, partial(self.resume, me))
        else:
            self.resume(me)
        self._switch()

    def leave(self) -> None:
        """Never go on: the process of this thread has ended here."""
        while True:
            self._switch()

    @property
    def acting(self) -> bool:
        """Whether an action of the agenda is under way, which belongs to no process."""
        return self._acting

    def toil(self, seconds: float) -> None:
        """Compute for some time [s], as code does that asks nobody: only an interruption ends it early."""
        me = getcurrent()
        waiter = self.waiter()
        if isinstance(me, _Fiber):
            me.toils = waiter
            try:
                if me not in self.struck:
                    waiter.wait(seconds)
            finally:
                me.toils = None
        self.point()

    def start(self, work: Callable[[], None], name: str, process: VirtualProcess | None = None) -> greenlet:
        """Run something beside everything else, as a part of a process."""
        del name

        def run() -> None:
            try:
                work()
            except GreenletExit:
                pass
            except BaseException as error:  # noqa: BLE001 # raised where the world is run
                self._error = self._error or error
                self.resume(self._main)
            finally:
                self._all.pop(one, None)
                one.parent = self._hub

        one = _Fiber(run, parent=self._hub)
        one.process = process
        self._all[one] = None
        self.resume(one)
        return one

    def at(self, when: float, action: Callable[[], object]) -> None:
        """Do something at a virtual time [s], between two greenlets; it must not wait."""
        if when < self._time:  # noqa: PLR1730 # `max` is a call, and this is done very often
            when = self._time
        heappush(self._timers, (when, self._number(), action))

    def discard(self) -> None:
        """Note that the action of a timer was called off; it has an attribute `_cancelled` that says so."""
        self.discarded += 1
        if self.discarded > MOST_DISCARDED and 2 * self.discarded > len(self._timers):
            self._timers[:] = [timer for timer in self._timers if not getattr(timer[2], "_cancelled", False)]
            heapify(self._timers)
            self.discarded = 0

    def run(self, until: float) -> None:
        """Let time pass [s] up to a moment. Called by the greenlet that made the runner.

        Raises:
            BaseException: what a greenlet has raised and did not catch.
        """
        waiter = self.waiter()
        while self._time < until:
            waiter.wait(until - self._time)

    def close(self) -> None:
        """End all greenlets that are left; their `finally` runs, but may not wait. Nothing runs after it."""
        self._closed = True
        self._timers.clear()
        self._ready.clear()
        for one in list(self._all):
            one.parent = getcurrent()
            for _ in range(THROWS):
                if one.dead:
                    break
                with contextlib.suppress(BaseException):
                    one.throw(GreenletExit)
        self._all.clear()
        if self._hub and self._hub is not getcurrent():  # else all that its frames know would stay for ever
            self._hub.parent = getcurrent()
            self._hub.throw(GreenletExit)

    def yield_to(self, one: Turns) -> bool:
        """Whether what an action has to do may be done now, in its place, as it would be chosen next.

        The action may do nothing after it.
        """
        process = one.process
        if not self._acting or self._ready or (process is not None and process.halted):
            return False
        self._acting, self.turning = False, process
        return True

    def enter(self, loop: Any) -> None:
        """Let asyncio take an event loop for the running one, until another one is entered.

        Each change of it is a system call, so it is not taken back after each turn.
        """
        if self.entered is not loop:
            self.entered = loop
            _set_running_loop(loop)

    def outside(self) -> None:
        """Let what follows find no running event loop, as a thread of its own does."""
        self.enter(None)

    # -- inside -----------------------------------------------------------------------------------

    def switch(self) -> None:
        """Let the runner choose who goes on; returns when it is this greenlet's turn again.

        Raises:
            RuntimeError: nothing can ever happen again, or a lock is held, or the thread is another one.
            BaseException: in the main greenlet, what another one has raised.
        """
        if self.holding and getcurrent() in self.holding:
            raise RuntimeError("waits while it holds a lock")
        self._switch()

    def _switch(self) -> None:
        if threading.get_ident() != self._thread:
            raise RuntimeError("a thread of its own cannot wait in virtual time")
        if self._closed:
            self._leave()
        if getcurrent() is self._hub:
            self._wait_in_a_turn()
        else:  # also a turn that has waited before
            self._leave_to_hub()
        if self._error is not None and getcurrent() is self._main:
            error, self._error = self._error, None
            raise error

    def _leave(self) -> None:
        """End the greenlet that is at work though nothing runs any more; one that catches its end stays here.

        Raises:
            GreenletExit: always.
        """
        one = getcurrent()
        if isinstance(one, _Fiber) and one.parent is not None:
            one.thrown += 1
            if one.thrown > THROWS:
                one.thrown = 0
                one.parent.switch()
        raise GreenletExit

    def _wait_in_a_turn(self) -> None:
        """A callback of an event loop waits: another greenlet takes over the task of choosing."""
        me = self._hub
        me.process = self.turning
        self._all[me] = None
        # one that has done this task before: a new one would begin as deep as this stack is
        self._hub = self._hubs.pop() if self._hubs else _Fiber(self._schedule, self._main)
        self._leave_to_hub()

    def _leave_to_hub(self) -> None:
        """Let others run; what asyncio takes for running is the same when this goes on."""
        loop = self.entered
        if loop is None:
            self._hub.switch()
            return
        task = asyncio.current_task(loop)
        if task is not None:  # from Python 3.14 on a thread has one current task, before each loop had one
            _leave_task(loop, task)
        self.outside()
        try:
            self._hub.switch()
        finally:
            self.enter(loop)
            if task is not None:
                _enter_task(loop, task)

    def _schedule(self) -> None:
        """Choose who runs, and let time pass, for ever; what an action raises goes to the main greenlet."""
        me = cast("_Fiber", getcurrent())
        while not self._closed:
            while me is self._hub:
                try:
                    self._choose(me)
                except Exception as error:  # noqa: BLE001 # raised where the world is run
                    self._error = self._error or error
                    self._ready.append(self._main)
            me.process = None
            self._all[me] = None
            self._hubs.append(me)
            self._hub.switch()

    def _choose(self, me: greenlet) -> None:
        timers, chance, main = self._timers, self.random, self._main
        ready: list[Any] = self._ready
        moment, switches = self._time, 0
        while me is self._hub:  # else an action has waited
            while ready:
                one = ready.pop()
                if ready and (chosen := int(chance() * (len(ready) + 1))) < len(ready):
                    ready[chosen], one = one, ready[chosen]
                process: VirtualProcess | None = None if one is main else one.process
                if process is not None and process.halted:
                    process.keep(one)
                elif not one.dead:
                    switches += 1
                    self.turning = process
                    if self.entered is not None and (one is main or one.__class__ is _Fiber):
                        self.enter(None)
                    one.switch()
                    if me is not self._hub:  # a callback of an event loop has waited
                        return
            self.switches += switches
            if self._time > moment:
                moment, switches = self._time, 0
            if not timers or switches > MOST_SWITCHES:
                raise RuntimeError(
                    f"time stands still at {moment} s"
                    if timers
                    else "everybody waits, and nothing will ever happen"
                )
            self._time, _, action = heappop(timers)
            switches += 1
            self._acting = True
            action()
            self._acting = False


class VirtualProcess:
    """One simulated process: a `Runner` with a clock of its own, which can be paused and ended."""

    simulated = True

    def __init__(
        self, runner: VirtualRunner, name: str, *, skew: float = 0.0, rate: float = 1.0, offset: float = 0.0
    ) -> None:
        """Begin.

        Args:
            runner: all processes of one world have the same.
            name: for people.
            skew: [s] by which its time of day is ahead of the true one.
            rate: [s/s] of its clocks: 1.0001 runs 100 ppm fast.
            offset: [s] by which its monotonic clock is ahead of the world's.
        """
        self.runner, self.name = runner, name
        self.skew, self.rate, self.offset = skew, rate, offset
        self._pid = next(runner.pids)
        self.lock, self.random, self.here = runner.lock, runner.random, runner.here
        self.interrupt, self.name_thread = runner.interrupt, runner.name_thread
        self.stack_of = runner.stack_of
        self.exact = rate == 1.0 and offset == 0.0
        """Whether its monotonic clock is the world's."""
        if self.exact:
            self.now = runner.now  # type: ignore[method-assign] # asked for very often
        self.halted = False
        """Whether nothing of it runs at the moment."""
        self.ended = False
        self._waiting: list[greenlet | Turns] = []

    def of_world(self, when: float) -> float:
        """Return the time of the world [s] when its monotonic clock shows `when` [s], or just after it."""
        moment = (when - self.offset) / self.rate
        while moment * self.rate + self.offset < when:  # else a timer would go off before its time
            moment = nextafter(moment, inf)
        return moment

    def now(self) -> float:
        return self.runner.now() * self.rate + self.offset

    def pid(self) -> int:
        return self._pid

    def unix(self) -> float:
        return BEGINNING + self.runner.now() * self.rate + self.skew

    def waiter(self) -> VirtualWaiter:
        return VirtualWaiter(self.runner, self.rate)

    def spawn(self, work: Callable[[], None], name: str) -> None:
        if not self.ended:
            self.runner.start(work, name, self)

    def pause(self) -> None:
        """Stop everything in it, as SIGSTOP does; its clocks go on."""
        self.halted = True

    def resume(self) -> None:
        """Let a paused process go on."""
        if self.halted and not self.ended:
            self.halted = False
            waiting, self._waiting = self._waiting, []
            for one in waiting:
                self.runner.resume(one)

    def end(self) -> None:
        """End it as SIGKILL does: nothing of it ever runs again, not even a `finally`."""
        self.halted = self.ended = True

    def keep(self, one: greenlet | Turns) -> None:
        """Keep for later what was chosen while it was halted."""
        self._waiting.append(one)


class VirtualLock:
    """A lock that another thread can find taken, because its holder lost the processor."""

    __slots__ = ("_again", "_brief", "_depth", "_inner", "_waiting", "holder", "runner")

    def __init__(
        self, runner: VirtualRunner, *, brief: bool = False, again: bool = False, inner: bool = False
    ) -> None:
        """Make it.

        Args:
            runner: whose threads take it.
            brief: whether it is held for moments only: no wait and no other such lock inside.
            again: whether its holder can take it again.
            inner: whether who holds a brief lock may wait for this one.
        """
        self.runner, self._brief, self._again, self._inner = runner, brief, again, inner
        self.holder: greenlet | None = None
        self._depth = 0
        self._waiting: deque[VirtualWaiter] = deque()

    def acquire(self, blocking: bool = True) -> bool:  # noqa: FBT001, FBT002 # as `threading.Lock`
        runner, me = self.runner, getcurrent()
        if runner.preemption.share or runner.struck:  # else nothing happens at this point
            runner.point()
        if self.holder is me and self._again:
            self._depth += 1
            return True
        if self._brief and me in runner.holding:
            raise RuntimeError("takes a lock while it holds one")
        while self.holder is not None:
            if not blocking:
                return False
            if self.holder is me:
                raise RuntimeError("waits for a lock that it holds itself")
            waiter = runner.waiter()
            self._waiting.append(waiter)
            outer = runner.holding.pop(me, None) if self._inner else None
            waiter.wait(None)
            if outer is not None:
                runner.holding[me] = outer
        self.holder, self._depth = me, 1
        if self._brief:
            runner.holding[me] = self
        return True

    def release(self) -> None:
        self._depth -= 1
        if self._depth:
            return
        if self._brief:
            self.runner.holding.pop(cast("greenlet", self.holder), None)
        self.holder = None
        while self._waiting:
            self._waiting.popleft().wake()
        runner = self.runner
        if runner.preemption.share or runner.struck:
            runner.point()

    def locked(self) -> bool:
        """Whether somebody holds it."""
        return self.holder is not None

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class VirtualWaiter:
    """Puts a greenlet to sleep, in virtual time."""

    __slots__ = ("_armed", "_deadline", "_rate", "_runner", "_waiting", "_woken")

    def __init__(self, runner: VirtualRunner, rate: float = 1.0) -> None:
        """Made by the runner."""
        self._runner = runner
        self._rate = rate
        self._waiting: Any = None
        self._woken = False
        self._deadline = inf
        self._armed = inf
        """When its next timer goes off: one that is too early is set again, so that few lie about."""

    def wait(self, timeout: float | None) -> bool:
        runner = self._runner
        if not self._woken:
            self._waiting = getcurrent()
            self._deadline = inf
            if timeout is not None:
                now = runner.now()
                self._deadline = now + max(timeout, 0.0) / self._rate
                if self._deadline == now and timeout > 0:  # time passes, however little
                    self._deadline = nextafter(now, inf)
                if self._deadline < self._armed:
                    self._arm(self._deadline)
            try:
                runner.switch()
            finally:
                self._waiting = None
        woken, self._woken = self._woken, False
        return woken

    def wake(self) -> None:
        if not self._woken:
            self._woken = True
            self._go_on()

    def _arm(self, when: float) -> None:
        self._armed = when
        self._runner.at(when, self._ring)

    def _ring(self) -> None:
        now = self._runner.now()
        if self._armed <= now:
            self._armed = inf
        if self._waiting is None:
            return
        if self._deadline <= now:
            self._go_on()
        elif self._deadline < self._armed:
            self._arm(self._deadline)

    def _go_on(self) -> None:
        if self._waiting is not None:
            self._runner.resume(self._waiting)
            self._waiting = None


class VirtualEvent:
    """An event in virtual time."""

    def __init__(self, runner: VirtualRunner) -> None:
        """Begin unset."""
        self._runner = runner
        self._set = False
        self._waiting: list[VirtualWaiter] = []

    def set(self) -> None:
        """Let all go on who wait, now and later."""
        self._set = True
        for waiter in self._waiting:
            waiter.wake()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is set, `timeout` [s] at most; returns whether it is."""
        now = self._runner.now
        self._runner.point()
        end = inf if timeout is None else now() + timeout
        while not self._set and now() < end:
            waiter = self._runner.waiter()
            self._waiting.append(waiter)
            woken = waiter.wait(None if end == inf else end - now())
            self._waiting.remove(waiter)
            if not woken:
                break
        return self._set


@contextlib.contextmanager
def virtual_runner(seed: int = 0) -> Generator[VirtualRunner]:
    """A runner inside the block; all that still runs ends with it."""
    runner = VirtualRunner(seed)
    try:
        yield runner
    finally:
        runner.close()
