"""A running command as the code inside of it sees it, and how a robot's runtime has a call carried out."""

from __future__ import annotations

import contextlib
import inspect
import math
from collections.abc import Callable, Generator, Iterable, Mapping
from functools import partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import msgspec

from robotree.vr.author.child import ChildCommand, Exposed
from robotree.vr.author.context import CallFuture, CallLimit, CommandContext, WhichValue
from robotree.vr.author.readings import Record
from robotree.vr.author.robot import Robot
from robotree.vr.author.signature import Command, ResumePolicy
from robotree.vr.author.together import Group, Race, Started, Together
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import Arguments
from robotree.vr.base.errors import (
    CannotMove,
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    NoHostBeside,
    NoSuchCommand,
    VrError,
    words_of,
)
from robotree.vr.base.requests import LONGEST_CLEANUP, AnyRequest, Level, Raised, Reply, Returned, State
from robotree.vr.core import events as on
from robotree.vr.core.machine import RobotState
from robotree.vr.running.catching import at_work
from robotree.vr.running.child_call import CallManner, ChildCall, call_child
from robotree.vr.running.feed import Feeds, NoReadingYet
from robotree.vr.running.frame import Abandoned, Branch, Frame
from robotree.vr.running.ice import GoneOn
from robotree.vr.running.own_errors import raised
from robotree.vr.running.page_trace import begin_of
from robotree.vr.running.process import Worker
from robotree.vr.running.replay import Replay
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.run import Run
from robotree.vr.running.space_asking import ask_space, tell_space

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
A = TypeVar("A", bound=Frame)


LARGEST_STEP = 4096
"""[bytes] of a value of a stream that is kept as the result of a step."""
ASKS = 0.1
"""[s] between two looks whether another part of the command still asks a person."""


def _from_author(method: Callable[Concatenate[A, P], R]) -> Callable[Concatenate[A, P], R]:
    """Make a method a cancellation point: the author's code is not at work while it runs."""

    @wraps(method)
    def called(self: A, /, *values: P.args, **named: P.kwargs) -> R:
        worker = self.leave_author()
        try:
            return method(self, *values, **named)
        finally:
            worker.arm(self)

    return called


class CommandActivity(Frame):
    """A running command, or a part of it: what `context.Activity` describes."""

    done_by_person: bool = False
    """Whether a person has said after a crash that it is done: its result is not known."""
    opened: Feeds | None = None
    """The result of `feeds`; None: nobody has asked for it."""

    @property
    def activity(self) -> CommandActivity:
        """The command as its code sees it."""
        return self

    @property
    def simulated(self) -> bool:
        """Whether it runs in virtual time."""
        return self.worker.process.runner.simulated

    def now(self) -> float:
        """Return the time [s] on a monotonic clock."""
        return self.worker.now()

    def random(self) -> float:
        """Return a number from 0 up to but not including 1."""
        return self.worker.process.runner.random()

    # -- waiting and telling ----------------------------------------------------------------------

    def check(self) -> None:
        """Raise the error that ends the command, if it has been asked to end."""
        self.leave_author().arm(self)

    @_from_author
    def sleep(self, seconds: float) -> None:
        """Wait [s]."""
        if math.isnan(seconds):
            raise ValueError("cannot sleep for NaN seconds")
        end = self.taken("sleep", lambda: self.now() + max(seconds, 0.0))
        self.wait(_never, end - self.now())

    @_from_author
    def wait_for(self, condition: Callable[[], bool], timeout: float = math.inf) -> bool:
        """Wait until something is so, `timeout` [s] at most; returns whether it is."""
        return bool(self.taken("wait", lambda: self.wait(condition, timeout)))

    @_from_author
    def receive(self, look: Callable[[], T | None], every: float) -> T:
        """Wait for something from outside, as one step; looked for when woken and every so often [s]."""
        return cast("T", self.taken(on.RECEIVED, partial(self._received, look, every)))

    def _received(self, look: Callable[[], T | None], every: float) -> T:
        found: T | None = None

        def is_there() -> bool:
            nonlocal found
            self.worker.arm(self)  # code of the page is at work
            try:
                found = look()
            finally:
                self.worker.disarm()
            return found is not None

        while not self.wait(is_there, every):
            pass
        return cast("T", found)

    def is_under_way(self, command: str) -> bool:
        """Whether a command of the robot has begun and not ended."""

        def look(state: RobotState) -> bool:
            return any(call.running and call.command == command for call in state.calls.live.values())

        return self.runtime.look(look)

    @_from_author
    def progress(self, fraction: float, text: str) -> None:
        """Tell how far the command is."""
        if not self.replaying:
            self.runtime.note(self.call_key, float(fraction), str(text))

    @_from_author
    def observe(self, look: Callable[[], Any]) -> Any:
        """Read something that may be another thing the next time."""
        if self.looks:
            return look()
        path = self.step()
        if not self.keeps:
            return look()
        step = self.recalled(path, "look")
        if step is not None and step.content is None:
            return step.value
        value = look()
        if step is None:  # what is no plain data is looked at again
            self.keep_step(path, _kept_look(value))
        return value

    @_from_author
    def move_to(self, host: str) -> None:
        """Go on in another host; what follows is carried out there."""
        path, runtime = self.step(), self.runtime
        step = self.recalled(path, "move", host)
        if step is not None:
            if step.value:
                raise CannotMove(robot=runtime.name, host=host, reason=step.value)
            return
        reason = ""
        if runtime.look(lambda state: state.home) != f"host {host}":
            self.hold(path, "move", host)
            outcome: list[VrError | None] = []

            def done(error: VrError | None) -> None:
                outcome.append(error)
                self.wake()

            if runtime.on_move is None:
                outcome.append(CannotMove(robot=runtime.name, host=host, reason="its process is no host"))
            else:
                runtime.on_move(host, done)
            self.wait(lambda: bool(outcome))
            if (error := outcome[0]) is not None:
                reason = str(error.data.get("reason", error))
        self.keep_step(path, on.StepResult("move", host, reason))
        if reason:
            raise CannotMove(robot=runtime.name, host=host, reason=reason)

    def host_of(self, slot: str) -> str:
        """Return the host on which the child in a slot lives, or one that is beside it."""
        return str(self.observe(partial(self._located, slot)))

    def _located(self, slot: str) -> str:
        runtime, outcome = self.runtime, list[str | VrError]()
        if runtime.on_locate is None:
            raise NoHostBeside(robot=slot, reason=f"the process of {runtime.name} is no host")

        def done(found: str | VrError) -> None:
            outcome.append(found)
            self.wake()

        runtime.on_locate(slot, done)
        self.wait(lambda: bool(outcome))
        if isinstance(found := outcome[0], VrError):
            raise found
        return found

    @_from_author
    def checkpoint(self) -> None:
        """Need the steps of this round no more: interrupted, the command goes on from here."""
        if self.commander is not None:
            raise RuntimeError("self.checkpoint() is for the command itself, not for a part of it")
        place = " in ".join(f"line {at.f_lineno}" for at in at_work(inspect.currentframe(), self))
        if (replay := self.replay) is not None and replay.active and self._comes_to(place, replay):
            return
        if isinstance(self.runtime.robot, VirtualRobot):
            self.runtime.robot.field_values.keep(self.call_key)
        self.runtime.checkpoint(self.call_key, place)
        self.steps = self.reads = 0

    def _comes_to(self, place: str, replay: Replay) -> bool:
        """Whether it comes to a checkpoint that it made before: it goes on with the last lap from there.

        Raises:
            Diverged: it has left steps out.
        """
        if error := replay.left_out(f"a checkpoint at {place}"):
            raise error
        run = self.run
        if not run.ahead or run.ahead[0].place != place:
            self._catch_up(replay)  # this one was lost with the process
            return False
        lap, *ahead = run.ahead
        run.begin_lap(lap)
        run.ahead = tuple(ahead)
        replay.begin_lap(self._suffix(f"{self.context.key}/{run.lap}"))
        self.steps = self.reads = 0
        if isinstance(self.runtime.robot, VirtualRobot):
            self.runtime.robot.field_values.forget(self.call_key)
        return True

    def forget_steps(self) -> None:
        """Begin anew, with other keys: what was done before is done once more."""
        self.runtime.checkpoint(self.call_key)
        self.run.recall = self.replay = None
        self.run.ahead = ()

    @_from_author
    def decide(self, question: str) -> str:
        """Ask a person, and wait for the answer: `done`, `again` or `abort`."""
        replay, self.replay = self.replay, None  # so that an order to end it counts at once
        try:
            return self._ask(question)
        finally:
            self.replay = replay

    @_from_author
    def ask_person(self, question: str) -> str:
        """Ask a person as soon as nobody else of this command asks one; see `decide`."""
        return self._ask(question)

    def _ask(self, question: str) -> str:
        run = self.run
        while run.asks is not None and run.asks is not self:
            self.wait(lambda: run.asks is None, ASKS)
        self.expect_to_go_on()  # its command may have ended while another part asked
        run.asks = self
        try:
            run.wake, run.answer = self.wake, ""
            self.runtime.ask_person(self.call_key, question)
            self.wait(lambda: bool(run.answer))
            return run.answer
        finally:
            run.asks = None
            self.runtime.stop_asking(self.call_key)

    def resume(self) -> None:
        """Have the page look how the world is after a crash, before the first new step."""
        process = self.runtime.process
        if self.runtime.came:  # it has only moved: nothing has happened that it does not know
            return
        part = self.part(f"r{process.life}", self.worker)
        part.replay = None
        _, error = part.carry_out(partial(self.runtime.robot.on_resume, process.gap))
        if error is not None:
            raise error

    def keep(self, change: Callable[[], None]) -> None:
        """Change what the robot keeps; no cancellation point."""
        worker = self.worker
        if self.replaying:
            return
        if worker.here() != worker.thread:  # a thread that the command was handed on to
            change()
            return
        worker.disarm()
        try:
            if worker.dead or self.runtime.has_left:
                self.expect_to_go_on()
            change()
        finally:
            worker.arm(self)

    def kept(self, name: str, value: Any) -> Any:
        """Return what the robot keeps in a field at this place of the page; `value`: what it keeps now.

        A value that somebody else has changed meanwhile is a step: taken again, the page reads it here.
        """
        replay = self.replay if self.replaying else None
        known = self.run.fields.get(name, value)
        if not self.keeps or self.looks:
            return value if replay is None else known
        self.reads += 1
        content = [name, self.reads]
        if replay is None:
            if known is value:
                return value
            if known != value:
                self.keep_step(self.step(), on.StepResult("field", content, value))
        else:
            following = self._suffix(f"{self.context.key}/{self.run.lap}{self.steps + 1}")
            if not replay.has(following, "field", content):
                return known
            step = self.recalled(self.step(), "field")
            value = None if step is None else step.value
        self.run.fields = {**self.run.fields, name: value}
        return value

    def keep_values(self, values: dict[str, Any], change: Callable[[dict[str, Any]], None]) -> None:
        """Keep other values in fields; no cancellation point."""
        if self.replay is not None and self.replay.active:
            self.replay.rewritten |= values
        else:
            self.keep(lambda: change(values))
        if self.keeps:
            self.run.fields = {**self.run.fields, **values}

    def say(self, level: Level, text: str, *, piece: bool = False) -> None:
        """Enter a text, or a piece of a line, in the robot's log; no cancellation point."""
        self.keep(lambda: self.runtime.say(self.context.key, level, text, piece=piece))

    # -- readings of children ---------------------------------------------------------------------

    @property
    def feeds(self) -> Feeds:
        """The readings of children that it follows."""
        if self.opened is None:
            self.opened = Feeds(self)
        return self.opened

    @_from_author
    def next_reading(self, slot: str, after: int, at: float) -> tuple[int, Any]:
        """Wait until `at` [s], and then for readings of a child that are newer than those of a number."""
        number = after

        def next_reading() -> Any:
            nonlocal number
            self.feeds.of(slot)
            self.wait(_never, at - self.now())
            number, reading = self.feeds.next_reading(slot, after)
            return dict(reading)

        reading = Record(self.taken("reading", next_reading, slot))
        return number, reading

    @_from_author
    def reading(self, slot: str) -> Any:
        """Return the latest readings of a child. In a condition, nothing waits and it is no step.

        Raises:
            NoReadingYet: a condition asks before anything has been published.
        """
        if not self.looks:
            look = self.feeds.next_reading
            return Record(self.taken("reading", lambda: dict(look(slot, 0)[1]), slot))
        latest = self.feeds.of(slot).latest
        if latest is None:
            raise NoReadingYet
        return latest

    @_from_author
    def next_sample(
        self, slot: str, stream: str, which: WhichValue, *, at: float = 0.0, limit: CallLimit | None = None
    ) -> Any:
        """Return a value of a stream of the robot that is watched in a slot. A step.

        What is larger than `LARGEST_STEP` is not kept: after a crash the step gives a later value.
        """
        taken: list[Any] = []

        def take() -> list[Any] | str:
            self.wait(_never, at - self.now())
            try:
                taken.append(self.feeds.next_sample(slot, stream, which, limit))
            except TimeoutError as late:
                return str(late)
            return taken if len(msgspec.msgpack.encode(taken)) <= LARGEST_STEP else []

        step = self.taken("sample", take, [slot, stream, which])
        if isinstance(step, str):
            raise TimeoutError(step)
        if not (step or taken):
            taken.append(self.feeds.next_sample(slot, stream, which, None))
        return (step or taken)[0]

    @_from_author
    def published(self, slot: str) -> State | None:
        """Return the latest state that the child in a slot has published; None: none yet."""
        return self.feeds.of(slot).state

    @_from_author
    def wait_until(self, condition: Callable[[], object], limit: CallLimit | None) -> None:
        """Wait until a condition on readings of children is true."""
        path = self.step()
        step = self.recalled(path, "until")
        if step is not None and step.value:
            raise TimeoutError(step.value)
        if step is None:
            self.hold(path, "wait until")
            try:
                self.feeds.wait_until(condition, limit)
            except TimeoutError as late:
                self.keep_step(path, on.StepResult("until", None, str(late)))
                raise
            self.keep_step(path, on.StepResult("until"))

    # -- calls of children ------------------------------------------------------------------------

    def call(
        self, slot: str, command: str, arguments: Mapping[str, Any], limit: CallLimit | None = None
    ) -> Any:
        """Call a child's command, wait for its end and return the result."""
        worker = self.leave_author()
        try:
            # with a limit this worker stays free to notice that it is over
            manner: CallManner = "started" if self.guest or limit else "awaited"
            return call_child(self, slot, command, arguments, manner, limit=limit).get()
        finally:
            worker.arm(self)

    @_from_author
    def pass_on(self, slot: str, command: str, arguments: Mapping[str, Any]) -> Any:
        """Carry out an exposed command: call the child's, and report its progress as our own."""
        return call_child(self, slot, command, arguments, "passed on").get()

    @_from_author
    def start(
        self, slot: str, command: str, arguments: Mapping[str, Any], limit: CallLimit | None = None
    ) -> ChildCall:
        """Call a child's command; it ends with the running command at the latest."""
        decided = "" if self.group is None else self.group.decided
        pending = call_child(self, slot, command, arguments, "started", instead=decided, limit=limit)
        self._keep(pending)
        return pending

    @_from_author
    def tell(self, slot: str, command: str, arguments: Mapping[str, Any]) -> None:
        """Call a child's command and wait only until the child has accepted it; it goes on by itself."""
        call_child(self, slot, command, arguments, "told").wait_until_accepted()

    @_from_author
    def result_of(self, part: Started, timeout: float) -> Any:
        """Wait for a part, `timeout` [s] at most, and return its result."""
        if not self.keeps:
            return part.get(timeout)
        path = self.step()
        step = self.recalled(path, "result")
        if step is not None and step.value:
            raise TimeoutError
        try:
            return part.get(timeout if step is None else math.inf)
        except TimeoutError:
            self.keep_step(path, on.StepResult("result", None, "late"))
            raise
        finally:
            if step is None and part.done:
                self.keep_step(path, on.StepResult("result"))

    @_from_author
    def let_go_on(self, part: Started) -> None:
        """Let a part go on after the command, as soon as the child has accepted it."""
        part.wait_until_accepted()
        part.let_go()
        with contextlib.suppress(ValueError):
            self.started.remove(part)
        if self.group is not None:
            self.group.leave(part)

    # -- several at once --------------------------------------------------------------------------

    def together(self, *, first: bool) -> Group:
        """Return a `Together`, or a `Race` in which the first success decides."""
        return Race(self) if first else Together(self)

    @_from_author
    def open_group(self, group: Group) -> None:
        """Have what is started from now on belong to a group."""
        group.outer, self.group = self.group, group

    def start_part(
        self, group: Group, work: Callable[..., Any], values: tuple[Any, ...], arguments: dict[str, Any]
    ) -> CallFuture:
        """Start a child's command, or a function of the page on another worker, as a part of a group."""
        inner, self.group = self.group, group
        try:
            if isinstance(work, ChildCommand):
                return work.start(*values, **arguments)
            return self._branch(group, partial(work, *values, **arguments))
        finally:
            self.group = inner

    @_from_author
    def _branch(self, group: Group, work: Callable[[], Any]) -> Branch:
        self.steps += 1
        branch = Branch(self, f"{self.run.lap}{self.steps}", work)
        if group.decided:
            branch.drop(group.decided)
            branch.at_rest = True
        else:
            self.worker.process.work(branch.run)
        self._keep(branch)
        return branch

    def _keep(self, part: Started) -> None:
        self.started.append(part)
        if self.group is not None:
            self.group.add(part)
        if self.over:  # it was the last act of a thread that worked for the command
            part.drop("the command that started it has ended")

    def close_group(self, group: Group, error: BaseException | None) -> None:
        """Wait until all of a group have ended, or it is decided; end what still runs.

        Raises:
            VrError: the first failure of the group, or the one that has ended the command.
        """
        worker = self.worker
        worker.disarm()
        try:
            if error is None:
                self._await_group(group)
                group.take_results()
        finally:
            self.group = group.outer
            for part in group.parts:
                part.drop("the others were ended with it")
            while not all(part.at_rest for part in group.parts):
                worker.waiter.wait(None)
            worker.arm(self)

    def _await_group(self, group: Group) -> None:
        """Wait until a group is over; taken again, the part decides that decided it before."""
        if not self.keeps:
            self.wait(group.is_over)
            return
        path = self.step()
        step = self.recalled(path, "group")
        if step is not None:
            group.decide(step.value)
            self.wait(group.is_over)
            return
        self.wait(group.is_over)
        self.keep_step(path, on.StepResult("group", None, group.number_of_decisive))

    # -- the space --------------------------------------------------------------------------------

    @_from_author
    def ask_space(self, space: str, request: AnyRequest) -> Reply:
        """Ask a space, and wait for its answer."""
        return ask_space(self, space, request)

    def send_to_space(self, space: str, request: AnyRequest) -> None:
        """Tell a space something, without waiting; no cancellation point."""
        self.keep(lambda: tell_space(self, space, request))

    # -- clean-up ---------------------------------------------------------------------------------

    @contextlib.contextmanager
    def cleanup(self, within: float) -> Generator[None]:
        """Let the code inside the block command children though the command has been asked to end."""
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
        if self.runtime.has_left:
            raise GoneOn
        if self.final and (cause := self.cause) is not None:
            reason = f"{cause.data.get('reason', cause)}; after that no clean-up may move anything"
            raise CommandCancelled(robot=self.runtime.name, command=self.context.command, reason=reason)
        for part in tuple(self.started):
            part.drop("the clean-up of the command that started it has begun")
        before, self.shield = self.shield, self.now() + within
        until = self.taken("cleanup", lambda: self.shield) if self.keeps else self.shield
        self.shield = min(until, before) if before > -math.inf else until
        self.deadline_at, self.group = self.shield, None

    @_from_author
    def expect_all_taken(self) -> None:
        """Take note that the page has ended, also without a new step after those that it took before.

        Raises:
            Diverged: it has left one out.
        """
        if (replay := self.replay) is not None and replay.active:
            if error := replay.left_out():
                raise error
            self._catch_up(replay)

    def end(self) -> None:
        """End what its code, which has ended, has started and not detached."""
        super().end()
        if self.opened is not None:
            self.opened.close()


# -- how a call is carried out ---------------------------------------------------------------------


def execute(runtime: RobotRuntime, key: str, run: Run, worker: Worker) -> None:
    """Carry out a call whose turn it is, on a worker, on top of what is there."""
    context, robot, command, arguments, exposed = runtime.turn_of(key, run)
    activity = CommandActivity(runtime, run, context, worker)
    run.interrupt = activity.interrupt
    work = _work_of(activity, robot, command, arguments, exposed)
    if run.recall is not None:
        work = _resumed(activity, command, work)
    if worker.top is None:
        worker.process.runner.name_thread(f"{robot.name}.{context.command}")
    value, error = activity.carry_out(work)
    run.interrupt = None
    activity.over = True  # from now on a thread that works for it reaches no child
    if runtime.has_left:  # it goes on elsewhere
        return
    if activity.started or activity.guests or activity.opened is not None:
        activity.end()
    if isinstance(robot, VirtualRobot) and not worker.dead:
        try:
            robot.field_values.settle(key)
        except TypeError as refusal:
            error = error or refusal
    reply = _reply(runtime, context, None if activity.done_by_person else command, value, error)
    if worker.dead:
        runtime.gone(key)
    else:
        runtime.post(on.Finish(key=key, reply=reply))


def _work_of(
    activity: CommandActivity,
    robot: Robot,
    command: Command | None,
    arguments: Arguments,
    exposed: Exposed | None,
) -> Callable[[], Any]:
    """Return what carries out a call: see `RobotRuntime.turn_of`."""
    runtime = activity.runtime
    if command is not None:
        if runtime.turned:
            return partial(_check_again, command, robot, arguments)
        return partial(command.run, robot, arguments)
    if exposed is not None:
        return partial(_pass_on, activity, exposed, arguments)
    return partial(runtime.spec, activity.context.command)  # it was accepted for another page


def _resumed(
    activity: CommandActivity, command: Command | None, work: Callable[[], Any]
) -> Callable[[], Any]:
    """Return what carries out a call whose process has ended in the middle."""
    if activity.runtime.came:  # it has moved, and was not interrupted
        return partial(_again, activity, work)
    if refusal := _cannot_go_on(activity, command):
        return partial(_refuse, refusal)
    policy = _policy(activity, command)
    if policy == "restart":
        activity.forget_steps()
    again = partial(_again, activity, work)
    return partial(_asked, activity, again) if policy == "ask" else again


def _again(activity: CommandActivity, work: Callable[[], Any]) -> Any:
    """Carry a page out once more, from its beginning."""
    value = work()
    activity.expect_all_taken()
    return value


def _policy(activity: CommandActivity, command: Command | None) -> ResumePolicy:
    """Return what an interrupted command does: what its author has said, if it is not too late for that."""
    if command is None:
        return "continue"
    policy, stale_after = command.resumption
    return "ask" if policy == "continue" and activity.runtime.process.gap > stale_after else policy


def _refuse(error: VrError) -> None:
    raise error


def _asked(activity: CommandActivity, work: Callable[[], Any]) -> Any:
    """Let a person decide whether an interrupted command goes on."""
    label = f"{activity.runtime.name}.{activity.context.command}"
    answer = activity.decide(f"{label} was interrupted {activity.runtime.process.gap:.0f} s ago")
    if answer == "done":
        activity.replay, activity.done_by_person = None, True
        return None
    if answer == "abort":
        raise _in_doubt(activity, "a person has ended it")
    return work()


def _in_doubt(activity: CommandActivity, reason: str) -> CommandInDoubt:
    detail = f"its process ended in the middle, and it does not go on: {reason}"
    return CommandInDoubt(robot=activity.runtime.name, command=activity.context.command, detail=detail)


def _cannot_go_on(activity: CommandActivity, command: Command | None) -> VrError | None:
    """Return why a command that was interrupted cannot go on; None: it can."""
    recall, key = activity.run.recall or {}, activity.call_key
    if command is not None and command.resumption.policy == "abort":
        reason = "its page says resume='abort'"
    elif any(path.endswith(on.THREAD) for path in recall):
        reason = "it used a thread of its page's own, whose steps are not kept"
    elif activity.runtime.look(lambda state: state.calls.live[key].forgotten):
        reason = "it took more steps than are kept, without self.checkpoint()"
    else:
        return None
    return _in_doubt(activity, reason)


def _check_again(command: Command, robot: Robot, sent: Arguments) -> Any:
    """Carry a command out whose arguments may have been checked for another page."""
    return command.run(robot, check_arguments(command.spec, sent, robot=robot.name))


def _pass_on(activity: CommandActivity, exposed: Exposed, arguments: Arguments) -> Any:
    """Carry out an exposed command, in the units of its callers."""
    slot, command = exposed.child.name, exposed.command
    if not exposed.units:
        return activity.pass_on(slot, command, arguments)
    spec = activity.runtime.child_spec(slot, command)
    if spec is None:
        raise NoSuchCommand(robot=str(slot), command=command, known="none")
    return exposed.for_caller(spec, activity.pass_on(slot, command, exposed.for_child(spec, arguments)))


def _reply(
    runtime: RobotRuntime,
    context: CommandContext,
    command: Command | None,
    value: Any,
    error: BaseException | None,
) -> Returned | Raised:
    name = runtime.name
    try:
        if error is None:
            if command is not None:
                value = command.plain_result(value, robot=name, name=context.command)
            return Returned(key=context.key, value=value)
    except Exception as refusal:  # noqa: BLE001 # the author's value may raise anything
        words = refusal.data["detail"] if isinstance(refusal, CommandFailed) else words_of(refusal)
        place = "" if command is None else f" ({begin_of(command.function)})"
        error = CommandFailed(robot=name, command=context.command, detail=f"{words}{place}")
    runtime.process.on_raise(name, error)
    return raised(name, context, error, source=runtime.source_of(context.command))


def _kept_look(value: Any) -> on.StepResult:
    if isinstance(value, list):  # of the numbers of the members of a group
        numbers = list(cast("Iterable[Any]", value))
        plain, value = all(map(_is_plain, numbers)), numbers
    else:
        plain = _is_plain(value)
    return on.StepResult("look", None, value) if plain else on.StepResult("look", "object")


def _is_plain(value: Any) -> bool:
    """Whether a value that was looked at can be kept as it is."""
    if isinstance(value, int):
        return -(2**63) <= value < 2**63  # those that MessagePack can write
    return isinstance(value, (float, str, bytes, type(None)))


def _never() -> bool:
    return False
