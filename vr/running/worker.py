"""Pooled threads that carry out commands, each with a stack of frames, one for each robot's command.

A parent's command that calls a child in the same process carries the child's command out on its own worker,
as one more frame, when the child is idle; else it waits for its turn or for a worker of the child's own. A
worker blocks in one place only (`Worker.wait`), where a cancel, a deadline and the result that is waited for
wake it.

Code that does not listen to a cancel is interrupted: an exception is raised in its thread. That is only done
while the author's code of the topmost frame is at work (`arm`): every way from that code into this project
disarms first, so an interruption never strikes our own code. What is not interrupted in the end is abandoned,
with all frames of its worker: those frames reach no child any more.
"""

from __future__ import annotations

import contextvars
import math
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from robotree.vr.context import CallFuture, CommandContext, enter
from robotree.vr.errors import VrError
from robotree.vr.running.runner import Runner

DEEPEST = 32
"""Frames on one worker; a call below that is handed to another one."""
PAUSE = 0.01
"""[s] that a command waits which swallows the error that should end it: it must not spin."""


class Started(CallFuture, Protocol):
    """A call of a child, as the command that has made it needs it."""

    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker, or carry the command out there; return the result."""
        ...

    def wait_until_accepted(self) -> None:
        """Wait until the child has accepted it."""
        ...

    def drop(self, reason: str) -> None:
        """Nobody waits for it any more."""
        ...


class Caller(Protocol):
    """The robot of a running command, as the command needs it."""

    def call_child(
        self,
        frame: Frame,
        slot: str,
        command: str,
        arguments: Mapping[str, Any],
        *,
        nested: bool = False,
        oneway: bool = False,
        passes_on: bool = False,
    ) -> Started:
        """Call the child in a slot, as one step of the command."""
        ...

    def note(self, key: str, fraction: float, text: str) -> None:
        """Take how far the command is."""
        ...

    def cancel(self, key: str, reason: str) -> None:
        """End the command in the name of its caller."""
        ...

    def abandon(self, key: str) -> None:
        """Give the command's code up."""
        ...

    def pass_time(self) -> None:
        """Have what is due end."""
        ...

    def meant(self, slot: str, error: VrError) -> VrError:
        """Return what the error of a call of a child means to the command."""
        ...


class Pool(Protocol):
    """The process of a worker, as the worker needs it."""

    @property
    def runner(self) -> Runner:
        """What threads and time are."""
        ...

    def work(self, job: Callable[[Worker], None]) -> None:
        """Have something done by a worker."""
        ...

    def wait_for_job(self, worker: Worker) -> bool:
        """Wait until the worker has something to do; False: it is to end."""
        ...

    def watch(self, frame: Frame) -> None:
        """Interrupt the worker of a cancelled frame if the frame does not end."""
        ...


class Interrupted(BaseException):
    """Raised in an author's code that did not listen; no Exception, so that few catch it."""


class Abandoned(BaseException):
    """Raised in an author's code that was given up, whatever it still tries."""


class Frame:
    """One running command. It is the `Activity` that the author's code sees."""

    __slots__ = ("__weakref__", "cause", "context", "live", "raised", "started", "steps", "worker")

    def __init__(self, live: Caller, context: CommandContext, worker: Worker) -> None:
        """Made by the robot when the command begins."""
        self.live, self.context, self.worker = live, context, worker
        self.cause: VrError | None = None
        """Why it was asked to end."""
        self.raised = 0
        """How often it was told."""
        self.steps = 0
        """How many steps it has taken: each has the path key `key/step`."""
        self.started: list[Started] = []
        """Calls of children that it has started and that may go on beside it."""

    @property
    def cancelled(self) -> bool:
        """See `Activity.cancelled`."""
        return self.cause is not None

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
        if worker.process.runner.here() != worker.thread:  # else it does not wait
            worker.waiter.wake()

    def progress(self, fraction: float, text: str) -> None:
        """See `Activity.progress`."""
        worker = self._leave_author()
        try:
            self.live.note(self.context.key, float(fraction), str(text))
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
        if worker.process.runner.here() != worker.thread:  # a thread that the command was handed on to
            change()
            return
        worker.disarm()
        try:
            if worker.dead:
                worker.check(self)
            change()
        finally:
            worker.arm(self)

    def call(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Any:
        """See `Activity.call`."""
        worker = self._leave_author()
        try:
            return self.live.call_child(self, slot, command, arguments, nested=True).get()
        finally:
            worker.arm(self)

    def pass_on(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Any:
        """Carry out an exposed command: call the child's, and tell its progress as our own."""
        worker = self._leave_author()
        try:
            pending = self.live.call_child(self, slot, command, arguments, nested=True, passes_on=True)
            return pending.get()
        finally:
            worker.arm(self)

    def start(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Started:
        """See `Activity.start`."""
        worker = self._leave_author()
        try:
            pending = self.live.call_child(self, slot, command, arguments)
            self.started.append(pending)
            return pending
        finally:
            worker.arm(self)

    def tell(self, slot: str, command: str, arguments: Mapping[str, Any]) -> None:
        """See `Activity.tell`."""
        worker = self._leave_author()
        try:
            self.live.call_child(self, slot, command, arguments, oneway=True).wait_until_accepted()
        finally:
            worker.arm(self)

    # -- for the worker ---------------------------------------------------------------------------

    def result_of(self, pending: Started, timeout: float) -> Any:
        """Wait for a call that was started; return its result."""
        worker = self._leave_author()
        try:
            return pending.get(timeout)
        finally:
            worker.arm(self)

    def step(self) -> str:
        """Take one more step; returns its path key."""
        self.steps += 1
        return f"{self.context.key}/{self.steps}"

    def cancel(self, cause: VrError) -> None:
        """Have it end. From any thread; the frames above it are told by the robots that they belong to."""
        self.cause = cause
        worker = self.worker
        stack = worker.stack
        above = stack[stack.index(self) + 1 :] if self in stack else []
        for frame in above:
            frame.live.cancel(frame.context.key, "its caller was ended")
        worker.waiter.wake()
        worker.process.watch(self)

    def _leave_author(self) -> Worker:
        """Come from the author's code into ours.

        Raises:
            VrError: the command has been asked to end.
            RuntimeError: this is another thread than the command's.
        """
        worker = self.worker
        if worker.process.runner.here() != worker.thread:
            raise RuntimeError("this works only in the thread of the running command")
        worker.disarm()
        try:
            worker.check(self)
        except BaseException:
            worker.arm(self)
            raise
        return worker


class Worker:
    """One pooled thread."""

    def __init__(self, process: Pool) -> None:
        """Made by the process; `main` runs in the thread."""
        runner = process.runner
        self.process = process
        self.waiter = runner.waiter()
        self.stack: list[Frame] = []
        self.jobs: list[Callable[[Worker], None]] = []
        self.thread = 0
        self.dead = False
        """Whether it is abandoned."""
        self._now = runner.now
        self._guard = runner.lock()
        """Orders interruptions with `arm` and `disarm`."""
        self._armed: Frame | None = None
        self._struck = False
        self._interrupt_next = False

    def main(self) -> None:
        """Carry out what is given, until the process closes or nothing has come for a while."""
        self.thread = self.process.runner.here()
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
                with self._guard:
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
        with self._guard:
            if self._armed is not None and self.stack and self._armed is self.stack[-1]:
                self._struck = True
                self.process.runner.interrupt(self.thread, Interrupted)
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
                        if frame.cause is not None:
                            outcome = (None, frame.cause)
                        else:
                            outcome = (contextvars.Context().run(self._author, frame, work), None)
                    except BaseException as error:  # noqa: BLE001 # the boundary to foreign code
                        outcome = (None, error)
                self.disarm()
            except Interrupted:
                continue
            break
        self.stack.pop()
        return outcome

    def _author(self, frame: Frame, work: Callable[[], Any]) -> Any:
        enter(frame)
        self.arm(frame)
        return work()

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
        if frame.cause is None and frame.context.deadline_at <= self._now():
            frame.live.pass_time()
        if frame.cause is not None:
            if self._interrupt_next:
                self._interrupt_next = False
                raise Interrupted
            if frame.raised:
                self.waiter.wait(PAUSE)
            frame.raised += 1
            raise type(frame.cause)(**frame.cause.data)

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
            self.waiter.wait(min(end, frame.context.deadline_at) - now)
        return True


def _never() -> bool:
    return False
