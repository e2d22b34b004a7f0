"""The threads of a process: workers that carry commands out, their pool, and timers.

A worker has a stack of frames, one for each robot's command. A parent's command that calls a child in the
same process carries the child's command out on its own worker, as one more frame, when the child is idle;
else it waits for its turn or for a worker of the child's own. A worker blocks in one place only
(`Worker.wait`), where a cancel, a deadline and the result that is waited for wake it.

Code that does not listen to a cancel is interrupted: an exception is raised in its thread. That is only done
while the author's code of the topmost frame is at work (`arm`): every way from that code into this project
disarms first, so an interruption never strikes our own code. What is not interrupted in the end is abandoned,
with all frames of its worker: those frames reach no child any more.

A thread is made when it is needed and ends when it has had nothing to do for a while; there is no limit to
their number, for a limit would let robots that wait for each other wait for ever (the queues of the robots
are bounded instead). One more thread, the watchdog, does what has its time: deadlines, leases, interruptions.
"""

from __future__ import annotations

import contextlib
import contextvars
import functools
import heapq
import itertools
import math
from collections.abc import Callable, Generator, Mapping
from types import FrameType
from typing import Any, Literal, Protocol, TypeVar

import msgspec

from robotree.vr.address import Address
from robotree.vr.context import CommandContext, enter
from robotree.vr.core.events import Event
from robotree.vr.core.machine import RobotCore, State
from robotree.vr.errors import CommandCancelled, CommandFailed, VrError
from robotree.vr.requests import LONGEST_CLEANUP, Level
from robotree.vr.running.interruptible import Interrupted
from robotree.vr.running.pools import hand_on
from robotree.vr.running.runner import Runner, Threads
from robotree.vr.running.together import Group, Part, Started

GRACE = 1.0
"""[s] between a cancel and the interruption of code that does not listen, and between two interruptions."""
ATTEMPTS = 3
"""Interruptions before the code is abandoned."""
LONGEST_END = GRACE * (ATTEMPTS + 1)
"""[s] from a cancel to the moment when its command has ended or is known not to end."""
IDLE = 2.0
"""[s] after which a thread ends that has nothing to do."""
DEEPEST = 32
"""Frames on one worker; a call below that is handed to another one."""
PAUSE = 0.01
"""[s] that a command waits which swallows the error that should end it: it must not spin."""

_T = TypeVar("_T")

Manner = Literal["awaited", "started", "told", "passed on"]
"""How a command calls a child. awaited: it waits for the end, so its worker may carry the child's command
out. started: it goes on meanwhile. told: it waits until the child has accepted it. passed on: it waits, and
the progress of the child is its own."""


class Caller(Protocol):
    """The robot of a running command, as the command needs it."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    def call_child(
        self,
        frame: Frame,
        slot: str,
        command: str,
        arguments: Mapping[str, Any],
        manner: Manner,
        *,
        instead: str = "",
    ) -> Started:
        """Call the child in a slot, as one step of the command."""
        ...

    def note(self, key: str, fraction: float, text: str) -> None:
        """Take how far the command is."""
        ...

    def say(self, key: str, level: Level, text: str, *, piece: bool) -> None:
        """Take what the command says."""
        ...

    def note_child(self, key: str, child: str, text: str) -> None:
        """Take what a child of the command says of its progress."""
        ...

    def cancel(self, key: str, reason: str, *, final: bool = False) -> None:
        """End the command in the name of its caller."""
        ...

    def abandon(self, key: str, at: FrameType | None) -> None:
        """Give the command's code up; `at` is what its thread carries out."""
        ...

    def gone(self, key: str) -> None:
        """The command's code, which was given up, has ended."""
        ...

    def pass_time(self) -> None:
        """Have what is due end."""
        ...

    def meant(self, slot: str, error: VrError) -> VrError:
        """Return what the error of a call of a child means to the command."""
        ...


class Abandoned(BaseException):
    """Raised in an author's code that was given up, whatever it still tries."""


class Frame:
    """One running command, or a part of it that runs beside it. It is the `Activity` that its code sees."""

    cause: VrError | None = None
    """Why it was asked to end."""
    final: bool = False
    """Whether not even a clean-up may command children any more: see `core.machine.AcceptedCall.final`."""
    raised: int = 0
    """How often it was told."""
    steps: int = 0
    """How many steps it has taken: each has the path key `key/step`."""
    shield: float = -math.inf
    """[s] Until when a clean-up may go on though the command was asked to end."""
    group: Group | None = None
    """The innermost open group: what is started belongs to it."""
    over: bool = False
    """Whether its code has ended."""
    guest: bool = False
    """Whether it is a thread of the author's own that works for a command."""

    def __init__(self, live: Caller, context: CommandContext, worker: Worker, call_key: str = "") -> None:
        """Made by the robot when the command begins.

        Args:
            live: the robot.
            context: of the command.
            worker: that carries it out.
            call_key: key of the robot's call, for a part of a command that has a key of its own.
        """
        self.live, self.context, self.worker = live, context, worker
        self.call_key = call_key or context.key
        self.deadline_at = context.deadline_at
        """[s] When what it does now must be done."""
        self.started: list[Started] = []
        """What it has started and what may go on beside it."""
        self.guests: dict[int, Frame] = {}
        """Threads that work for it."""

    @property
    def cancelled(self) -> bool:
        """See `Activity.cancelled`."""
        return self.cause is not None

    @property
    def simulated(self) -> bool:
        """See `Activity.simulated`."""
        return self.worker.process.runner.simulated

    def is_here(self) -> bool:
        """See `Activity.is_here`."""
        here = self.worker.here()
        return here == self.worker.thread or here in self.guests

    def in_this_thread(self) -> Frame:
        """See `Activity.in_this_thread`."""
        here = self.worker.here()
        if here == self.worker.thread:
            return self
        with self.worker.guard:
            guest = self.guests.get(here)
            if guest is None:
                guest = self.part(f"t{len(self.guests) + 1}", Worker(self.worker.process), guest=True)
                guest.worker.thread = here
                self.guests[here] = guest
        return guest

    def handed_on(self, work: Callable[..., _T]) -> Callable[..., _T]:
        """See `Activity.handed_on`."""
        frame = self.in_this_thread()
        frame.steps += 1
        guest = frame.part(str(frame.steps), Worker(self.worker.process), guest=True)
        frame.guests[-frame.steps] = guest

        def run(*values: Any, **arguments: Any) -> _T:
            guest.worker.thread = guest.worker.here()
            context = contextvars.copy_context()
            context.run(enter, guest)
            return context.run(work, *values, **arguments)

        return run

    def part(self, number: str, worker: Worker, *, guest: bool = False) -> Frame:
        """Return a part of this command that runs on another worker; its keys begin with ours."""
        context = msgspec.structs.replace(self.context, key=f"{self.context.key}/{number}")
        part = Frame(self.live, context, worker, self.call_key)
        part.guest, part.final = guest, self.final
        part.deadline_at, part.shield = self.deadline_at, self.shield
        part.cause = self._ended() if self.over else self.cause
        if guest:
            worker.stack.append(part)
        return part

    def _ended(self) -> CommandCancelled:
        reason = "the command for which this thread works has ended"
        return CommandCancelled(robot=self.live.name, command=self.context.command, reason=reason)

    def check(self) -> None:
        """See `Activity.check`."""
        worker = self._leave_author()
        worker.arm(self)

    def sleep(self, seconds: float) -> None:
        """See `Activity.sleep`."""
        if math.isnan(seconds):
            raise ValueError("cannot sleep for NaN seconds")
        self.wait_for(_never, seconds)

    def now(self) -> float:
        """See `Activity.now`."""
        return self.worker.process.runner.now()

    def random(self) -> float:
        """See `Activity.random`."""
        return self.worker.process.runner.random()

    def wait_for(self, condition: Callable[[], bool], timeout: float = math.inf) -> bool:
        """See `Activity.wait_for`."""
        worker = self._leave_author()
        try:
            self.step()
            return worker.wait(self, condition, timeout)
        finally:
            worker.arm(self)

    def wake(self) -> None:
        """See `Activity.wake`."""
        worker = self.worker
        if worker.here() != worker.thread:  # else it does not wait
            worker.waiter.wake()

    def progress(self, fraction: float, text: str) -> None:
        """See `Activity.progress`."""
        worker = self._leave_author()
        try:
            self.live.note(self.call_key, float(fraction), str(text))
        finally:
            worker.arm(self)

    def observe(self, look: Callable[[], Any]) -> Any:
        """See `Activity.observe`."""
        worker = self._leave_author()
        try:
            self.step()
            return look()
        finally:
            worker.arm(self)

    def keep(self, change: Callable[[], None]) -> None:
        """See `Activity.keep`."""
        worker = self.worker
        if worker.here() != worker.thread:  # a thread that the command was handed on to
            change()
            return
        worker.disarm()
        try:
            if worker.dead:
                worker.check(self)
            change()
        finally:
            worker.arm(self)

    def say(self, level: Level, text: str, *, piece: bool = False) -> None:
        """See `Activity.say`."""
        self.keep(lambda: self.live.say(self.context.key, level, text, piece=piece))

    def call(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Any:
        """See `Activity.call`."""
        worker = self._leave_author()
        try:
            manner: Manner = "started" if self.guest else "awaited"
            return self.live.call_child(self, slot, command, arguments, manner).get()
        finally:
            worker.arm(self)

    def pass_on(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Any:
        """Carry out an exposed command: call the child's, and tell its progress as our own."""
        worker = self._leave_author()
        try:
            return self.live.call_child(self, slot, command, arguments, "passed on").get()
        finally:
            worker.arm(self)

    def start(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Started:
        """See `Activity.start`."""
        worker = self._leave_author()
        try:
            group = self.group
            decided = "" if group is None else group.decided
            pending = self.live.call_child(self, slot, command, arguments, "started", instead=decided)
            self._keep(pending)
            return pending
        finally:
            worker.arm(self)

    def _keep(self, started: Started) -> None:
        self.started.append(started)
        if self.group is not None:
            self.group.add(started)
        if self.over:  # it was the last act of a thread that worked for the command
            started.drop("the command that started it has ended")

    def tell(self, slot: str, command: str, arguments: Mapping[str, Any]) -> None:
        """See `Activity.tell`."""
        worker = self._leave_author()
        try:
            self.live.call_child(self, slot, command, arguments, "told").wait_until_accepted()
        finally:
            worker.arm(self)

    # -- several at once --------------------------------------------------------------------------

    def together(self, *, first: bool) -> Group:
        """See `Activity.together`."""
        return Group(self, first=first)

    def open_group(self, group: Group) -> None:
        """What is started from now on belongs to a group."""
        worker = self._leave_author()
        group.outer, self.group = self.group, group
        worker.arm(self)

    def branch(self, work: Callable[[], Any]) -> Started:
        """Carry out a part of the command on another worker, in the innermost group."""
        worker = self._leave_author()
        try:
            self.steps += 1
            branch = Branch(self, str(self.steps), work)
            if self.group is not None and self.group.decided:
                branch.drop(self.group.decided)
                branch.at_rest = True
            else:
                worker.process.work(branch.run)
            self._keep(branch)
            return branch
        finally:
            worker.arm(self)

    def close_group(self, group: Group, error: BaseException | None) -> None:
        """Wait until all of a group have ended, or it is decided; end what still runs.

        Raises:
            VrError: the first failure of the group, or what has ended the command.
        """
        worker = self.worker
        worker.disarm()
        try:
            if error is None:
                worker.wait(self, group.is_over)
                group.take_results()
        finally:
            self.group = group.outer
            for part in group.parts:
                part.drop("the others were ended with it")
            while not all(part.at_rest for part in group.parts):
                worker.waiter.wait(None)
            worker.arm(self)

    # -- clean-up ---------------------------------------------------------------------------------

    @contextlib.contextmanager
    def cleanup(self, within: float) -> Generator[None]:
        """See `Activity.cleanup`."""
        if not 0 < within <= LONGEST_CLEANUP:
            raise ValueError(
                f"a clean-up takes more than 0 and at most {LONGEST_CLEANUP:g} s, not {within} s"
            )
        worker, before = self.worker, (self.shield, self.deadline_at, self.group)
        worker.disarm()
        try:
            self._begin_cleanup(within)
        finally:
            worker.arm(self)
        try:
            yield
        finally:
            worker.disarm()
            shield, self.deadline_at, self.group = before
            self.shield = -math.inf if self.final else shield
            worker.arm(self)

    def _begin_cleanup(self, within: float) -> None:
        """End what the command has started; let nothing but a final order end it for a while.

        Raises:
            CommandCancelled: it was ended so that no clean-up is allowed.
        """
        if self.worker.dead:
            raise Abandoned
        if self.final:
            assert self.cause is not None  # noqa: S101 # it was asked to end
            reason = f"{self.cause.data.get('reason', self.cause)}; after that no clean-up may move anything"
            raise CommandCancelled(robot=self.live.name, command=self.context.command, reason=reason)
        for started in tuple(self.started):
            started.drop("the clean-up of the command that started it has begun")
        until = self.now() + within
        self.shield = min(until, self.shield) if self.shield > -math.inf else until
        self.deadline_at, self.group = self.shield, None

    # -- for the worker ---------------------------------------------------------------------------

    def result_of(self, pending: Started, timeout: float) -> Any:
        """Wait for a call that was started; return its result."""
        worker = self._leave_author()
        try:
            return pending.get(timeout)
        finally:
            worker.arm(self)

    def detach(self, pending: Started) -> None:
        """Let what was started go on after the command, as soon as the child has accepted it."""
        worker = self._leave_author()
        try:
            pending.wait_until_accepted()
            pending.let_go()
            with contextlib.suppress(ValueError):
                self.started.remove(pending)
            if self.group is not None:
                self.group.leave(pending)
        finally:
            worker.arm(self)

    def step(self) -> str:
        """Take one more step; returns its path key."""
        self.steps += 1
        return f"{self.context.key}/{self.steps}"

    def cancel(self, cause: VrError, *, final: bool = False) -> None:
        """Have it end. From any thread; the frames above it are told by the robots that they belong to."""
        self.cause = cause
        if final:
            self.final, self.shield = True, -math.inf
        worker = self.worker
        for started in tuple(self.started):
            started.end_with(cause, final=final)
        for guest in tuple(self.guests.values()):
            guest.cancel(cause, final=final)
        if self.shield <= self.now():
            stack = worker.stack
            above = stack[stack.index(self) + 1 :] if self in stack else []
            for frame in above:
                frame.live.cancel(frame.call_key, "its caller was ended", final=final)
        worker.waiter.wake()
        if not self.guest:
            worker.process.watch(self)

    def end(self) -> None:
        """Its code has ended: end what it has started and not detached."""
        self.over = True
        for guest in tuple(self.guests.values()):
            guest.cancel(self._ended(), final=True)
            guest.end()
        for started in self.started:
            started.drop("the command that started it has ended")

    def _leave_author(self) -> Worker:
        """Come from the author's code into ours.

        Raises:
            VrError: the command has been asked to end.
        """
        worker = self.worker
        worker.disarm()
        try:
            worker.check(self)
        except BaseException:
            worker.arm(self)
            raise
        return worker


class Branch(Part):
    """A part of a command that runs on another worker: a function that `both.start(function)` has started."""

    def __init__(self, owner: Frame, number: str, work: Callable[[], Any]) -> None:
        """Made by the frame of the command; `run` is for a worker."""
        self._tell = []
        self._owner, self._number, self._work = owner, number, work
        self._frame: Frame | None = None
        self._dropped: CommandCancelled | None = None
        self._value: Any = None
        self._error: BaseException | None = None
        self.at_rest = False

    def run(self, worker: Worker) -> None:
        """Carry it out."""
        owner = self._owner
        frame = self._frame = owner.part(self._number, worker)
        if self._dropped is not None:
            frame.cause = self._dropped
        self._value, self._error = worker.run(frame, self._work)
        frame.end()
        if worker.dead:
            owner.live.gone(owner.call_key)
        self._end()

    def _end(self) -> None:
        self.at_rest = True
        self.tell_all()
        self._owner.wake()

    @property
    def done(self) -> bool:
        """See `CallFuture.done`."""
        return self.at_rest or self._dropped is not None

    @property
    def progress(self) -> float:
        """See `CallFuture.progress`."""
        return math.nan

    def error(self) -> BaseException | None:
        """See `Part.error`."""
        return self._dropped or self._error

    def result(self, timeout: float | None = None) -> Any:
        """See `CallFuture.result`."""
        return self._owner.in_this_thread().result_of(self, math.inf if timeout is None else timeout)

    def get(self, timeout: float = math.inf) -> Any:
        """See `Part.get`."""
        owner = self._owner
        if not owner.worker.wait(owner, lambda: self.done, timeout):
            raise TimeoutError
        error = self.error()
        if error is not None:
            raise error
        return self._value

    def wait_until_accepted(self) -> None:
        """See `Part.wait_until_accepted`."""

    def let_go(self) -> None:
        """See `Part.let_go`."""
        raise TypeError("a function of this page ends with its command; only a child's command can go on")

    def drop(self, reason: str) -> None:
        """See `Part.drop`."""
        if self.done:
            return
        owner = self._owner
        self._dropped = CommandCancelled(robot=owner.live.name, command=owner.context.command, reason=reason)
        if self._frame is not None:
            self._frame.cancel(self._dropped)

    def cancel(self) -> None:
        """See `CallFuture.cancel`."""
        if not self.done:
            self.called_off = True
            self.drop("its caller has cancelled it")

    def detach(self) -> Branch:
        """See `CallFuture.detach`."""
        self.let_go()
        return self

    def end_with(self, cause: VrError, *, final: bool) -> None:
        """See `Part.end_with`."""
        if self._frame is not None and not self.at_rest:
            self._frame.cancel(cause, final=final)


class Worker:
    """One pooled thread."""

    def __init__(self, process: Process) -> None:
        """Made by the process; `main` runs in the thread."""
        runner = process.runner
        self.process = process
        self.waiter = runner.waiter()
        self.stack: list[Frame] = []
        self.jobs: list[Callable[[Worker], None]] = []
        self.thread = 0
        self.dead = False
        """Whether it is abandoned."""
        self._now, self.here = runner.now, runner.here
        self.guard = runner.lock()
        """Orders interruptions with `arm` and `disarm`."""
        self._armed: Frame | None = None
        self._struck = False
        self._interrupt_next = False

    def main(self) -> None:
        """Carry out what is given, until the process closes or nothing has come for a while."""
        self.thread = self.here()
        while self.process.wait_for_job(self):
            self.jobs.pop()(self)
            if self.dead:
                return

    # -- interruptions ----------------------------------------------------------------------------

    def arm(self, frame: Frame) -> None:
        """The author's code of a frame is at work from now on."""
        self._armed = frame

    def disarm(self) -> None:
        """Our own code is at work: nothing strikes from now on, and nothing that was sent is under way."""
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
            if self._armed is not None and self.stack and self._armed is self.stack[-1]:
                self._struck = self.process.runner.interrupt(self.thread, Interrupted)
            else:
                self._interrupt_next = True
        self.waiter.wake()

    # -- one frame --------------------------------------------------------------------------------

    def run(self, frame: Frame, work: Callable[[], Any]) -> tuple[Any, BaseException | None]:
        """Carry out a command on top of what is there; returns its value or its error."""
        outcome: tuple[Any, BaseException | None] | None = None
        self.stack.append(frame)
        while True:
            try:
                if outcome is None:
                    outcome = (None, Interrupted())
                    try:
                        if frame.cause is not None and frame.shield <= self._now():
                            outcome = (None, frame.cause)
                        else:
                            context = contextvars.Context()
                            context.run(enter, frame)
                            self.arm(frame)
                            outcome = (context.run(work), None)
                    except BaseException as error:  # noqa: BLE001 # the boundary to foreign code
                        outcome = (None, error)
                self.disarm()
            except Interrupted:
                continue
            break
        self.stack.pop()
        return outcome

    # -- what is blocked, blocks here and nowhere else --------------------------------------------

    def check(self, frame: Frame) -> None:
        """Raise what ends a frame, if it is to end.

        Raises:
            VrError: it was asked to end.
            Interrupted: it was, and did not.
            Abandoned: it was given up.
        """
        if self.dead:
            if frame.raised:  # it swallows everything
                self.waiter.wait(PAUSE)
            frame.raised += 1
            raise Abandoned
        now = self._now()
        if frame.deadline_at > now and frame.cause is None and frame.group is None:
            return
        if now >= frame.shield:
            self._end(frame, now)

    def _end(self, frame: Frame, now: float) -> None:
        """Raise what ends a frame, if it is to end and no clean-up is under way."""
        if frame.shield > -math.inf:
            self._refuse_late_cleanup(frame)
        if frame.cause is None and frame.deadline_at <= now:
            frame.live.pass_time()
        if frame.cause is not None:
            if self._interrupt_next:
                self._interrupt_next = False
                raise Interrupted
            if frame.raised:
                self.waiter.wait(PAUSE)
            frame.raised += 1
            raise type(frame.cause)(**frame.cause.data)
        if frame.group is not None:
            frame.group.check()

    def _refuse_late_cleanup(self, frame: Frame) -> None:
        if frame.raised:
            self.waiter.wait(PAUSE)
        frame.raised += 1
        detail = "its clean-up was not done in the time that the author gave it"
        after = frame.cause
        raise CommandFailed(
            robot=frame.live.name,
            command=frame.context.command,
            detail=detail if after is None else f"{detail}; before that: {after}",
        )

    def wait(self, frame: Frame, condition: Callable[[], bool], timeout: float = math.inf) -> bool:
        """Wait until something is so, or for `timeout` [s]; returns whether it is.

        Raises:
            VrError: the frame was asked to end.
            Abandoned: it was given up.
        """
        end = self._now() + max(timeout, 0.0)
        while not condition():
            self.check(frame)
            now = self._now()
            if now >= end:
                return False
            self.waiter.wait(min(end, frame.deadline_at) - now)
        return True


def _never() -> bool:
    return False


class Journal(Protocol):
    """Where the events of robots are written, in their order, before they have consequences."""

    def append(self, robot: str, now: float, event: Event) -> int:
        """Take an event; never blocks.

        Args:
            robot: key of its address.
            now: [s] on the robot's clock: an input of the machine as much as the event is.
            event: as handled, not refused.

        Returns:
            A number for `commit`; 0: there is nothing to wait for.
        """
        ...

    def commit(self, number: int) -> None:
        """Wait until the event, and all before it, would survive the process."""
        ...


class Process:
    """See the module. Every method may be called from any thread."""

    def __init__(
        self,
        runner: Runner | None = None,
        journal: Journal | None = None,
        core: Callable[[State], RobotCore] = RobotCore,
    ) -> None:
        """Begin without a thread.

        Args:
            runner: what threads and time are; None: the operating system's.
            journal: where the events of its robots are written; None: nowhere.
            core: makes the machine of a robot, from its state.
        """
        hand_on()
        self.runner: Runner = Threads() if runner is None else runner
        self.core = core
        self.journal = journal
        self.robots: dict[Address, Any] = {}
        """The robots that live here (`LiveRobot`)."""
        self.on_raise: Callable[[str, BaseException], None] = lambda _robot, _error: None
        """Told what the commands of each robot raise, as it was raised: over the wire go only words."""
        self.closed = False
        self._idle: list[Worker] = []
        self._lent: dict[int, Worker] = {}
        """The workers of threads that are not workers' own, by thread: see `carry_out`."""
        self._lock = self.runner.lock()
        self._order = itertools.count()
        self._timers: list[_Timer] = []
        self._bell = self.runner.waiter()
        self._watching = False
        self._watched: set[Worker] = set()

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
        timer = _Timer(when, next(self._order), action)
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

    def watch(self, frame: Frame) -> None:
        """Interrupt the worker of a cancelled frame if the frame does not end, and abandon it in the end."""
        worker = frame.worker
        if worker not in self._watched:
            self._watched.add(worker)
            self.at(self.runner.now() + GRACE, lambda: self._insist(frame, ATTEMPTS))

    def _insist(self, frame: Frame, attempts: int) -> None:
        worker = frame.worker
        if frame not in worker.stack or worker.dead:
            self._watched.discard(worker)
            for other in worker.stack:
                if other.cause is not None:
                    self.watch(other)
                    break
            return
        if any(shielded.shield > self.runner.now() for shielded in worker.stack):
            self.at(
                self.runner.now() + GRACE, lambda: self._insist(frame, attempts)
            )  # a clean-up has its time
            return
        if attempts:
            worker.interrupt()
            self.at(self.runner.now() + GRACE, lambda: self._insist(frame, attempts - 1))
            return
        worker.dead = True
        at = self.runner.stack_of(worker.thread)
        for lost in reversed(list(worker.stack)):
            lost.live.abandon(lost.call_key, at)
        worker.waiter.wake()

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


@functools.total_ordering
class _Timer:
    """Something to be done at a time."""

    __slots__ = ("_order", "action", "cancelled", "when")

    def __init__(self, when: float, order: int, action: Callable[[], None]) -> None:
        self.when, self.action, self.cancelled = when, action, False
        self._order = order

    def __lt__(self, other: _Timer) -> bool:
        return (self.when, self._order) < (other.when, other._order)

    def cancel(self) -> None:
        """Have it not done."""
        self.cancelled = True
