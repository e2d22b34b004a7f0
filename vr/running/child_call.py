"""Calls of children: a child in this process is called directly, one in another process is asked.

A parent's command that calls a child in the same process carries the child's command out on its own worker,
as one more frame, when the child is idle; else it waits for its turn or for a worker of the child's own.
"""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType
from typing import Any, Literal, cast

from msgspec import to_builtins
from msgspec.structs import replace

from robotree.vr.author.child import readable
from robotree.vr.author.context import Activity, CallLimit
from robotree.vr.author.together import Started
from robotree.vr.base.address import Address
from robotree.vr.base.errors import (
    ChildCancelled,
    ChildTimeout,
    CommandCancelled,
    CommandInDoubt,
    DeadlineExceeded,
    LeaseError,
    NoAnswer,
    SlotEmpty,
    Unreachable,
    VrError,
)
from robotree.vr.base.plain import READY, to_plain
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    Accepted,
    Attend,
    Call,
    Cancel,
    Detach,
    Moved,
    Progress,
    Raised,
    Reply,
    Returned,
)
from robotree.vr.core import events as on
from robotree.vr.running import doubt
from robotree.vr.running.catching import catches
from robotree.vr.running.frame import Frame
from robotree.vr.running.ice import Frozen
from robotree.vr.running.page_trace import page_line
from robotree.vr.running.process import Worker
from robotree.vr.running.replay import Intent
from robotree.vr.running.robot_runtime import NotDescribed, RobotRuntime

ABSENCE = 0.02
"""[s] after which a caller looks again whether a child is back whose process has ended."""
DEEPEST = 32
"""Frames on one worker; a call below that is handed to another one."""

CallManner = Literal["awaited", "started", "told", "passed on"]
"""How a command calls a child. awaited: it waits for the end, so its worker may carry the child's command
out. started: it goes on meanwhile. told: it waits until the child has accepted it. passed on: it waits, and
the progress of the child is its own."""


def call_child(  # who calls whom, how, and for how long
    frame: Frame,
    slot: str,
    command: str,
    arguments: Mapping[str, Any],
    manner: CallManner,
    *,
    instead: str = "",
    limit: CallLimit | None = None,
) -> ChildCall:
    """Call the child in a slot, as one step of a running command, within that command's deadline.

    Args:
        frame: of the running command.
        slot: of the child.
        command: of the child.
        arguments: by name.
        manner: whether the caller waits for it, and for what.
        instead: why it is not to begin any more: it ends at once; empty: it is.
        limit: the time that it may take; None: as long as the command.

    Raises:
        VrError: the slot is empty, or the child refuses.
    """
    key = frame.step()
    kind = "tell" if manner == "told" else "call"
    content, intent, given = None, None, dict(arguments)
    if frame.keeps:
        content = (slot, command, _plain(given))
        if frame.replay is not None:
            if (step := frame.recalled(key, kind, list(content))) is not None:
                return ChildCall.recalled(frame, slot, key, command, step)
            intent = frame.replay.intent(key[len(frame.call_key) + 1 :])
    if frame.runtime.paused and not (instead or intent or _has_begun(frame, slot, key)):
        frame.hold(key, kind, [slot, command, arguments], of_page=manner != "passed on")
    try:
        child, epoch, lost = _whom(frame, slot, intent)
        if frame.runtime.permissions is not None:
            frame.runtime.expect_permitted(slot, command)
        pending = ChildCall(frame, slot, key, child, command, limit, passes_on=manner == "passed on")
        pending.content, pending.arguments, pending.manner = content, given, manner
        if instead:
            pending.fail(CommandCancelled(robot=child.name, command=command, reason=instead))
        else:
            pending.begin(epoch, intent, lost)
    except VrError as error:  # the page has seen it: after a crash it must see the same
        frame.keep_step(key, on.StepResult(kind, content, None, Raised.of(error)))
        raise
    return pending


def _whom(frame: Frame, slot: str, intent: Intent | None) -> tuple[Address, int, str]:
    """Return the child to call, the epoch of its lease, and why it is gone if it was called before."""
    try:
        return *frame.runtime.child_in(slot), ""
    except SlotEmpty as error:
        before = None if intent is None else Address.parse(intent.child)
        if before is None:
            raise
        return before, 0, str(error.data["reason"])


class ChildCall(Started):
    """A child's command under way: the `CallFuture` that the author's code gets, and a `run.Listener`."""

    reply: Returned | Raised | None = None
    accepted: bool = False
    accept_by: float = math.inf
    """[s] when the child must have accepted it."""
    run_here: Callable[[Worker], None] | None = None
    """Carries the command out on the worker that waits for it: set when it is its turn."""
    _neighbour: RobotRuntime | None = None
    """The child, if it lives in this process."""
    _sent: Call | None = None
    """The call, if a child in another process was asked."""
    _given: Call | None = None
    """The call, if a child in this process was given it."""
    _follows: bool = False
    """Whether the child goes on in another process, where it can be asked at once."""
    _ends: float = math.inf
    """[s] when the child must have ended it."""
    _leave: tuple[Callable[[], object], ...] = ()
    """Called once it has ended."""
    _unlimit: Callable[[], None] | None = None
    """Has the end of its time not noticed."""
    _fraction: float = math.nan
    _awaited: bool = False
    """Whether the caller waits until the child has accepted it."""
    _dropped: bool = False
    """Whether nobody waits for it any more."""
    _error: Exception | None = None
    content: Any = None
    """See `events.Step.content`."""
    arguments: Mapping[str, Any] = MappingProxyType({})
    manner: CallManner = "awaited"
    intent: Intent | None = None
    """To whom it was given, if that is kept."""
    asked_at: str = ""
    """Key of the child that was asked last; empty: its lease was lost, so the same one may know."""
    _line: int = 0
    """Of the page at which it is called; 0: not known."""
    _called: str = ""
    """Under which key it was called last."""
    _elsewhere: bool = False
    """Whether another process than was given it is asked, or the same after its lease was lost."""
    _asking: Frame | None = None
    """The frame that finds out whether it was carried out; None: nobody asks."""

    def __init__(
        self,
        frame: Frame,
        slot: str,
        key: str,
        child: Address,
        command: str,
        limit: CallLimit | None,
        *,
        passes_on: bool,
    ) -> None:
        """Begin with nothing.

        Args:
            frame: of the command that calls.
            slot: of the child.
            key: of the step of the command that calls, and so of the call.
            child: in that slot.
            command: of the child.
            limit: the time that this call may take; None: as long as the command that makes it.
            passes_on: its progress is that of the command that calls.
        """
        self._on_done = []
        self.slot, self.key, self.child, self.command = slot, key, child, command
        self.frame, self.limit, self._passes_on = frame, limit, passes_on
        self._may_be_given = [True]
        """Emptied by who decides whether the caller's worker carries the command out: caller or child."""
        self._may_settle = [True]
        """Emptied by the first who knows how it ended."""

    @classmethod
    def recalled(cls, frame: Frame, slot: str, key: str, command: str, step: on.StepResult) -> ChildCall:
        """Return a call as it ended before the process of its caller was started again."""
        call = cls(frame, slot, key, Address("robot", slot, ""), command, None, passes_on=False)
        call.accepted, call.reply = True, step.reply
        return call

    @property
    def activity(self) -> Activity:
        """The command, or the part of it, that has started it."""
        return self.frame.activity

    def begin(self, epoch: int, intent: Intent | None = None, lost: str = "") -> None:
        """Call the child, under the lease of an epoch.

        Args:
            epoch: of the lease.
            intent: to whom it was given before a crash; None: to nobody.
            lost: why that one is gone; it may be back, and know.

        Raises:
            VrError: it refuses.
        """
        self.intent, self.asked_at = intent, self.child.key
        if self.frame.keeps:
            self._line = page_line(sys._getframe(3))  # noqa: SLF001  # pyright: ignore[reportPrivateUsage] # inspect's is slow
        if intent is not None and (intent.child != self.child.key or not epoch):
            self.asked_at = "" if lost else intent.child
            self.fail(self._in_doubt(lost or f"{self.child.name} was started again meanwhile"))
        else:
            self._call(epoch)
        if self.limit is not None:
            process = self.frame.worker.process
            self._unlimit = process.at(process.runner.now() + self.limit.seconds, self._be_late)
            if self.reply is not None:
                self._unlimit()

    def _call(self, epoch: int, *, witness: str = "") -> None:
        runtime, now, deadline_at = self.frame.runtime, self.frame.worker.now(), self.frame.deadline_at
        if self.limit is not None:
            deadline_at = min(deadline_at, now + self.limit.seconds)
        attempt, self._elsewhere = 0 if self.intent is None else self.intent.attempt, bool(witness)
        self._called = f"{self.key}?{attempt}" if attempt else self.key
        neighbour, source, number, lowest = runtime.neighbours.get(self.child), "", 0, 0
        if neighbour is None:
            self._note_begin()
            source, number, lowest, closed = runtime.number(self.slot, epoch)
            self._leave += (closed,)  # the numbers of earlier attempts stay: they may be asked for again
        call = Call(
            key=self._called,
            command=self.command,
            arguments=dict(self.arguments),
            epoch=epoch,
            caller=runtime.name,
            deadline=deadline_at - now,
            oneway=self.manner == "told",
            source=source,
            number=number,
            lowest=lowest,
            line=self._line,
            witness=witness,
            attended=self._attended(now),
        )
        if neighbour is None:
            self.ask(call, now)
        else:
            nested = self.manner in {"awaited", "passed on"} and not attempt
            self.enter(neighbour, call, deadline_at, nested=nested)

    # -- while somebody at a key attends the command that calls ------------------------------------

    def _attended(self, now: float) -> float:
        """Return for how long [s] the caller is attended yet; the child hears of each key from now on."""
        until, run = self.frame.runtime.attended_until(self.frame.call_key), self.frame.run
        if not until:
            return 0.0
        if self._pass_on not in run.passes_on:
            run.passes_on += (self._pass_on,)
            self._leave += (self._pass_no_more,)
        return max(until - now, 0.0)

    def _pass_no_more(self) -> None:
        run = self.frame.run
        run.passes_on = tuple(each for each in run.passes_on if each != self._pass_on)

    def _pass_on(self, at: float) -> None:
        """Tell the child that a key was pressed [s]. In any thread."""
        if self.reply is not None or self.frame.runtime.has_left:
            return
        if self._neighbour is not None:
            with contextlib.suppress(VrError):  # it has just ended
                self._neighbour.post(
                    on.Attended(key=self._called, at=at, principal=self.frame.runtime.principal)
                )
        elif self._sent is not None:
            age = self.frame.worker.process.runner.now() - at
            attend = Attend(key=self._called, epoch=self._sent.epoch, age=max(age, 0.0))
            self.frame.runtime.ask(self.child.key, attend, _ignore, urgent=True)

    # -- to a child in this process ---------------------------------------------------------------

    def enter(self, child: RobotRuntime, call: Call, deadline_at: float, *, nested: bool) -> None:
        """Call a child in this process.

        Args:
            child: the child.
            call: of its command.
            deadline_at: [s] on the runner's clock.
            nested: the caller waits, so its worker may carry the command out.

        Raises:
            VrError: it refuses.
        """
        if not call.oneway:
            self._neighbour = child
        self.frame.runtime.traffic.note(child.key, self.frame.worker.now(), calls=1)
        turn = nested and not child.isolated and self.frame.depth < DEEPEST
        self._given = call
        while True:
            try:
                child.admit(
                    call,
                    deadline_at,
                    self.frame.runtime.principal,
                    listener=None if call.oneway else self,
                    turn=self.give_turn if turn else None,
                    attended_until=self.frame.worker.now() + call.attended,
                )
            except NotDescribed as unknown:
                self._describe(child, unknown)
            except Frozen as frozen:
                ice = frozen.ice
                ice.when_over(self.frame.worker.wake)
                self.frame.wait(lambda ice=ice: ice.over)  # type: ignore[misc]
                if ice.moved:
                    self._go_elsewhere(deadline_at)
                    return
            else:
                break
        self.accepted = True
        if call.oneway:
            self.frame.keep_step(self.key, on.StepResult("tell", self.content))

    def _describe(self, child: RobotRuntime, unknown: NotDescribed) -> None:
        """Wait until a child has asked its own child for a command.

        Raises:
            VrError: that one does not answer, or lacks the command; or the waiting command is to end.
        """
        outcome: list[VrError | None] = []

        def described(error: VrError | None) -> None:
            outcome.append(error)
            self.frame.worker.wake()

        child.describe_child(unknown, described)
        self.frame.wait(lambda: bool(outcome))
        if (error := outcome[0]) is not None:
            raise error

    # -- to a child in another process ------------------------------------------------------------

    def go_elsewhere(self) -> None:
        """Take note that the child goes on in another process: ask it there, under the same key."""
        if self.reply is not None or self.frame.runtime.put_off(self.go_elsewhere):
            return
        self.frame.worker.process.work(lambda _: self._go_elsewhere(self.frame.deadline_at))

    def _go_elsewhere(self, deadline_at: float) -> None:
        """Ask a child that was in this process where it is now. May wait for the disk."""
        given, runtime, now = self._given, self.frame.runtime, self.frame.worker.now()
        self._neighbour = None
        if given is None or self.reply is not None or not self._may_settle:
            return
        if self.limit is not None:
            deadline_at = min(deadline_at, now + self.limit.seconds)
        try:
            epoch = runtime.child_in(self.slot)[1]
            self._note_begin()
        except VrError as error:
            self.fail(error)
            return
        source, number, lowest, closed = runtime.number(self.slot, epoch)
        self._leave += (closed,)
        again = replace(
            given,
            epoch=epoch,
            deadline=deadline_at - now,
            source=source,
            number=number,
            lowest=lowest,
            attended=self._attended(now),
        )
        self.ask(again, now)

    def _note_begin(self) -> None:
        """Keep whom a command was given that adds up: another life of that child must not get it again.

        Also a loss of power must not make the next process of the host forget it.
        """
        known = self.intent
        if not self.frame.keeps or (known is not None and known.child):
            return
        witness = self.frame.runtime.witness_of(self.slot, self.command)
        if witness is not None:
            self.intent = Intent(self.child.key, witness, 0 if known is None else known.attempt)
            self.frame.keep_step(f"{self.key}{on.BEGUN}", on.StepResult("begun", None, list(self.intent)))
            self.frame.worker.process.sync()

    def ask(self, call: Call, now: float) -> None:
        """Call a child in another process, at a time [s]; its answers come to `take_reply`."""
        runtime = self.frame.runtime
        self._sent, self.accept_by, self._ends = call, now + ANSWER_WITHIN, now + call.deadline
        if not call.oneway:
            self._leave += (runtime.when_gone(self.slot, self._lose_child),)
        runtime.ask(self.child.key, call, self._taker(call), now=now)

    def _taker(self, call: Call) -> Callable[[Reply | None], None]:
        """Return what takes the replies to a call, as long as no later one was made in its place."""

        def take(reply: Reply | None) -> None:
            if self._sent is None or (self._sent.key, self._sent.witness) == (call.key, call.witness):
                self.take_reply(reply)

        return take

    def _lose_child(self, error: VrError) -> None:
        """The child has left the slot: what it was given and adds up may have been carried out or not.

        A page that catches `SlotEmpty` alone does not ask what became of it.
        """
        asks = catches(self.frame, CommandInDoubt) or not catches(self.frame, type(error))
        self.fail(self._in_doubt(str(error.data.get("reason", error))) if self.intent and asks else error)

    def _in_doubt(self, detail: str) -> CommandInDoubt:
        return CommandInDoubt(robot=self.child.name, command=self.command, detail=detail)

    def take_reply(self, reply: Reply | None) -> None:
        """Take one reply from another process; None: there are no more."""
        if reply is None:
            self._lose_contact()
            return
        if isinstance(reply, Moved):
            self._follows = True
            return
        if isinstance(reply, (Returned, Raised)):
            self.settle(reply)
        elif isinstance(reply, Progress):
            self.note(reply.fraction, reply.text)
        elif isinstance(reply, Accepted):
            self.accepted, self.accept_by = True, math.inf
            if self._sent is not None and self._sent.oneway:
                self.frame.keep_step(self.key, on.StepResult("tell", self.content))
                for leave in self._leave:
                    leave()
            if self._awaited:
                self.frame.worker.wake()

    def _lose_contact(self) -> None:
        """There are no more replies: the child's process has ended, or the child has left it."""
        if self.frame.runtime.put_off(self._lose_contact):
            return
        if self.reply is not None or not self._may_settle:
            return
        if self.accepted and (self._awaited or (self._sent is not None and self._sent.oneway)):
            return  # nobody waits for its end
        epoch = None if self._sent is None else self._sent.epoch
        if epoch is not None and self.frame.runtime.comes_back(self.slot, self.child, epoch):
            self.accept_by = math.inf
            process = self.frame.worker.process
            absence, self._follows = 0.0 if self._follows else ABSENCE, False
            process.at(process.runner.now() + absence, self._ask_again)
        elif self.accepted or self._may_have_begun():
            self.fail(self._in_doubt("it ended in the middle; look where the robot stands before you go on"))
        else:
            self.fail(Unreachable(key=self.child.key))

    def _may_have_begun(self) -> bool:
        """Whether the child may have begun it: the request has left, and its answer does not only read.

        That nobody serves the child's key is said at once, in the thread that asks.
        """
        worker, spec = self.frame.worker, self.frame.runtime.known_child_spec(self.slot, self.command)
        return worker.here() != worker.thread and (spec is None or spec.effect != "read")

    def _ask_again(self) -> None:
        """Ask the child once more under the same key when it is back: it goes on, or tells how it ended."""
        runtime, sent, now = self.frame.runtime, self._sent, self.frame.worker.process.runner.now()
        if self.reply is not None or sent is None or not self._may_settle or runtime.put_off(self._ask_again):
            return
        if runtime.is_there(self.child.key):
            self.accept_by = math.inf if self.accepted else now + ANSWER_WITHIN
            again = replace(sent, deadline=self._ends - now, attended=self._attended(now))
            runtime.ask(self.child.key, again, self._taker(again), now=now)
        else:
            self._lose_contact()

    # -- how it fares -----------------------------------------------------------------------------

    def note(self, fraction: float, text: str) -> None:
        """Take how far the child is. From any thread."""
        self._fraction, frame = fraction, self.frame
        if self._passes_on:
            frame.runtime.note(frame.call_key, fraction, text)
        elif text:
            frame.runtime.note_child(frame.call_key, self.child.name, text)

    def settle(self, reply: Returned | Raised) -> None:
        """Take how it ended. From any thread."""
        try:
            self._may_settle.pop()
        except IndexError:
            return
        if self._elsewhere and not self.accepted and isinstance(reply, Raised):  # that says nothing of it
            reply = Raised.of(self._in_doubt(f"it cannot be asked: {reply.revive()}"))
        if isinstance(reply, Raised) and not self._dropped and doubt.is_settled_here(self, reply):
            self.accept_by = math.inf
            self.frame.worker.process.work(partial(doubt.settle, self, reply))
        else:
            self.conclude(reply)

    def conclude(self, reply: Returned | Raised) -> None:
        """Take how it ended, for good. From any thread."""
        if self.frame.keeps:  # before anybody knows of it, and before the child may forget the call
            kind = "tell" if self.manner == "told" else "call"
            self.frame.keep_step(self.key, on.StepResult(kind, self.content, None, reply))
        self.reply = reply
        if self._unlimit is not None:
            self._unlimit()
        for leave in self._leave:
            leave()
        if self._on_done:
            self.tell_all()
        self.frame.worker.wake()

    def fail(self, error: VrError) -> None:
        """End it with an error of our own. From any thread."""
        self.settle(Raised.of(error))

    # -- while nobody knows whether it was carried out ---------------------------------------------

    def asking_part(self, worker: Worker) -> doubt.Asker:
        """Return the part of the command that finds out; it ends when nobody waits for the call any more."""
        frame = self.frame
        number = f"{self.key[len(frame.context.key) + 1 :]}?{worker.process.life}"
        part = frame.part(number, worker)
        part.replay, self._asking = None, part
        if self._dropped or self.called_off:
            part.dropped = self._needless("nobody waits for it any more")
        return cast("doubt.Asker", part)

    def ask_elsewhere(self) -> None:
        """Ask the child that is there now whether it was carried out, if something remembers that."""
        self._call_again(0 if self.intent is None else self.intent.attempt, elsewhere=True)

    def repeat(self) -> None:
        """Call the child again, under another key: it was not carried out."""
        attempt = 0 if self.intent is None else self.intent.attempt
        self._call_again(attempt + 1, elsewhere=False)

    def _call_again(self, attempt: int, *, elsewhere: bool) -> None:
        intent, self._asking = self.intent, None
        self.accepted = False
        try:
            self.child, epoch = self.frame.runtime.child_in(self.slot)
            self.asked_at = self.child.key
            if not elsewhere:
                self.intent = Intent("", "", attempt)
            self._may_settle.append(True)
            self._call(epoch, witness=intent.witness if elsewhere and intent is not None else "")
        except VrError as error:
            if not self._may_settle:
                self._may_settle.append(True)
            self.fail(error)

    def _needless(self, reason: str) -> CommandCancelled:
        return CommandCancelled(robot=self.child.name, command=self.command, reason=reason)

    def _end_asking(self, reason: str) -> None:
        asking = self._asking
        if asking is not None:
            asking.dropped = self._needless(reason)
            asking.interrupt()

    def give_turn(self, run: Callable[[Worker], None]) -> bool:
        """Have the caller's worker carry the command out; False: it waits no longer."""
        try:
            self._may_be_given.pop()
        except IndexError:
            return False
        self.run_here = run
        self.frame.worker.wake()
        return True

    # -- its time ---------------------------------------------------------------------------------

    def _be_late(self) -> None:
        if self.reply is None and not self.frame.runtime.put_off(self._be_late):
            late = self._late()
            self.withdraw(f"its caller gave it {late.data['limit']}")
            self.fail(late)

    def _late(self) -> ChildTimeout:
        limit = "" if self.limit is None else self.limit.text
        return ChildTimeout(robot=self.child.name, command=self.command, limit=limit)

    # -- for the author ---------------------------------------------------------------------------

    @property
    def done(self) -> bool:
        """Whether it has ended, well or badly."""
        return self.reply is not None

    @property
    def progress(self) -> float:
        """Progress, 0 to 1; NaN before the first report."""
        return self._fraction

    def cancel(self) -> None:
        """Ask the child to end it."""
        if self.reply is None:
            self.called_off = True
            reason = "its caller has cancelled it"
            self._end_asking(reason)
            self.withdraw(reason)
            self.fail(self._needless(reason))

    # -- for the command that calls ---------------------------------------------------------------

    def get(self, timeout: float = math.inf) -> Any:
        """Wait for the end in the command's worker, or carry the command out there; return the result.

        Raises:
            VrError: of the child, or of the waiting command, which is to end.
            TimeoutError: it is still under way.
        """
        worker = self.frame.worker
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

    def drop(self, reason: str) -> None:
        """End it, for nobody waits for it any more. From any thread."""
        if self.reply is not None or self._dropped:
            return
        self._dropped = True
        self._end_asking(reason)
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

    def withdraw(self, reason: str) -> None:
        """Tell the child that nobody wants the call any more, and why."""
        if self.frame.runtime.has_left:  # the caller goes on elsewhere, and wants it
            return
        if self._neighbour is not None:
            with contextlib.suppress(LeaseError):  # it has just ended
                self._neighbour.cancel(self._called, reason, principal=self.frame.runtime.principal)
        elif self._sent is not None:
            cancel = Cancel(key=self._called, epoch=self._sent.epoch, reason=reason)
            self.frame.runtime.ask(self.child.key, cancel, _ignore, urgent=True)

    def let_go(self) -> None:
        """Have the child go on when the command that called it has ended."""
        if self.frame.runtime.has_left:
            return
        if self._neighbour is not None:
            with contextlib.suppress(LeaseError):  # as above
                self._neighbour.post(on.DetachAsked(key=self._called, principal=self.frame.runtime.principal))
        elif self._sent is not None:
            self.frame.runtime.ask(self.child.key, Detach(key=self._called, epoch=self._sent.epoch), _ignore)

    def error(self) -> Exception | None:
        """Return with what it has failed, as its caller sees it; None: it has not, or goes on."""
        if not isinstance(self.reply, Raised):
            return None
        if self._error is None:
            error = self.frame.runtime.translate_child_error(self.slot, self.reply.revive())
            if self.limit is not None and isinstance(error, DeadlineExceeded):
                error = self._late()  # the child has noticed it first
            elif isinstance(error, CommandCancelled):
                trace, error = error.trace, ChildCancelled(**error.data)
                error.trace = trace
            self._error = error
        return self._error

    def end_with_command(self) -> None:
        """Go on: it ends when the command does, or when its clean-up begins."""

    def _wait(self, timeout: float) -> None:
        frame = self.frame
        patience = self.accept_by - frame.worker.now()
        if not frame.wait(self._is_news, min(timeout, patience)):
            if patience > timeout:
                raise TimeoutError
            if not self.accepted:
                self.withdraw("the caller gave up")
                self.fail(NoAnswer(key=self.child.key, seconds=ANSWER_WITHIN))

    def _is_news(self) -> bool:
        # that it was accepted is looked at when the time for that is over: it wakes nobody
        return self.reply is not None or self.run_here is not None or (self._awaited and self.accepted)

    def _value(self) -> Any:
        reply = self.reply
        if isinstance(reply, Returned):
            value = reply.value
            return readable(value) if isinstance(value, (dict, list)) else value
        self.frame.expect_to_go_on()  # if the caller itself was asked to end, that is its error
        error = self.error()
        assert error is not None  # noqa: S101 # it has failed
        raise error


def _has_begun(frame: Frame, slot: str, key: str) -> bool:
    """Whether a child in this process has taken the call of a step, before the process was started again."""
    if frame.replay is None:
        return False
    try:
        child = frame.runtime.neighbours.get(frame.runtime.child_in(slot)[0])
    except VrError:
        return False
    return child is not None and child.look(lambda state: key in state.calls.live or key in state.calls.ended)


def _plain(arguments: dict[str, Any]) -> Any:
    """Return arguments as they are read back from a journal."""
    if READY.issuperset(map(type, arguments.values())):
        return arguments
    return to_builtins(arguments, builtin_types=(bytes,), enc_hook=to_plain)


def _ignore(_: object) -> None:
    """Take a reply that does not matter."""
