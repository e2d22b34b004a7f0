"""The frame of a running command: how its code begins on a worker, waits, and is made to end.

A command blocks in one place only (`Frame.wait`), where a cancel, a deadline and the awaited result wake it.
Code that does not listen to a cancel is interrupted: an exception is raised in its thread. Code that ignores
that is abandoned in the end, with all frames of its worker: those frames reach no child any more.

A part of a command on another worker has a frame, too: a function of its page, a thread of the author's own.
"""

from __future__ import annotations

import contextvars
import inspect
import math
from collections.abc import Callable, Iterator
from functools import partial
from types import FrameType
from typing import Any, Self, TypeVar

import msgspec

from robotree.files import forks
from robotree.vr.author.context import Activity, CommandContext, enter
from robotree.vr.author.together import Group, Started
from robotree.vr.base.errors import CommandCancelled, CommandFailed, VrError
from robotree.vr.core import events as on
from robotree.vr.running.ice import GoneOn
from robotree.vr.running.page_trace import page_line
from robotree.vr.running.process import Worker
from robotree.vr.running.replay import Replay, words_of_step
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.run import HeldStep, Run
from robotree.vr.running.runner import Interrupted

GRACE = 1.0
"""[s] between a cancel and the interruption of code that does not listen, and between two interruptions."""
ATTEMPTS = 3
"""Interruptions before the code is abandoned."""
LONGEST_END = GRACE * (ATTEMPTS + 1)
"""[s] from a cancel to the moment when its command has ended or is known not to end."""
PAUSE = 0.01
"""[s] that a command waits which swallows the error that should end it: it must not spin."""

PAUSES = ("sleep", "wait", "reading", "sample")
"""Kinds of steps of `taken` before which a paused command waits; the others only look, or end something."""

_T = TypeVar("_T")


class Abandoned(BaseException):
    """Raised in an author's code that was abandoned, at each further call."""


class Frame:
    """Code of one running command on one worker: the command itself, or a part of it."""

    dropped: VrError | None = None
    """Why this part is to end, though its command may go on."""
    raised: int = 0
    """How often it was told to end."""
    steps: int = 0
    """How many steps it has taken: each has the path key `key/step`."""
    reads: int = 0
    """How often it has read what its robot keeps, since the last step."""
    shield: float = -math.inf
    """[s] Until when a clean-up may go on though the command was asked to end."""
    group: Group | None = None
    """The innermost open group: what is started belongs to it."""
    over: bool = False
    """Whether its code has ended."""
    replay: Replay | None = None
    """The steps that it took before its process was started again; None: it begins now."""
    commander: Frame | None = None
    """The frame of which this one is a part; None: it is the command itself."""
    looks: bool = False
    """Whether a condition is looked at: that takes no steps."""
    guest: bool = False
    """Whether it is a thread of the author's own that works for a command."""
    below: Frame | None = None
    """The frame that waits for this one, on the same worker."""
    above: Frame | None = None
    """The frame for which this one waits, on the same worker."""
    depth: int = 0
    """How many frames its worker carries out up to this one; 0: its code is not at work."""
    parked: bool = False
    """Whether it stands still: see `stand`."""

    def __init__(
        self, runtime: RobotRuntime, run: Run, context: CommandContext, worker: Worker, call_key: str = ""
    ) -> None:
        """Begin without any code.

        Args:
            runtime: the robot.
            run: the call.
            context: of the command.
            worker: that carries it out.
            call_key: key of the robot's call, for a part of a command that has a key of its own.
        """
        self.runtime, self.run, self.context, self.worker = runtime, run, context, worker
        self.call_key = call_key or context.key
        self.deadline_at = context.deadline_at
        """[s] When what it does now must be done."""
        self.started: list[Started] = []
        """Work that it has started and that may go on beside it."""
        self.guests: dict[int, Self] = {}
        """Threads that work for it."""
        self.keeps = runtime.process.keeps_steps
        if run.recall is not None:
            own = self._suffix(f"{context.key}/{run.lap}")
            self.replay = Replay(run.recall, own, runtime.name, context.command)

    @property
    def cause(self) -> VrError | None:
        """Why it was asked to end; None: it was not."""
        return self.run.cause if self.dropped is None else self.dropped

    @property
    def cancelled(self) -> bool:
        """Whether it has been asked to end."""
        return self.run.cause is not None or self.dropped is not None

    @property
    def final(self) -> bool:
        """Whether not even a clean-up may command children any more."""
        return self.run.final or self.over

    @property
    def activity(self) -> Activity:
        """The frame as its code sees it."""
        raise NotImplementedError

    def wake(self) -> None:
        """Have what waits in it look again. From any thread."""
        self.worker.wake()

    @property
    def replaying(self) -> bool:
        """Whether it takes steps that it took before its process was started again: nothing is done twice."""
        return self.replay is not None and self.replay.active

    # -- its threads ------------------------------------------------------------------------------

    def is_here(self) -> bool:
        """Whether the present thread already works for it."""
        here = self.worker.here()
        return here == self.worker.thread or here in self.guests

    def in_this_thread(self) -> Self:
        """Return the part of it that the present thread carries out."""
        here = self.worker.here()
        if here == self.worker.thread:
            return self
        with self.worker.guard:
            guest = self.guests.get(here)
            if guest is None:
                guest = self._guest(f"t{len(self.guests) + 1}")
                guest.worker.thread = here
                self.guests[here] = guest
        return guest

    def handed_on(self, work: Callable[..., _T]) -> Callable[..., _T]:
        """Return a function that works for it in another thread, with keys of its own."""
        guest = self.in_this_thread().next_guest()

        def run(*values: Any, **arguments: Any) -> _T:
            guest.worker.thread = guest.worker.here()
            context = contextvars.copy_context()
            context.run(enter, guest)
            try:
                return context.run(work, *values, **arguments)
            finally:
                forks.expect_parent()

        return run

    def next_guest(self) -> Self:
        """Return a part of it for a thread that is not known yet."""
        self.steps += 1
        guest = self.guests[-self.steps] = self._guest(f"{self.run.lap}{self.steps}")
        return guest

    def part(self, number: str, worker: Worker) -> Self:
        """Return a part of this command that runs on another worker; its keys begin with ours."""
        context = msgspec.structs.replace(self.context, key=f"{self.context.key}/{number}")
        part = type(self)(self.runtime, self.run, context, worker, self.call_key)
        part.deadline_at, part.shield, part.commander = self.deadline_at, self.shield, self
        part.dropped = self._ended() if self.over else self.dropped
        return part

    def _guest(self, number: str) -> Self:
        if self.keeps:
            self.runtime.keep_step(self.call_key, f"{self.run.lap}{on.THREAD}", on.StepResult(on.THREAD))
        guest = self.part(number, Worker(self.worker.process))
        guest.guest, guest.depth, guest.worker.top = True, 1, guest
        return guest

    def _ended(self) -> CommandCancelled:
        reason = "the command for which this thread works has ended"
        return CommandCancelled(robot=self.runtime.name, command=self.context.command, reason=reason)

    # -- its code ---------------------------------------------------------------------------------

    def carry_out(self, work: Callable[[], Any]) -> tuple[Any, BaseException | None]:
        """Carry its code out, on top of what its worker has; returns its value or its error."""
        worker = self.worker
        outcome: tuple[Any, BaseException | None] | None = None
        below = worker.top
        if isinstance(below, Frame):
            self.below, below.above, self.depth = below, self, below.depth + 1
        else:
            self.depth = 1
        worker.top = self
        self.runtime.frames.add(self)
        while True:
            try:
                if outcome is None:
                    outcome = (None, Interrupted())
                    try:
                        if self.cancelled and not self.replaying and self.shield <= worker.now():
                            outcome = (None, self.cause)
                        else:
                            context = contextvars.Context()
                            context.run(enter, self)
                            worker.arm(self)
                            outcome = (context.run(work), None)
                    except BaseException as error:  # noqa: BLE001 # the boundary to foreign code
                        outcome = (None, error)
                worker.disarm()
            except Interrupted:
                continue
            break
        worker.top, self.depth = below, 0
        if self.below is not None:
            self.below.above = None
        self.runtime.frame_ended(self)
        return outcome

    # -- while its robot is about to leave ---------------------------------------------------------

    def stand(self) -> None:
        """Wait while the robot is about to leave.

        Raises:
            GoneOn: it has left.
        """
        ice = self.runtime.ice
        if ice is None:
            return
        self.parked = True
        try:
            while not (ice.over or self.worker.dead):
                self.worker.waiter.wait(None)
        finally:
            self.parked = False
        if ice.moved:
            raise self._once_more(GoneOn())

    def leave_author(self) -> Worker:
        """Come from the author's code into ours.

        Raises:
            VrError: the command has been asked to end.
        """
        worker = self.worker
        worker.disarm()
        try:
            self.expect_to_go_on()
        except BaseException:
            worker.arm(self)
            raise
        return worker

    def step(self) -> str:
        """Take one more step; returns its path key.

        Raises:
            RuntimeError: the condition of `wait_until` wants one.
        """
        if self.looks:
            raise RuntimeError("the condition of wait_until only reads; call commands before or after it")
        self.steps, self.reads = self.steps + 1, 0
        return f"{self.context.key}/{self.run.lap}{self.steps}"

    # -- what it has done before its process was started again -------------------------------------

    def recalled(self, path: str, kind: str, content: Any = None) -> on.StepResult | None:
        """Return what a step gave before; None: it is taken for the first time.

        Args:
            path: key of the step.
            kind: see `events.Step`; so is the next.
            content: what tells it from another step.

        Raises:
            Diverged: the page takes another step than before.
        """
        replay = self.replay
        if replay is None or not replay.active:
            return None
        step = replay.take(self._suffix(path), kind, content, self.steps)
        if replay.used_up:
            self._catch_up(replay)
        return step

    def resume(self) -> None:
        """Do what is to be done before the first new step after a crash."""

    def hold(self, path: str, kind: str, content: Any = None, *, of_page: bool = True) -> None:
        """Wait before a step while the robot is paused; the time of a clean-up is too short for that.

        Args:
            path: see `recalled`; so are the next.
            kind: of the step.
            content: of the step.
            of_page: whether a line of the robot's own page takes it.

        Raises:
            VrError: the command was asked to end meanwhile.
        """
        runtime = self.runtime
        if not runtime.paused or self.replaying or self.shield > -math.inf or runtime.may_pass(path):
            return
        fields = runtime.child_parameters(*content[:2]) if kind in {"call", "tell"} else ()
        words = words_of_step(kind, content, fields)
        step = f"step {self._suffix(path)}: {words}"
        if line := of_page and page_line(inspect.currentframe()):
            step = f"{step}, line {line}"
        runtime.hold(path, HeldStep(self.call_key, step, self.wake))
        try:
            self.wait(lambda: runtime.may_pass(path))
        finally:
            runtime.let_go(path)

    def keep_step(self, path: str, step: on.StepResult) -> None:
        """Keep what a step gave, if steps are kept. From any thread."""
        if self.keeps:
            self.runtime.keep_step(self.call_key, self._suffix(path), step)

    def taken(self, kind: str, take: Callable[[], Any], content: Any = None) -> Any:
        """Take a step that gives plain data, or return what it gave before."""
        path = self.step()
        step = self.recalled(path, kind, content) if self.keeps else None
        if step is not None:
            return step.value
        if self.runtime.paused and kind in PAUSES:
            self.hold(path, kind, content)
        value = take()
        self.keep_step(path, on.StepResult(kind, content, value))
        return value

    def _suffix(self, path: str) -> str:
        return path[len(self.call_key) + 1 :]

    def _catch_up(self, replay: Replay) -> None:
        """Go on with what was not done before; a part waits until the command is so far."""
        before = None if self.commander is None else self.commander.replay
        if before is not None and before.active:
            before.waiting.append(self.wake)
            self.wait(lambda: not before.active)
        if before is None and self.run.ahead:
            raise replay.strayed(self.run.ahead[0].place)
        replay.active = False
        if replay.rewritten:
            self.runtime.keep_fields(replay.rewritten)
        for wake in replay.waiting:
            wake()
        self.expect_to_go_on()
        if self.commander is None:
            self.resume()

    # -- what is blocked, blocks here and nowhere else --------------------------------------------

    def wait(self, condition: Callable[[], bool], timeout: float = math.inf) -> bool:
        """Wait until something is so, or for `timeout` [s]; returns whether it is.

        Raises:
            VrError: it was asked to end.
            Abandoned: the command's code was abandoned.
        """
        worker = self.worker
        end = worker.now() + max(timeout, 0.0)
        while True:
            self.stand()
            if condition():
                return True
            self.expect_to_go_on()
            now = worker.now()
            if now >= end:
                return False
            worker.waiter.wait(min(end, self.deadline_at) - now)

    def expect_to_go_on(self) -> None:
        """Raise what ends it, if it is to end.

        Raises:
            VrError: it was asked to end.
            Interrupted: it was, and did not.
            Abandoned: the command's code was abandoned.
        """
        if self.worker.dead:
            raise self._once_more(Abandoned())
        if self.runtime.has_left:
            raise self._once_more(GoneOn())
        if self.replaying and self.dropped is None and not self._ended_before():
            return
        now = self.worker.now()
        if self.deadline_at > now and not (self.run.cause or self.dropped or self.group):
            return
        if now >= self.shield:
            self._end(now)

    def _ended_before(self) -> bool:
        """Whether the end of the command was raised at this step, before its process was started again."""
        return self.replay is not None and self.replay.ended_at(self._suffix(self._end_path), self.steps)

    @property
    def _end_path(self) -> str:
        """Key under which the end of the command is kept, as it was raised in this frame."""
        return f"{self.context.key}/{self.run.lap}{on.END}"

    def _end(self, now: float) -> None:
        """Raise what ends it, if it is to end and no clean-up is under way."""
        worker = self.worker
        if self.shield > -math.inf:
            raise self._once_more(self._late_cleanup())
        if self.cause is None and self.deadline_at <= now:
            self.runtime.pass_time()
        if (cause := self.cause) is not None:
            if worker.interrupt_next:
                worker.interrupt_next = False
                raise Interrupted
            if self.keeps and not (self.raised or self.dropped or self.replaying):
                self.keep_step(self._end_path, on.StepResult(on.END, None, self.steps))
            raise self._once_more(type(cause)(**cause.data))
        if self.group is not None:
            self.group.check()

    def _once_more(self, error: BaseException) -> BaseException:
        """Return an error that it was told before, if it swallows everything; then it must not spin."""
        if self.raised:
            self.worker.waiter.wait(PAUSE)
        self.raised += 1
        return error

    def _late_cleanup(self) -> CommandFailed:
        detail, after = "its clean-up was not done in the time that the author gave it", self.cause
        if after is not None:
            detail = f"{detail}; before that: {after}"
        return CommandFailed(robot=self.runtime.name, command=self.context.command, detail=detail)

    # -- its end ----------------------------------------------------------------------------------

    def interrupt(self) -> None:
        """Take note of `cause`. From any thread; the frames above it are ended by their robots."""
        final = self.final
        if final:
            self.shield = -math.inf
        for part in tuple(self.started):
            part.end_with_command()
        for guest in tuple(self.guests.values()):
            guest.interrupt()
        if self.shield <= self.worker.now():
            above = self.above
            while above is not None:
                above.runtime.cancel(above.call_key, "its caller was ended", final=final)
                above = above.above
        self.worker.waiter.wake()
        if not self.guest:
            self.watch()

    def end(self) -> None:
        """End what its code, which has ended, has started and not detached."""
        self.over = True
        for guest in tuple(self.guests.values()):
            guest.dropped = self._ended()
            guest.end()
            guest.interrupt()
        for part in self.started:
            part.drop("the command that started it has ended")

    def watch(self) -> None:
        """Interrupt its worker if it does not end, and abandon that in the end."""
        if not self.worker.watched:
            self.worker.watched = True
            self._insist_later(ATTEMPTS)

    def _insist_later(self, attempts: int) -> None:
        process = self.worker.process
        process.at(process.runner.now() + GRACE, partial(self._insist, attempts))

    def _insist(self, attempts: int) -> None:
        worker = self.worker
        if not self.depth or worker.dead:
            worker.watched = False
            for lowest in [frame for frame in self._on_worker() if frame.cause is not None][-1:]:
                lowest.watch()
        elif any(frame.shield > worker.now() for frame in self._on_worker()):
            self._insist_later(attempts)  # a clean-up has its time
        elif attempts:
            worker.interrupt()
            self._insist_later(attempts - 1)
        else:
            worker.dead = True
            at = worker.process.runner.stack_of(worker.thread)
            for frame in list(self._on_worker()):
                frame.abandon(at)
            worker.waiter.wake()

    def _on_worker(self) -> Iterator[Frame]:
        """Give the frames of its worker, the innermost first."""
        frame = self.worker.top
        while isinstance(frame, Frame):
            yield frame
            frame = frame.below

    def abandon(self, at: FrameType | None) -> None:
        """Give its code up; `at` is what its thread carries out."""
        self.runtime.abandon(self.call_key, at)
        if self.call_key != self.context.key:  # a part of the command, on another worker
            reason = "a part of it was abandoned, because it ignores every cancel"
            error = CommandCancelled(robot=self.runtime.name, command=self.context.command, reason=reason)
            self.run.end(error, final=True)


class Branch(Started):
    """A part of a command that runs on another worker: a function that `both.start(function)` has started."""

    def __init__(self, frame: Frame, number: str, work: Callable[[], Any]) -> None:
        """Made by the frame of the command; `run` is for a worker."""
        self._on_done = []
        self._frame, self._number, self._work = frame, number, work
        self._own: Frame | None = None
        self._dropped: CommandCancelled | None = None
        self._value: Any = None
        self._error: BaseException | None = None
        self.at_rest = False

    @property
    def activity(self) -> Activity:
        """The command, or the part of it, that has started it."""
        return self._frame.activity

    def run(self, worker: Worker) -> None:
        """Carry it out."""
        command = self._frame
        frame = self._own = command.part(self._number, worker)
        frame.dropped = self._dropped or frame.dropped
        self._value, self._error = frame.carry_out(self._work)
        frame.end()
        if worker.dead:
            command.runtime.gone(command.call_key)
        self.at_rest = True
        self.tell_all()
        command.wake()

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        return self.at_rest or self._dropped is not None

    @property
    def progress(self) -> float:
        """NaN: nobody knows how far it is."""
        return math.nan

    def error(self) -> BaseException | None:
        """Return with what it has failed; None: it has not, or goes on."""
        return self._dropped or self._error

    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker; return the value of the function.

        Raises:
            BaseException: the function has raised it.
            TimeoutError: it is still under way after `timeout` [s].
        """
        if not self._frame.wait(lambda: self.done, timeout):
            raise TimeoutError
        error = self.error()
        if error is not None:
            raise error
        return self._value

    def wait_until_accepted(self) -> None:
        """Do nothing: it waits for nobody."""

    def let_go(self) -> None:
        """Refuse.

        Raises:
            TypeError: always.
        """
        raise TypeError("a function of this page ends with its command; only a child's command can go on")

    def drop(self, reason: str) -> None:
        """End it, for nobody waits for it any more. From any thread."""
        if self.done:
            return
        robot, command = self._frame.runtime.name, self._frame.context.command
        self._dropped = CommandCancelled(robot=robot, command=command, reason=reason)
        if self._own is not None:
            self._own.dropped = self._dropped
            self._own.interrupt()

    def cancel(self) -> None:
        """End it in the name of the page."""
        if not self.done:
            self.called_off = True
            self.drop("its caller has cancelled it")

    def end_with_command(self) -> None:
        """Take note that the command is asked to end. From any thread."""
        if self._own is not None and not self.at_rest:
            self._own.interrupt()
