"""A running command: its frame, and what it has started: calls of children, functions of its page, groups.

A parent's command that calls a child in the same process carries the child's command out on its own worker,
as one more frame, when the child is idle; else it waits for its turn or for a worker of the child's own. A
command blocks in one place only (`Frame.wait`), where a cancel, a deadline and the result that is waited for
wake it.

Several parts of a command at once: all of them, or the first that succeeds.

    with self.together() as both:
        both.start(self.left.go_to, x=0.3)
        both.start(self.right.go_to, x=0.3)

A part is a call of a child, or a function of the page on another worker. At the end of the block all have
ended. The first failure ends the others and is what is raised. A group belongs to one frame, the command's or
that of a part; groups may be nested.
"""

from __future__ import annotations

import contextlib
import contextvars
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Mapping
from functools import partial
from types import FrameType, TracebackType
from typing import Any, Literal, Protocol, Self, TypeVar

import msgspec

from robotree.files import forks
from robotree.vr.author.child import ChildCommand, readable
from robotree.vr.author.context import CallFuture, CallLimit, CommandContext, enter
from robotree.vr.base.errors import (
    ChildCancelled,
    ChildTimeout,
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    Failed,
    NoAnswer,
    Unreachable,
    VrError,
)
from robotree.vr.base.requests import (
    LONGEST_CLEANUP,
    PATIENCE,
    Accepted,
    Level,
    Progress,
    Raised,
    Reply,
    Returned,
    State,
)
from robotree.vr.running.feed import Feed, NoReadingYet
from robotree.vr.running.interruptible import Interrupted
from robotree.vr.running.page_trace import words_of
from robotree.vr.running.process import Worker

DEEPEST = 32
"""Frames on one worker; a call below that is handed to another one."""
PAUSE = 0.01
"""[s] that a command waits which swallows the error that should end it: it must not spin."""

_T = TypeVar("_T")

CallManner = Literal["awaited", "started", "told", "passed on"]
"""How a command calls a child. awaited: it waits for the end, so its worker may carry the child's command
out. started: it goes on meanwhile. told: it waits until the child has accepted it. passed on: it waits, and
the progress of the child is its own."""


class CallingRobot(Protocol):
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
        manner: CallManner,
        *,
        instead: str = "",
        limit: CallLimit | None = None,
    ) -> Started:
        """Call the child in a slot, as one step of the command."""
        ...

    def note(self, key: str, fraction: float, text: str) -> None:
        """Take how far the command is."""
        ...

    def say(self, key: str, level: Level, text: str, *, piece: bool) -> None:
        """Take output of the command's code."""
        ...

    def note_child(self, key: str, child: str, text: str) -> None:
        """Take the progress that a child of the command reports."""
        ...

    def cancel(self, key: str, reason: str, *, final: bool = False) -> None:
        """End the command in the name of its caller."""
        ...

    def abandon(self, key: str, at: FrameType | None) -> None:
        """Give the command's code up; `at` is what its thread carries out."""
        ...

    def gone(self, key: str) -> None:
        """The command's code, which was abandoned, has ended."""
        ...

    def pass_time(self) -> None:
        """Have what is due end."""
        ...

    def feed_of(self, slot: str, wake: Callable[[], None]) -> Feed:
        """Have the readings of the child in a slot taken from now on."""
        ...

    def meant(self, slot: str, error: VrError) -> Exception:
        """Return what the error of a call of a child means to the command."""
        ...


class Abandoned(BaseException):
    """Raised in an author's code that was abandoned, at each further call."""


class Frame:
    """One running command, or a part of it that runs beside it. It is the `Activity` that its code sees."""

    cause: VrError | None = None
    """Why it was asked to end."""
    final: bool = False
    """Whether not even a clean-up may command children any more: see `core.machine.AcceptedCall.final`."""
    raised: int = 0
    """How many progress reports have come."""
    steps: int = 0
    """How many steps it has taken: each has the path key `key/step`."""
    shield: float = -math.inf
    """[s] Until when a clean-up may go on though the command was asked to end."""
    group: Group | None = None
    """The innermost open group: what is started belongs to it."""
    over: bool = False
    """Whether its code has ended."""
    looks: bool = False
    """Whether a condition is looked at: that takes no steps."""
    guest: bool = False
    """Whether it is a thread of the author's own that works for a command."""

    def __init__(
        self, runtime: CallingRobot, context: CommandContext, worker: Worker, call_key: str = ""
    ) -> None:
        """Made by the robot when the command begins.

        Args:
            runtime: the robot.
            context: of the command.
            worker: that carries it out.
            call_key: key of the robot's call, for a part of a command that has a key of its own.
        """
        self.runtime, self.context, self.worker = runtime, context, worker
        self.call_key = call_key or context.key
        self.deadline_at = context.deadline_at
        """[s] When what it does now must be done."""
        self.started: list[Started] = []
        """What it has started and what may go on beside it."""
        self.guests: dict[int, Frame] = {}
        """Threads that work for it."""
        self.feeds: dict[str, Feed] = {}
        """The readings of children that it follows, by slot."""

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
            try:
                return context.run(work, *values, **arguments)
            finally:
                forks.expect_parent()

        return run

    def part(self, number: str, worker: Worker, *, guest: bool = False) -> Frame:
        """Return a part of this command that runs on another worker; its keys begin with ours."""
        context = msgspec.structs.replace(self.context, key=f"{self.context.key}/{number}")
        part = Frame(self.runtime, context, worker, self.call_key)
        part.guest, part.final = guest, self.final
        part.deadline_at, part.shield = self.deadline_at, self.shield
        part.cause = self._ended() if self.over else self.cause
        if guest:
            worker.stack.append(part)
        return part

    def _ended(self) -> CommandCancelled:
        reason = "the command for which this thread works has ended"
        return CommandCancelled(robot=self.runtime.name, command=self.context.command, reason=reason)

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
            return self.wait(condition, timeout)
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
            self.runtime.note(self.call_key, float(fraction), str(text))
        finally:
            worker.arm(self)

    def observe(self, look: Callable[[], Any]) -> Any:
        """See `Activity.observe`."""
        worker = self._leave_author()
        try:
            if not self.looks:
                self.step()
            return look()
        finally:
            worker.arm(self)

    # -- readings of children ---------------------------------------------------------------------

    def next_reading(self, slot: str, after: int, at: float) -> tuple[int, Any]:
        """See `Activity.next_reading`."""
        worker = self._leave_author()
        try:
            self.step()
            feed = self._feed(slot)
            self.wait(_never, at - self.now())
            return self._reading_of(feed, slot, after)
        finally:
            worker.arm(self)

    def reading(self, slot: str) -> Any:
        """See `Activity.reading`. While a condition is looked at, nothing waits and it is no step.

        Raises:
            NoReadingYet: a condition asks before anything has been published.
        """
        worker = self._leave_author()
        try:
            feed = self._feed(slot)
            if not self.looks:
                self.step()
                return self._reading_of(feed, slot, 0)[1]
            if feed.latest is None:
                raise NoReadingYet
            return feed.latest
        finally:
            worker.arm(self)

    def published(self, slot: str) -> State | None:
        """See `Activity.published`."""
        worker = self._leave_author()
        try:
            return self._feed(slot).state
        finally:
            worker.arm(self)

    def wait_until(self, condition: Callable[[], object], limit: CallLimit | None) -> None:
        """See `Activity.wait_until`."""
        worker = self._leave_author()
        try:
            self.step()
            self.looks = True
            end = math.inf if limit is None else self.now() + limit.seconds
            while True:
                seen = self._newest()
                if self._holds(condition):
                    return
                if not self.feeds:
                    raise RuntimeError(
                        "the condition of wait_until has read no readings of a child, so nothing tells when "
                        "to look again; read them as in self.arm.readings.z"
                    )
                if not self.wait(partial(self._has_news, seen), end - self.now()):
                    raise TimeoutError(f"the condition was not true within {limit.text if limit else ''}")
        finally:
            self.looks = False
            worker.arm(self)

    def _holds(self, condition: Callable[[], object]) -> bool:
        """Look at a condition of the page."""
        worker = self.worker
        worker.arm(self)
        try:
            return bool(condition())
        except NoReadingYet:
            return False
        finally:
            worker.disarm()

    def _newest(self) -> int:
        return max((feed.number for feed in self.feeds.values()), default=0)

    def _has_news(self, after: int) -> bool:
        return self._newest() > after

    def _feed(self, slot: str) -> Feed:
        """Return what the child that is now in a slot publishes.

        Raises:
            SlotEmpty: there is none.
        """
        feed = self.feeds.get(slot)
        if feed is None or feed.over:
            feed = self.feeds[slot] = self.runtime.feed_of(slot, self.wake)
        return feed

    def _reading_of(self, feed: Feed, slot: str, after: int) -> tuple[int, Any]:
        """Wait for a reading that is newer than the one numbered `after`."""
        while feed.over or feed.number <= after:
            self.wait(partial(feed.has_news, after))
            feed = self._feed(slot)
        return feed.number, feed.latest

    def keep(self, change: Callable[[], None]) -> None:
        """See `Activity.keep`."""
        worker = self.worker
        if worker.here() != worker.thread:  # a thread that the command was handed on to
            change()
            return
        worker.disarm()
        try:
            if worker.dead:
                self.expect_to_go_on()
            change()
        finally:
            worker.arm(self)

    def say(self, level: Level, text: str, *, piece: bool = False) -> None:
        """See `Activity.say`."""
        self.keep(lambda: self.runtime.say(self.context.key, level, text, piece=piece))

    def call(
        self, slot: str, command: str, arguments: Mapping[str, Any], limit: CallLimit | None = None
    ) -> Any:
        """See `Activity.call`. With a limit, this worker stays free to notice that it is over."""
        worker = self._leave_author()
        try:
            manner: CallManner = "started" if self.guest or limit else "awaited"
            return self.runtime.call_child(self, slot, command, arguments, manner, limit=limit).get()
        finally:
            worker.arm(self)

    def pass_on(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Any:
        """Carry out an exposed command: call the child's, and report its progress as our own."""
        worker = self._leave_author()
        try:
            return self.runtime.call_child(self, slot, command, arguments, "passed on").get()
        finally:
            worker.arm(self)

    def start(
        self, slot: str, command: str, arguments: Mapping[str, Any], limit: CallLimit | None = None
    ) -> Started:
        """See `Activity.start`."""
        worker = self._leave_author()
        try:
            group = self.group
            decided = "" if group is None else group.decided
            pending = self.runtime.call_child(
                self, slot, command, arguments, "started", instead=decided, limit=limit
            )
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
            self.runtime.call_child(self, slot, command, arguments, "told").wait_until_accepted()
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
                self.wait(group.is_over)
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
            raise CommandCancelled(robot=self.runtime.name, command=self.context.command, reason=reason)
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
        """Take one more step; returns its path key.

        Raises:
            RuntimeError: the condition of `wait_until` wants one.
        """
        if self.looks:
            raise RuntimeError("the condition of wait_until only reads; call commands before or after it")
        self.steps += 1
        return f"{self.context.key}/{self.steps}"

    def cancel(self, cause: VrError, *, final: bool = False) -> None:
        """Ask it to end. From any thread; the robots that own the frames above it notify those frames."""
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
                frame.end_with_caller(final=final)
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
        for feed in self.feeds.values():
            feed.close()

    def _leave_author(self) -> Worker:
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

    def run(self, work: Callable[[], Any]) -> tuple[Any, BaseException | None]:
        """Carry its code out, on top of what its worker has; returns its value or its error."""
        worker = self.worker
        outcome: tuple[Any, BaseException | None] | None = None
        worker.stack.append(self)
        while True:
            try:
                if outcome is None:
                    outcome = (None, Interrupted())
                    try:
                        if self.cause is not None and self.shield <= worker.now():
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
        worker.stack.pop()
        return outcome

    def end_with_caller(self, *, final: bool) -> None:
        """See `OnWorker.end_with_caller`."""
        self.runtime.cancel(self.call_key, "its caller was ended", final=final)

    def abandon(self, at: FrameType | None) -> None:
        """See `OnWorker.abandon`."""
        self.runtime.abandon(self.call_key, at)

    # -- what is blocked, blocks here and nowhere else --------------------------------------------

    def expect_to_go_on(self) -> None:
        """Raise what ends it, if it is to end.

        Raises:
            VrError: it was asked to end.
            Interrupted: it was, and did not.
            Abandoned: the command's code was abandoned.
        """
        worker = self.worker
        if worker.dead:
            if self.raised:  # it swallows everything
                worker.waiter.wait(PAUSE)
            self.raised += 1
            raise Abandoned
        now = worker.now()
        if self.deadline_at > now and self.cause is None and self.group is None:
            return
        if now >= self.shield:
            self._end(now)

    def _end(self, now: float) -> None:
        """Raise what ends it, if it is to end and no clean-up is under way."""
        worker = self.worker
        if self.shield > -math.inf:
            self._refuse_late_cleanup()
        if self.cause is None and self.deadline_at <= now:
            self.runtime.pass_time()
        if self.cause is not None:
            if worker.interrupt_next:
                worker.interrupt_next = False
                raise Interrupted
            if self.raised:
                worker.waiter.wait(PAUSE)
            self.raised += 1
            raise type(self.cause)(**self.cause.data)
        if self.group is not None:
            self.group.check()

    def _refuse_late_cleanup(self) -> None:
        if self.raised:
            self.worker.waiter.wait(PAUSE)
        self.raised += 1
        detail = "its clean-up was not done in the time that the author gave it"
        after = self.cause
        raise CommandFailed(
            robot=self.runtime.name,
            command=self.context.command,
            detail=detail if after is None else f"{detail}; before that: {after}",
        )

    def wait(self, condition: Callable[[], bool], timeout: float = math.inf) -> bool:
        """Wait until something is so, or for `timeout` [s]; returns whether it is.

        Raises:
            VrError: it was asked to end.
            Abandoned: the command's code was abandoned.
        """
        worker = self.worker
        end = worker.now() + max(timeout, 0.0)
        while not condition():
            self.expect_to_go_on()
            now = worker.now()
            if now >= end:
                return False
            worker.waiter.wait(min(end, self.deadline_at) - now)
        return True


class Started(CallFuture[Any], ABC):
    """What a command has started and what may go on beside it: a call of a child, a function of the page."""

    called_off: bool = False
    """Whether the page itself has cancelled it before it ended: that is no failure."""
    at_rest: bool = True
    """Whether nothing of it uses the page's data any more."""
    frame: Frame
    """Of the command, or of the part of it, that has started it."""
    _tell: list[Callable[[], None]]

    @abstractmethod
    def error(self) -> BaseException | None:
        """Return with what it has failed; None: it has not, or goes on."""

    @abstractmethod
    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker; return the result.

        Raises:
            TimeoutError: it is still under way after `timeout` [s].
        """

    @abstractmethod
    def wait_until_accepted(self) -> None:
        """Wait until the child has accepted it."""

    @abstractmethod
    def let_go(self) -> None:
        """Have it go on after the command."""

    @abstractmethod
    def drop(self, reason: str) -> None:
        """Nobody waits for it any more: end it. From any thread."""

    @abstractmethod
    def end_with(self, cause: VrError, *, final: bool) -> None:
        """The command is asked to end. From any thread."""

    def result(self, timeout: float | None = None) -> Any:
        """See `CallFuture.result`."""
        return self.frame.in_this_thread().result_of(self, math.inf if timeout is None else timeout)

    def detach(self) -> Self:
        """See `CallFuture.detach`."""
        self.frame.in_this_thread().detach(self)
        return self

    def when_done(self, tell: Callable[[], None]) -> None:
        """See `CallFuture.when_done`."""
        self._tell.append(tell)
        if self.done:
            self.tell_all()

    def tell_all(self) -> None:
        """Tell that it is done. From any thread, also from several at once."""
        while self._tell:
            try:
                tell = self._tell.pop()
            except IndexError:  # another thread has taken it
                return
            tell()


class PendingCall(Started):
    """A child's command under way: the `CallFuture` that the author's code gets."""

    reply: Returned | Raised | None = None
    accepted: bool = False
    accept_by: float = math.inf
    """[s] when the child must have accepted it."""
    oneway: bool = False
    """Whether nobody waits for its end."""
    run_here: Callable[[Worker], None] | None = None
    """Carries the command out on the worker that waits for it: set when it is its turn."""
    ended: Callable[[], None] | None = None
    """Called once it has ended."""
    key_of_child: str = ""
    """Under which a child in another process answers."""
    limit: CallLimit | None = None
    """The time that this call may take; None: as long as the command that makes it."""
    _unlimit: Callable[[], None] | None = None
    """Has the end of that time not noticed."""
    _fraction: float = math.nan
    _awaited: bool = False
    """Whether the caller waits until the child has accepted it."""
    _dropped: bool = False
    """Whether nobody waits for it any more."""
    _error: Exception | None = None

    def __init__(
        self, frame: Frame, slot: str, key: str, child: str, command: str, *, passes_on: bool = False
    ) -> None:
        """Made by the robot that calls.

        Args:
            frame: of the command that calls.
            slot: of the child.
            key: of the call.
            child: name of the child.
            command: of the child.
            passes_on: its progress is that of the command that calls.
        """
        self.slot, self.key, self.child, self.command = slot, key, child, command
        self.detach_at_child: Callable[[], None] = _no_more
        """Has the child go on when the command that called it has ended."""
        self.withdraw: Callable[[str], None] = _nothing
        """Tells the child that nobody wants the call any more, and why."""
        self.frame = frame
        self._passes_on = passes_on
        self._tell = []
        self._may_be_given = [True]
        """Emptied by who decides whether the caller's worker carries the command out: caller or child."""

    # -- a `run.Listener` -------------------------------------------------------------------------------

    def note(self, fraction: float, text: str) -> None:
        """Take how far the child is."""
        self._fraction, frame = fraction, self.frame
        if self._passes_on:
            frame.runtime.note(frame.call_key, fraction, text)
        elif text:
            frame.runtime.note_child(frame.call_key, self.child, text)

    def watch_limit(self, seconds: float) -> None:
        """End it when its time [s] is over."""
        process = self.frame.worker.process
        self._unlimit = process.at(process.runner.now() + seconds, self._be_late)
        if self.reply is not None:
            self._unlimit()

    def _be_late(self) -> None:
        if self.reply is None:
            self.withdraw(f"its caller gave it {self._limit_text}")
            self.fail(self._late())

    @property
    def _limit_text(self) -> str:
        return "" if self.limit is None else self.limit.text

    def _late(self) -> ChildTimeout:
        return ChildTimeout(robot=self.child, command=self.command, limit=self._limit_text)

    def settle(self, reply: Returned | Raised) -> None:
        """Take how it ended."""
        if self.reply is None:
            self.reply = reply
            if self._unlimit is not None:
                self._unlimit()
            if self.ended is not None:
                self.ended()
            if self._tell:
                self.tell_all()
            self.frame.wake()

    def fail(self, error: VrError) -> None:
        """End it with an error of our own."""
        self.settle(Raised.of(error))

    def take_reply(self, reply: Reply | None) -> None:
        """Take one reply from another process; None: there are no more."""
        if reply is None:
            if self.reply is not None or (self._awaited and self.accepted):
                return
            if self.accepted:
                detail = "it ended in the middle; look where the robot stands before you go on"
                self.fail(CommandInDoubt(robot=self.child, command=self.command, detail=detail))
            else:
                self.fail(Unreachable(key=self.key_of_child))
            return
        if isinstance(reply, (Returned, Raised)):
            self.settle(reply)
        elif isinstance(reply, Progress):
            self.note(reply.fraction, reply.text)
        elif isinstance(reply, Accepted):
            self.accepted, self.accept_by = True, math.inf
            if self.oneway and self.ended is not None:
                self.ended()
            if self._awaited:
                self.frame.wake()

    # -- a CallFuture -----------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """See `CallFuture.done`."""
        return self.reply is not None

    @property
    def progress(self) -> float:
        """See `CallFuture.progress`."""
        return self._fraction

    def cancel(self) -> None:
        """See `CallFuture.cancel`."""
        if self.reply is None:
            self.called_off = True
            self.withdraw("its caller has cancelled it")
            self.fail(
                CommandCancelled(robot=self.child, command=self.command, reason="its caller has cancelled it")
            )

    # -- for the frame ----------------------------------------------------------------------------

    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker, or carry the command out there; return the result.

        Raises:
            VrError: what the child raised, or what has ended the waiting command.
            TimeoutError: it is still under way.
        """
        frame = self.frame
        worker = frame.worker
        try:
            while self.reply is None:
                if self.run_here is not None:
                    run, self.run_here = self.run_here, None
                    run(worker)
                else:
                    self._wait(timeout)
        except TimeoutError:
            raise
        except BaseException:
            self.drop("its caller was ended")
            raise
        return self._value()

    def wait_until_accepted(self) -> None:
        """Wait until the child has accepted it.

        Raises:
            VrError: it has refused.
        """
        self._awaited = True
        while not self.accepted and self.reply is None:
            self._wait(math.inf)
        if self.reply is not None:
            self._value()

    def give_turn(self, run: Callable[[Worker], None]) -> bool:
        """Have the caller's worker carry the command out; False: it waits no longer."""
        try:
            self._may_be_given.pop()
        except IndexError:
            return False
        self.run_here = run
        self.frame.wake()
        return True

    def drop(self, reason: str) -> None:
        """Nobody waits for it any more."""
        if self.reply is not None or self._dropped:
            return
        self._dropped = True
        self.withdraw(reason)
        try:
            self._may_be_given.pop()
        except IndexError:  # it is given to us at this moment: somebody else has to take it
            worker = self.frame.worker
            while self.run_here is None and self.reply is None:
                worker.waiter.wait(None)
            if self.run_here is not None:
                run, self.run_here = self.run_here, None
                worker.process.work(run)

    def _wait(self, timeout: float) -> None:
        frame, worker = self.frame, self.frame.worker
        patience = self.accept_by - worker.process.runner.now()
        if not frame.wait(self._is_news, min(timeout, patience)):
            if patience > timeout:
                raise TimeoutError
            if not self.accepted:
                self.withdraw("the caller gave up")
                self.fail(NoAnswer(key=self.key_of_child, seconds=PATIENCE))

    def _is_news(self) -> bool:
        # that it was accepted is looked at when the time for that is over: it wakes nobody
        return self.reply is not None or self.run_here is not None or (self._awaited and self.accepted)

    def _value(self) -> Any:
        reply = self.reply
        if isinstance(reply, Returned):
            value = reply.value
            return readable(value) if isinstance(value, (dict, list)) else value
        assert reply is not None  # noqa: S101 # it is done
        self.frame.expect_to_go_on()  # if the caller itself was asked to end, that is what it is told
        error = self.error()
        assert error is not None  # noqa: S101 # it has failed
        raise error

    def error(self) -> Exception | None:
        """See `Started.error`."""
        if not isinstance(self.reply, Raised):
            return None
        if self._error is None:
            meant = self.frame.runtime.meant(self.slot, self.reply.revive())
            self._error = meant
            if self.limit is not None and isinstance(meant, DeadlineExceeded):
                self._error = self._late()  # the child has noticed it first
            elif isinstance(meant, CommandCancelled):
                self._error = ChildCancelled(**meant.data)
                self._error.trace = meant.trace
        return self._error

    def let_go(self) -> None:
        """See `Started.let_go`."""
        self.detach_at_child()

    def end_with(self, cause: VrError, *, final: bool) -> None:
        """See `Started.end_with`: it ends when the command does, or when its clean-up begins."""


class Branch(Started):
    """A part of a command that runs on another worker: a function that `both.start(function)` has started."""

    def __init__(self, owner: Frame, number: str, work: Callable[[], Any]) -> None:
        """Made by the frame of the command; `run` is for a worker."""
        self._tell = []
        self.frame, self._number, self._work = owner, number, work
        self._own: Frame | None = None
        self._dropped: CommandCancelled | None = None
        self._value: Any = None
        self._error: BaseException | None = None
        self.at_rest = False

    def run(self, worker: Worker) -> None:
        """Carry it out."""
        owner = self.frame
        frame = self._own = owner.part(self._number, worker)
        if self._dropped is not None:
            frame.cause = self._dropped
        self._value, self._error = frame.run(self._work)
        frame.end()
        if worker.dead:
            owner.runtime.gone(owner.call_key)
        self._end()

    def _end(self) -> None:
        self.at_rest = True
        self.tell_all()
        self.frame.wake()

    @property
    def done(self) -> bool:
        """See `CallFuture.done`."""
        return self.at_rest or self._dropped is not None

    @property
    def progress(self) -> float:
        """See `CallFuture.progress`."""
        return math.nan

    def error(self) -> BaseException | None:
        """See `Started.error`."""
        return self._dropped or self._error

    def get(self, timeout: float = math.inf) -> Any:
        """See `Started.get`."""
        if not self.frame.wait(lambda: self.done, timeout):
            raise TimeoutError
        error = self.error()
        if error is not None:
            raise error
        return self._value

    def wait_until_accepted(self) -> None:
        """See `Started.wait_until_accepted`."""

    def let_go(self) -> None:
        """See `Started.let_go`."""
        raise TypeError("a function of this page ends with its command; only a child's command can go on")

    def drop(self, reason: str) -> None:
        """See `Started.drop`."""
        if self.done:
            return
        owner = self.frame
        self._dropped = CommandCancelled(
            robot=owner.runtime.name, command=owner.context.command, reason=reason
        )
        if self._own is not None:
            self._own.cancel(self._dropped)

    def cancel(self) -> None:
        """See `CallFuture.cancel`."""
        if not self.done:
            self.called_off = True
            self.drop("its caller has cancelled it")

    def end_with(self, cause: VrError, *, final: bool) -> None:
        """See `Started.end_with`."""
        if self._own is not None and not self.at_rest:
            self._own.cancel(cause, final=final)


class Group:
    """See the module. It is the `Together` and the `Race` that the author's code sees."""

    def __init__(self, frame: Frame, *, first: bool) -> None:
        """Made by the frame.

        Args:
            frame: whose parts they are.
            first: the first success decides, not the first failure.
        """
        self._frame, self._first = frame, first
        self.outer: Group | None = None
        """The group around it."""
        self.parts: list[Started] = []
        self._ended: list[Started] = []
        """Those that have ended, in that order."""
        self._results: list[Any] | None = None
        self._open = False

    # -- for the author ---------------------------------------------------------------------------

    def __enter__(self) -> Self:
        self._frame.open_group(self)
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open = False
        self._frame.close_group(self, error)

    def start(self, work: Callable[..., Any], /, *values: Any, **arguments: Any) -> CallFuture:
        """Start a child's command (`both.start(self.left.go_to, x=0.3)`) or a function of the page.

        Returns:
            The same as `.start` of a child's command: its result can also be asked for inside the block.
        """
        frame = self._frame
        if not self._open or frame.in_this_thread() is not frame:
            raise RuntimeError("start parts inside of the `with` block, in the thread that has opened it")
        inner, frame.group = frame.group, self
        try:
            if isinstance(work, ChildCommand):
                return work.start(*values, **arguments)
            return frame.branch(partial(work, *values, **arguments))
        finally:
            frame.group = inner

    @property
    def results(self) -> list[Any]:
        """The results of all, in the order in which they were started; after the block.

        None for a part that the page itself has cancelled.
        """
        if self._results is None:
            raise RuntimeError("the results are there after the `with` block")
        return self._results

    @property
    def result(self) -> Any:
        """The result of the first that succeeded; after the block."""
        return self.results[0]

    @property
    def winner(self) -> int:
        """Which one that was, counted from 0 in the order of the starts; after the block."""
        if self._results is None:
            raise RuntimeError("the winner is known after the `with` block")
        assert self._decisive is not None  # noqa: S101 # else the block has raised
        return self.parts.index(self._decisive)

    # -- for the frame ----------------------------------------------------------------------------

    @property
    def _decisive(self) -> Started | None:
        return next(filter(self._decides, self._ended), None)

    def _decides(self, part: Started) -> bool:
        succeeded = part.error() is None
        return succeeded if self._first else not (succeeded or part.called_off)

    @property
    def decided(self) -> str:
        """Why nothing more is to begin, as words; empty: it may."""
        if self._decisive is None:
            return ""
        return "another one has succeeded" if self._first else "another one has failed"

    def is_over(self) -> bool:
        """Whether nothing is to be waited for any more."""
        return self._decisive is not None or all(part.done for part in self.parts)

    def check(self) -> None:
        """Raise the first failure, of this group or of those around it.

        Raises:
            BaseException: what a part has raised.
        """
        if not self._first and self._decisive is not None:
            error = self._decisive.error()
            assert error is not None  # noqa: S101 # it has failed
            raise error
        if self.outer is not None:
            self.outer.check()

    def add(self, part: Started) -> None:
        """Take a part in."""
        self.parts.append(part)
        part.when_done(lambda: self._note(part))

    def leave(self, part: Started) -> None:
        """Let a part go on by itself."""
        if part in self.parts:
            self.parts.remove(part)

    def take_results(self) -> None:
        """Read the results when it is over.

        Raises:
            Failed: none of those of which one was to succeed has.
        """
        decisive = self._decisive
        if not self._first:
            self.check()
            self._results = [None if part.called_off else part.get() for part in self.parts]
        elif decisive is not None:
            self._results = [decisive.get()]
        else:
            raise self._none()

    def _none(self) -> Failed:
        if not self.parts:
            return Failed("nothing was started in the block of `first`")
        errors = [part.error() for part in self.parts]
        told = "; ".join(
            str(error) if isinstance(error, VrError) else words_of(error) for error in errors if error
        )
        failed = Failed(f"none of {len(errors)} has succeeded: {told}")
        failed.__cause__ = errors[0]
        return failed

    def _note(self, part: Started) -> None:
        """A part has ended. From any thread."""
        if part not in self.parts:
            return
        self._ended.append(part)
        reason = self.decided
        for other in tuple(self.parts) if reason else ():
            other.drop(reason)
        self._frame.wake()


def _never() -> bool:
    return False


def _nothing(_: str) -> None:
    """Tell nobody."""


def _no_more() -> None:
    """Do nothing."""
