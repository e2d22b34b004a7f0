"""The core of a robot against a model of plain lists, and against a copy that was encoded and decoded."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, ClassVar

import hypothesis.strategies as st
import msgspec
import pytest
from hypothesis import settings
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from robotree.vr.base.address import Address
from robotree.vr.base.description import Placement, RobotDescription, SlotSpec
from robotree.vr.base.errors import (
    Busy,
    CommandCancelled,
    CommandFailed,
    CycleOfBonds,
    DeadlineExceeded,
    KeyReused,
    NotConfirmed,
    NothingAsked,
    NotInControl,
    NotItsChild,
    NotPaused,
    SlotEmpty,
    SlotHeld,
    SlotOccupied,
    StaleEpoch,
    StillRunning,
    Stopped,
    VrError,
)
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import Call, Done, Raised, Returned
from robotree.vr.core import events as on
from robotree.vr.core.bonds import Bond, HeldLease
from robotree.vr.core.events import (
    AskPart,
    Begin,
    ChildGone,
    CoreEvent,
    Interrupt,
    LeaseChanged,
    PauseChanged,
    RenewLease,
    Settled,
    StopSettled,
)
from robotree.vr.core.machine import LONGEST_QUEUE, RobotCore, encode_state
from robotree.vr.core.placement import Placing
from robotree.vr.core.stop import HARDWARE
from tests.machines.checkpoint import decoded
from tests.vr import cores

UNIX = 1_000_000.0
PARENTS = [Address("robot", name, "1") for name in ("lever", "mover")]
TERM = 5.0
SLOTS = ["tool", "other"]
HOLDER = Principal(user="anna", process=7, agent="robot/lever/1")
STRANGER = Principal(user="anna", process=8, agent="robot/lever/1")
"""Says that it is the holder, in another process."""


EYE = SlotSpec(name="eye", kind="Tool", watch=True)
"""A slot that takes nobody's lease."""


def new_core() -> RobotCore:
    return cores.new_core("arm-1", *(SlotSpec(name=slot, kind="Tool") for slot in SLOTS), EYE, unix=UNIX)


def invocation(
    key: str, command: str, *, deadline_at: float, reads: bool = False, **fields: Any
) -> on.Invoke:
    call = Call(key=key, command=command, deadline=math.inf, **fields)
    return on.Invoke(call=call, arguments={}, deadline_at=deadline_at, reads=reads, principal=HOLDER)


def person(user: str) -> Principal:
    """A person at a terminal, with a program that is there."""
    return Principal(user=user, terminal="pts/1", process=3, agent=f"caller/{user}")


def asked_parts(effects: list[on.CoreEffect]) -> set[tuple[int, str]]:
    """Return generation and part of those that are to be asked."""
    return {(effect.generation, effect.part) for effect in effects if isinstance(effect, AskPart)}


class CoreMachine(RuleBasedStateMachine):
    """Every event goes to two cores, of which one is encoded and decoded now and then."""

    played: ClassVar[set[type]] = set()
    """The types of the events that were not refused."""

    def __init__(self) -> None:
        super().__init__()
        self.core, self.copy = new_core(), new_core()
        self.now = 0.0
        self.numbers = iter(range(10**9))
        self.running: list[str] = []
        """What the model says runs: at most one that moves, any number that read."""
        self.waiting: list[str] = []
        self.readers: list[str] = []
        self.replies: dict[str, Returned | Raised] = {}
        self.began: set[str] = set()
        self.sent: dict[str, on.Invoke] = {}
        self.renewals: list[RenewLease] = []
        """Those that may still be answered."""
        self.granted: dict[str, float] = {}
        """Until when each child is ours unless it grants more, by slot."""
        self.declared = dict.fromkeys(SLOTS, "Tool")
        """The kinds of the slots of the present page."""
        self.watched: Address | None = None
        """Who is watched."""
        self.expected: dict[str, Address] = {}
        """Who is being asked to come, by slot."""
        self.asked: dict[int, dict[str, bool | None]] = {}
        """What each part has answered to each stop: whether it confirms; None: nothing yet."""
        self.settled: set[int] = set()

    # -- how events are handled ------------------------------------------------------------------

    def handle(self, event: CoreEvent) -> list[on.CoreEffect]:
        """Let an event happen; raises the refusal, which changed nothing."""
        if not isinstance(event, on.Tick):
            self.be_punctual()
        before = encode_state(self.core.state)
        try:
            effects = self.core.handle(event, self.now)
        except VrError as refusal:
            assert encode_state(self.core.state) == before, "a refusal changes nothing"
            with pytest.raises(type(refusal)):
                self.copy.handle(event, self.now)
            raise
        assert self.copy.handle(event, self.now) == effects, "the decoded copy goes on identically"
        self.played.add(type(event))
        self.take(effects)
        return effects

    def be_punctual(self) -> None:
        """Let what is due happen."""
        if self.core.due <= self.now:
            self.tick()

    def tick(self) -> None:
        self.handle(on.Tick(unix=UNIX + self.now))

    def take(self, effects: list[on.CoreEffect]) -> None:
        for effect in effects:
            match effect:
                case Begin(key=key):
                    assert key not in self.began, "no call begins twice"
                    self.began.add(key)
                    if key in self.waiting:
                        assert self.waiting[0] == key, "those that wait begin in their order"
                        self.waiting.pop(0)
                        self.running.append(key)
                case Settled(key=key, reply=reply):
                    if key in self.replies:
                        assert self.replies[key] == reply, "the same call has one end"
                    self.replies[key] = reply
                    for some in (self.running, self.waiting, self.readers):
                        if key in some:
                            some.remove(key)
                case Interrupt(key=key):
                    assert key in self.running + self.readers, "only what runs is interrupted"
                case StopSettled(generation=generation, reply=reply):
                    assert generation not in self.settled, "a stop is settled once"
                    self.settled.add(generation)
                    answers = self.asked[generation].values()
                    assert None not in answers, "when all have answered"
                    assert isinstance(reply, Done) == all(answers), "all confirm it, or it is not confirmed"
                case _:
                    self.take_of_bonds(effect)

    def take_of_bonds(self, effect: on.CoreEffect) -> None:
        match effect:
            case RenewLease(slot=slot):
                assert slot in self.granted, "only a lease in force is renewed"
                assert effect.sent == self.now
                self.renewals.append(effect)
            case ChildGone(slot=EYE.name, child=child, reason=reason):
                assert (child, reason) == (self.watched, ""), "who was watched goes, and is not lost"
                self.watched = None
            case ChildGone(slot=slot, reason=reason):
                until = self.granted.pop(slot)
                assert "did not answer" not in reason or until <= self.now, "no lease ends early"
            case _:
                pass

    @rule()
    def go_on_from_the_encoded_state(self) -> None:
        self.copy = RobotCore(decoded(self.copy.state))

    @rule(seconds=st.sampled_from([0.1, 1.0, TERM]))
    def time_passes(self, seconds: float) -> None:
        self.now += seconds
        self.tick()

    # -- calls -----------------------------------------------------------------------------------

    def invoke(self, *, reads: bool = False, epoch: int | None = None, within: float = 100.0) -> on.Invoke:
        key = f"k{next(self.numbers)}"
        command = "look" if reads else "move"
        self.sent[key] = invocation(key, command, deadline_at=self.now + within, epoch=epoch, reads=reads)
        return self.sent[key]

    def right(self) -> int | None:
        lease = self.core.state.lease.current
        return None if lease is None or lease.expires <= self.now else lease.epoch

    def wrong(self) -> int | None:
        """An epoch that nobody has who may command the robot, nor end what it does."""
        lease = self.core.state.lease.current
        return 7 if self.right() is None or (lease is not None and lease.away) else None

    def outranked(self) -> bool:
        """Whether somebody else commands what stands behind the robot, and no parent the robot."""
        return self.right() is None and self.core.state.lease.outranked

    @rule(reads=st.booleans(), within=st.sampled_from([0.5, 3.0, 1000.0]))
    def a_call_comes(self, *, reads: bool, within: float) -> None:
        invoke = self.invoke(reads=reads, epoch=self.right(), within=within)
        call, idle = invoke.call, not self.running
        try:
            self.handle(invoke)
        except Stopped:
            assert not reads
            assert self.core.state.stop.in_force
        except StillRunning:
            assert not reads
            assert self.core.state.calls.abandoned
        except CommandFailed:
            assert not reads
            assert self.outranked()
        except Busy:
            assert reads or len(self.waiting) == LONGEST_QUEUE
        else:
            if reads:
                self.readers.append(call.key)
            elif idle and call.key in self.began:
                self.running.append(call.key)
            else:
                self.waiting.append(call.key)

    def at_work(self) -> list[str]:
        """Return the calls that run; if there is none, one comes that reads."""
        if not self.running + self.readers:
            self.a_call_comes(reads=True, within=1000.0)
        return self.running + self.readers

    @rule()
    def a_call_comes_from_one_who_has_no_right(self) -> None:
        right = self.right()
        wrong = self.invoke(epoch=7 if right is None else None)
        with pytest.raises(StaleEpoch if right is None else NotInControl):
            self.handle(wrong)

    @precondition(lambda self: self.replies)
    @rule(data=st.data())
    def an_ended_call_comes_again(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(sorted(self.replies)))
        command, until, right = self.sent[key].call.command, self.now + 9, self.right()
        again = invocation(key, command, deadline_at=until, epoch=right)
        if key in self.core.state.calls.ended:
            assert self.handle(again) == [Settled(key=key, reply=self.replies[key])]
        other = invocation(key, "other", deadline_at=until, epoch=right)
        if key in self.core.state.calls.ended:
            with pytest.raises(KeyReused):
                self.handle(other)

    @rule()
    def a_call_comes_too_late(self) -> None:
        call = self.invoke(epoch=self.right(), within=0.0, reads=True)
        with pytest.raises(DeadlineExceeded):
            self.handle(call)

    @precondition(lambda self: self.running or self.readers)
    @rule(data=st.data(), well=st.booleans())
    def the_code_of_one_ends(self, data: st.DataObject, *, well: bool) -> None:
        key = data.draw(st.sampled_from(self.running + self.readers))
        failed = Raised.of(CommandCancelled(robot="arm-1", command="move", reason="its author"))
        self.handle(on.Finish(key=key, reply=Returned(key=key, value=1) if well else failed))
        assert key in self.replies

    @precondition(lambda self: self.running or self.readers or self.waiting)
    @rule(data=st.data())
    def one_is_cancelled(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(self.running + self.readers + self.waiting))
        waits = key in self.waiting
        self.handle(on.CancelAsked(key=key, reason="enough"))
        assert (key in self.replies) == waits, "what waits ends at once, what runs ends with its code"

    @rule()
    def a_cancel_overtakes_its_call(self) -> None:
        invoke = self.invoke(epoch=self.right())
        self.handle(on.CancelAsked(key=invoke.call.key, reason="too late", epoch=self.right()))
        with pytest.raises(CommandCancelled, match="too late"):
            self.handle(invoke)

    @precondition(lambda self: self.running)
    @rule()
    def code_is_abandoned_and_ends_after_all(self) -> None:
        key = self.running[0]
        self.handle(on.Abandon(key=key))
        assert not self.waiting, "nothing waits behind abandoned code"
        with pytest.raises((StillRunning, Stopped, CommandFailed)):
            self.handle(self.invoke(epoch=self.right()))
        self.handle(on.Gone(key=key))

    @precondition(lambda self: self.running)
    @rule()
    def code_ends_at_the_moment_when_it_is_given_up(self) -> None:
        key = self.running[0]
        self.handle(on.Gone(key=key))
        assert key in self.replies
        self.handle(on.Abandon(key=key))
        assert not self.core.state.calls.abandoned

    @precondition(lambda self: self.running)
    @rule(final=st.booleans())
    def one_is_asked_to_end_for_good(self, *, final: bool) -> None:
        key = self.running[0]
        self.handle(on.CancelAsked(key=key, reason="enough"))
        effects = self.handle(on.CancelAsked(key=key, reason="now", final=final))
        ended = self.core.state.calls.live[key].final
        assert bool(effects) <= final, "only a final order interrupts a clean-up"
        assert ended or not final
        assert not self.handle(on.CancelAsked(key=key, reason="now", final=True)) or not ended

    @precondition(lambda self: self.running or self.readers or self.waiting)
    @rule(data=st.data(), own=st.booleans())
    def one_goes_on_without_its_caller(self, data: st.DataObject, *, own: bool) -> None:
        key = data.draw(st.sampled_from(self.running + self.readers + self.waiting))
        before = self.core.state.calls.live[key].detached
        with pytest.raises((NotInControl, StaleEpoch)):
            self.handle(on.DetachAsked(key=key, epoch=self.wrong(), principal=STRANGER))
        calls = self.core.state.calls
        assert key not in calls.live or calls.live[key].detached == before
        assert not self.handle(
            on.DetachAsked(key=key, epoch=self.right(), principal=ITSELF if own else HOLDER)
        )
        assert key not in calls.live or calls.live[key].detached

    @rule(data=st.data(), path=st.sampled_from(["1", "2", "2/1", "!"]), value=st.integers(-9, 9))
    def a_step_is_taken(self, data: st.DataObject, path: str, value: int) -> None:
        key = data.draw(st.sampled_from(self.at_work()))
        step = on.StepResult("look", None, value)
        assert not self.handle(on.StepTaken(key=key, path=path, step=step))
        assert key not in self.core.state.calls.live or self.core.state.calls.live[key].steps[path] == step

    @rule(data=st.data())
    def its_steps_are_not_needed_any_more(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(self.at_work()))
        before = self.core.state.calls.live.get(key)
        lap = 0 if before is None else before.lap
        assert not self.handle(on.Checkpoint(key=key))
        call = self.core.state.calls.live.get(key)
        assert call is None or (call.steps, call.lap, call.fields) == ({}, lap + 1, self.core.state.fields)

    @rule(data=st.data(), answer=st.sampled_from(["done", "again", "abort"]))
    def a_command_asks_and_a_person_answers(self, data: st.DataObject, answer: str) -> None:
        self.tick()
        key = data.draw(st.sampled_from(self.at_work()))
        asks = key in self.core.state.calls.live
        self.handle(on.DoubtRaised(key=key, question="what now?"))
        reply = on.DoubtSettled(answer=answer, epoch=self.right(), principal=HOLDER)
        if not asks:
            with pytest.raises(NothingAsked):
                self.handle(reply)
            return
        with pytest.raises((NotInControl, StaleEpoch)):
            self.handle(on.DoubtSettled(answer=answer, epoch=self.wrong(), principal=STRANGER))
        assert on.Decided(key=key, answer=answer) in self.handle(reply)
        with pytest.raises(NothingAsked):
            self.handle(reply)

    @rule(data=st.data(), ago=st.sampled_from([0.0, 1.0, 60.0]))
    def a_key_is_pressed_for_a_call_that_needs_none(self, data: st.DataObject, ago: float) -> None:
        key = data.draw(st.sampled_from(["nobody's", *sorted(self.sent)]))
        assert not self.handle(on.Attended(key=key, at=self.now - ago, principal=HOLDER))

    @rule(leaves=st.booleans())
    def an_operator_has_control_for_a_moment(self, *, leaves: bool) -> None:
        """While somebody has control, nobody else gets it; afterwards nobody has it."""
        self.tick()

        def asks(what: str, user: str) -> on.ControlAsked:
            return on.ControlAsked(what=what, unix=UNIX + self.now, principal=person(user))

        if self.right() is not None:
            with pytest.raises(NotInControl):
                self.handle(asks("get", "anna"))
            return
        self.handle(asks("get", "anna"))
        with pytest.raises(VrError):
            self.handle(asks("get", "ben"))
        assert self.core.state.control.holder.person == person("anna").person
        gone = on.OperatorGone(agent=person("anna").agent, unix=UNIX + self.now)
        self.handle(asks("leave", "anna") if leaves else gone)
        assert not self.core.state.control.holder.person

    @rule(who=st.sampled_from(["parent", "another"]))
    def the_process_of_a_parent_ends(self, who: str) -> None:
        """A lease whose parent keeps a journal lasts as long as it said; no other changes."""
        self.tick()
        lease = self.core.state.lease.current
        if lease is None or who == "another":
            assert not self.handle(on.ParentAway(parent=Address("robot", "nobody", "1")))
            assert self.core.state.lease.current == lease
            return
        news = self.handle(on.ParentAway(parent=lease.parent))
        after = self.core.state.lease.current
        assert bool(news) == (lease.waits > 0.0 and not lease.away)
        assert after is not None
        assert after.away == (lease.waits > 0.0)
        if news:
            assert after.expires == pytest.approx(self.now + lease.waits)

    @rule(
        but_readers=st.booleans(),
        final=st.booleans(),
        by=st.sampled_from(["itself", "right", "wrong", "none"]),
    )
    def all_are_cancelled(self, *, but_readers: bool, final: bool, by: str) -> None:
        """Who has no right and no lease ends only what goes on without its caller; a robot ends nothing."""
        self.tick()
        live = self.core.state.calls.live
        epoch = {"itself": None, "none": None, "right": self.right(), "wrong": self.wrong()}[by]
        order = on.CancelAll(
            reason="enough",
            but_readers=but_readers,
            epoch=epoch,
            principal=ITSELF if by == "itself" else HOLDER if epoch is not None else person("anna"),
            final=final,
        )
        with pytest.raises((NotInControl, NotItsChild)):
            self.handle(msgspec.structs.replace(order, epoch=None, principal=HOLDER))
        lease = self.core.state.lease.current
        away = lease is not None and lease.away
        alone = by == "none" and self.right() is not None and not away
        if epoch is not None and epoch != self.right():
            with pytest.raises(StaleEpoch):
                self.handle(order)
        elif alone and by == "none" and not any(call.detached for call in live.values()):
            with pytest.raises(NotInControl):
                self.handle(order)
        elif order.principal == ITSELF or epoch == self.right() or alone or away:
            meant = [
                key
                for key, call in live.items()
                if not (but_readers and call.reads) and (call.detached or not alone)
            ]
            waited = [key for key in self.waiting if key in meant]
            self.handle(order)
            assert all(key in self.replies for key in waited), "what waits ends at once"
            assert not {*waited} & self.began, "and does not begin before"
            assert all(live[key].cause for key in meant if key in live), "what runs is asked to end"

    # -- who commands it -------------------------------------------------------------------------

    @rule(parent=st.sampled_from(PARENTS), waits=st.sampled_from([0.0, 3.0]))
    def a_parent_asks(self, parent: Address, waits: float) -> None:
        before = self.core.state.lease.epoch
        ask = on.ParentAsked(
            parent=parent,
            slot="arm",
            lineage=(parent.name,),
            term=TERM,
            unix=UNIX + self.now,
            waits=waits,
            principal=HOLDER,
        )
        lease = self.core.state.lease.current
        try:
            self.handle(ask)
        except VrError:
            assert lease is not None
            assert lease.parent != parent
        else:
            assert self.core.state.lease.epoch > before, "each grant has a higher epoch"
            assert not self.waiting

    @precondition(lambda self: self.right() is not None)
    @rule()
    def the_lease_ends(self) -> None:
        lease = self.core.state.lease.current
        assert lease is not None
        own = self.core.state.pause.by
        self.handle(on.EndLease(parent=lease.parent, unix=UNIX + self.now, reason="it let go"))
        assert self.core.state.lease.epoch > lease.epoch
        assert self.core.state.pause.in_force == own, "the pause of a parent ends with its lease"

    @precondition(lambda self: self.right() is not None)
    @rule(late=st.booleans(), above=st.sampled_from([(), ("train",), ("arm-1",)]))
    def the_parent_renews(self, *, late: bool, above: tuple[str, ...]) -> None:
        before = self.core.state.lease.current
        assert before is not None
        lineage = (*above, before.parent.name)
        renewal = on.Prolong(parent=before.parent, epoch=before.epoch, lineage=lineage, principal=HOLDER)
        if late:
            with pytest.raises(StaleEpoch):
                self.handle(on.Prolong(parent=before.parent, epoch=before.epoch - 1, lineage=lineage))
        elif "arm-1" in above:
            with pytest.raises(CycleOfBonds):
                self.handle(renewal)
        else:
            effects = self.handle(renewal)
            lease = self.core.state.lease.current
            assert lease is not None
            assert (lease.epoch, lease.expires) == (before.epoch, self.now + TERM)
            changed = before.away or lineage != before.lineage
            assert (LeaseChanged() in effects) == changed, "news of a parent and of its ancestors go down"

    @precondition(lambda self: self.right() is not None)
    @rule(data=st.data())
    def a_stranger_knows_the_number_of_the_lease(self, data: st.DataObject) -> None:
        """Every state publishes it."""
        lease, right = self.core.state.lease.current, self.right()
        assert lease is not None
        call = invocation("theft", "move", deadline_at=self.now + 1.0, epoch=right)
        tries: list[on.CoreEvent] = [
            msgspec.structs.replace(call, principal=STRANGER),
            on.CancelAsked(key="theft", reason="mine", epoch=right, principal=STRANGER),
            on.CancelAll(reason="mine", epoch=right, principal=STRANGER),
            on.DetachAsked(key="theft", epoch=right, principal=STRANGER),
            on.Set(values={"seen": "theft"}, epoch=right, principal=STRANGER),
        ]
        if not lease.away:  # else it may be the parent's next process, as `test_principals` shows
            tries += [
                on.Prolong(parent=lease.parent, epoch=lease.epoch, lineage=("lever",), principal=STRANGER),
                on.EndLease(parent=lease.parent, unix=UNIX, reason="", epoch=right, principal=STRANGER),
            ]
        if live := sorted(self.core.state.calls.live):
            key = data.draw(st.sampled_from(live))
            tries += [
                on.CancelAsked(key=key, reason="mine", epoch=right, principal=STRANGER),
                on.DetachAsked(key=key, epoch=right, principal=STRANGER),
            ]
        before = encode_state(self.core.state)
        for event in tries:
            with pytest.raises(NotInControl):
                self.handle(event)
        assert encode_state(self.core.state) == before

    @rule(more=st.sampled_from([0, -1, 1]))
    def the_controller_says_which_epoch_it_obeys(self, more: int) -> None:
        lease, before = self.core.state.lease, self.core.state.lease.epoch
        first, free = lease.found is None, lease.current is None
        self.handle(on.Obeyed(epoch=before + more))
        assert lease.epoch == (before + more + 1 if first and free and more > 0 else before)
        assert lease.outranked or first or more <= 0 or before + more <= (lease.found or 0)

    # -- what it keeps ---------------------------------------------------------------------------

    @rule(value=st.sampled_from([0, 0.5, "a", ["a", {"b": 1}], None]), by=st.sampled_from(["page", "right"]))
    def a_field_is_set(self, value: object, by: str) -> None:
        page = by == "page"
        self.handle(
            on.Set(
                values={"seen": value},
                principal=ITSELF if page else HOLDER,
                epoch=None if page else self.right(),
            )
        )
        assert self.core.state.fields == {"seen": value}

    @rule()
    def one_who_has_no_right_sets_a_field(self) -> None:
        right = self.right()
        with pytest.raises(StaleEpoch if right is None else NotInControl):
            self.handle(on.Set(values={"seen": 1}, principal=HOLDER, epoch=7 if right is None else None))

    # -- the robots that it commands -------------------------------------------------------------

    def empty(self) -> list[str]:
        return [slot for slot in self.declared if slot not in {*self.granted, *self.expected}]

    @initialize(has_child=st.sampled_from([True, True, False]))
    def it_may_have_a_child(self, *, has_child: bool) -> None:
        """Else hardly a case would get as far as the renewal of a child's lease."""
        if has_child:
            self.ask(SLOTS[0])
            self.come(SLOTS[0])

    @precondition(lambda self: self.empty())
    @rule(data=st.data(), answer=st.sampled_from(["comes", "refuses", "later"]))
    def a_child_is_asked(self, data: st.DataObject, answer: str) -> None:
        slot = data.draw(st.sampled_from(self.empty()))
        self.ask(slot)
        if answer != "later":
            self.answer(slot, comes=answer == "comes")

    def ask(self, slot: str) -> None:
        child = Address("robot", f"child-{next(self.numbers)}", "1")
        self.handle(on.Reserve(slot=slot, child=child))
        self.expected[slot] = child

    @precondition(lambda self: self.expected)
    @rule(data=st.data(), comes=st.booleans())
    def who_was_asked_comes_or_not(self, data: st.DataObject, *, comes: bool) -> None:
        self.answer(data.draw(st.sampled_from(sorted(self.expected))), comes=comes)

    def answer(self, slot: str, *, comes: bool) -> None:
        if comes:
            self.come(slot)
        else:
            del self.expected[slot]
            self.handle(on.Unreserve(slot=slot))
            assert self.core.state.slots[slot].child is None

    def come(self, slot: str) -> None:
        child = self.expected.pop(slot)
        lease = HeldLease.begin(epoch=next(self.numbers), term=TERM, sent=self.now - 0.1, now=self.now)
        description = RobotDescription(address=child, kinds=("Tool", "Robot"))
        self.granted[slot] = self.now - 0.1 + TERM
        effects = self.handle(
            on.Bind(slot=slot, bond=Bond(child=child, lease=lease, description=description))
        )
        assert bool(effects) == bool(self.core.state.pause.in_force), (
            "it hears at once that its parent is paused"
        )

    @precondition(lambda self: self.renewals)
    @rule(data=st.data(), news=st.booleans())
    def a_child_grants_a_renewal(self, data: st.DataObject, *, news: bool) -> None:
        """In any order, late ones too, and those of bonds that are over."""
        renewal = data.draw(st.sampled_from(self.renewals))
        self.renewals.remove(renewal)
        self.be_punctual()
        slot = renewal.slot
        bond = self.core.state.slots.held(slot, renewal.child, renewal.epoch)
        described = RobotDescription(address=renewal.child, kinds=("Tool", "Robot"), doc="news")
        self.handle(
            on.Renewed(
                slot=slot,
                child=renewal.child,
                epoch=renewal.epoch,
                sent=renewal.sent,
                term=TERM,
                description=described if news else None,
            )
        )
        if bond is not None:
            self.granted[slot] = max(self.granted[slot], renewal.sent + TERM)
            assert bond.lease.expires == self.granted[slot], "it counts from when the request left"

    @precondition(lambda self: EYE.name in self.core.state.slots.by_name)
    @rule(name=st.sampled_from(["lamp", "door"]), life=st.sampled_from(["1", "2"]))
    def a_robot_is_watched(self, name: str, life: str) -> None:
        robot, before = Address("robot", name, life), self.watched
        if before is not None and before.name != name:
            with pytest.raises(SlotOccupied):
                self.handle(on.Watching(slot=EYE.name, robot=robot))
            return
        effects = self.handle(on.Watching(slot=EYE.name, robot=robot))
        assert bool(effects) == (before not in (None, robot)), "only another life replaces one"
        self.watched = robot

    @precondition(lambda self: self.watched)
    @rule()
    def a_robot_is_watched_no_longer(self) -> None:
        self.handle(on.WatchEnded(slot=EYE.name))
        assert self.watched is None
        with pytest.raises(SlotEmpty):
            self.handle(on.WatchEnded(slot=EYE.name))

    @precondition(lambda self: self.granted)
    @rule(data=st.data(), how=st.sampled_from([on.FreeAsked, on.Lose, on.ChildDescribed]))
    def a_child_is_released_or_lost_or_asked_anew(self, data: st.DataObject, how: type) -> None:
        slot = data.draw(st.sampled_from(sorted(self.granted)))
        self.be_punctual()
        bond = self.core.state.slots[slot].bond
        if bond is None:
            return
        child, epoch = bond.child, bond.lease.epoch
        if how is on.FreeAsked:
            self.handle(on.FreeAsked(slot=slot))
        elif how is on.Lose:
            self.handle(on.Lose(slot=slot, child=child, epoch=epoch + 1, reason="another one"))
            assert slot in self.granted, "a bond is known by child and epoch"
            self.handle(on.Lose(slot=slot, child=child, epoch=epoch, reason="it has ended"))
        else:
            description = RobotDescription(address=child, kinds=("Tool",))
            self.handle(on.ChildDescribed(slot=slot, child=child, epoch=epoch, description=description))
            assert self.renewals[-1].child == child
        assert (slot in self.granted) == (how is on.ChildDescribed)

    @precondition(lambda self: not self.running)
    @rule(
        declared=st.dictionaries(
            st.sampled_from([*SLOTS, "more"]), st.sampled_from(["Tool", "Arm"]), min_size=1
        ),
        value=st.integers(0, 1),
    )
    def another_page_is_loaded(self, declared: dict[str, str], value: int) -> None:
        self.be_punctual()
        held = {*self.granted, *self.expected}
        specs = (*(SlotSpec(name=name, kind=kind) for name, kind in declared.items()), EYE)
        reload = on.PageReloaded(slots=specs, fields={"seen": value})
        if any(declared.get(slot) != self.declared[slot] for slot in held):
            with pytest.raises(SlotHeld):
                self.handle(reload)
        else:
            self.handle(reload)
            self.declared = declared
            assert self.core.state.slots.by_name.keys() == {*declared, EYE.name}
            assert self.core.state.fields == {"seen": value}

    # -- stops -----------------------------------------------------------------------------------

    @rule(order=st.sampled_from(["", "a", "b"]))
    def a_stop_is_ordered(self, order: str) -> None:
        stop = self.core.state.stop
        self.be_punctual()
        known, before = stop.known(order), stop.generation
        effects = self.handle(on.StopAsked(reason="a hand", order=order))
        assert stop.generation == before + (0 if known else 1), "copies of one order are one stop"
        if not known:
            self.asked[stop.generation] = dict.fromkeys([HARDWARE, *self.granted])
            assert stop.parts[stop.generation].keys() == self.asked[stop.generation].keys()
        assert asked_parts(effects) == self.unanswered([known or stop.generation])
        assert not self.waiting

    def unanswered(self, generations: Iterable[int]) -> set[tuple[int, str]]:
        asked = [
            (generation, part, answer)
            for generation in generations
            for part, answer in self.asked[generation].items()
        ]
        return {(one, part) for one, part, answer in asked if answer is None}

    @rule()
    def those_who_carried_out_effects_are_new(self) -> None:
        stop = self.core.state.stop
        asked = asked_parts(self.handle(on.Restored()))
        assert asked == (self.unanswered(self.asked) if stop.reason else set())

    @precondition(lambda self: self.asked)
    @rule(data=st.data(), confirms=st.booleans())
    def a_part_answers(self, data: st.DataObject, *, confirms: bool) -> None:
        """Once, twice, late, after the release: the first answer counts."""
        generation = data.draw(st.sampled_from(sorted(self.asked)))
        part = data.draw(st.sampled_from([*self.asked[generation], "nobody"]))
        error = NotConfirmed(order="the protective stop", told=[], untold=[[part, "it hangs"]], advice=[])
        answer = Done(confirmed=("below",)) if confirms else Raised.of(error)
        if self.asked[generation].get(part, True) is None:
            self.asked[generation][part] = confirms
        confirmed = self.core.state.stop.confirmed
        self.handle(on.StopAnswered(generation=generation, part=part, answer=answer))
        assert (generation in self.settled) == (None not in self.asked[generation].values())
        assert self.core.state.stop.confirmed >= confirmed

    @rule(late=st.booleans())
    def it_is_released(self, *, late: bool) -> None:
        stop = self.core.state.stop
        if late and stop.generation:
            with pytest.raises(VrError):
                self.handle(on.ReleaseAsked(generation=stop.generation - 1))
        else:
            self.handle(on.ReleaseAsked(generation=stop.generation))
            assert not stop.reason

    @rule(halted=st.sampled_from(["", "its controller is in safe stop"]))
    def the_robot_says_that_it_is_stopped(self, halted: str) -> None:
        self.handle(on.Halted(reason=halted))

    # -- pauses ----------------------------------------------------------------------------------

    def expect_refusal(self, order: CoreEvent) -> bool:
        """Whether its parent commands it: then nobody else lets it go on, nor pauses it unless it is away."""
        lease = self.core.state.lease.current
        away = lease is not None and lease.away
        if self.right() is None or (away and isinstance(order, on.PauseAsked)):
            return False
        with pytest.raises(NotInControl):
            self.handle(order)
        return True

    @rule(by=st.sampled_from(["anna@pts/3", "ben@pts/4"]))
    def it_is_paused(self, *, by: str) -> None:
        self.tick()
        pause, order = self.core.state.pause, on.PauseAsked(by=by, principal=STRANGER)
        if self.expect_refusal(order):
            return
        self.expect_news_of_pause(order)
        assert pause.in_force == pause.by == by
        assert not pause.may_pass("k/1")

    @rule()
    def its_pause_ends(self) -> None:
        self.tick()
        pause, order = self.core.state.pause, on.ContinueAsked(principal=STRANGER)
        if self.expect_refusal(order):
            return
        self.expect_news_of_pause(order)
        assert pause.may_pass("k/1")

    @rule(mode=st.sampled_from(["manual", "advise", "auto"]), moves=st.integers(0, 3))
    def its_placing_is_set(self, mode: Placement, moves: int) -> None:
        placing = Placing(mode=mode, why="it is nearer", moved=UNIX, moves=moves)
        assert self.handle(on.PlacingSet(placing=placing)) == []
        assert self.core.state.placing == placing

    def expect_news_of_pause(self, order: CoreEvent) -> None:
        """Its children hear of it at once."""
        changes = self.core.state.pause.changes
        effects = self.handle(order)
        assert effects[0] == PauseChanged()
        renewed = {effect.slot for effect in effects if isinstance(effect, RenewLease)}
        assert renewed == set(self.core.state.slots.bonds())
        assert self.core.state.pause.changes == changes + 1

    @rule(pauses=st.booleans())
    def one_step_passes(self, *, pauses: bool) -> None:
        if pauses:
            self.it_is_paused(by="anna@pts/3")
        self.tick()
        pause, right = self.core.state.pause, self.right()
        self.expect_refusal(on.StepLet(step="k/2", principal=STRANGER))
        order = on.StepLet(step="k/2", epoch=right, principal=HOLDER)
        if not pause.in_force:
            with pytest.raises(NotPaused):
                self.handle(order)
            return
        assert self.handle(order) == [PauseChanged()]
        assert pause.may_pass("k/2")
        assert not pause.may_pass("k/3")

    @rule(paused=st.sampled_from(["", "anna@pts/3"]), changes=st.integers(0, 6))
    def its_parent_says_whether_it_is_paused(self, paused: str, changes: int) -> None:
        """With a renewal; one that comes late says nothing."""
        self.tick()
        lease, pause = self.core.state.lease.current, self.core.state.pause
        if lease is None:
            return
        own, above, heard = pause.by, pause.above, pause.heard
        renewal = on.Prolong(
            parent=lease.parent,
            epoch=lease.epoch,
            lineage=lease.lineage,
            principal=lease.principal,
            paused=paused,
            pauses=changes,
        )
        changed = PauseChanged() in self.handle(renewal)
        expected = (own, above)
        if changes > heard:
            ended = heard >= 0 and not paused
            expected = ("" if ended else own, paused)
        assert (pause.by, pause.above) == expected
        assert changed == (expected != (own, above))

    # -- always ----------------------------------------------------------------------------------

    @invariant()
    def what_runs_and_waits_is_what_the_model_says(self) -> None:
        calls = self.core.state.calls
        assert ([calls.running] if calls.running else []) == self.running
        assert calls.waiting == self.waiting
        assert calls.readers == len(self.readers)
        assert set(calls.live) == {*self.running, *self.waiting, *self.readers}

    @invariant()
    def leases_are_renewed_in_time_and_end_when_nobody_answers(self) -> None:
        bonds = self.core.state.slots.bonds()
        assert bonds.keys() == self.granted.keys()
        for bond in bonds.values():
            assert self.core.due <= min(bond.lease.due, bond.lease.expires)

    @invariant()
    def the_newest_confirmed_stop_is_one_that_all_parts_have_confirmed(self) -> None:
        confirmed = [generation for generation, parts in self.asked.items() if all(parts.values())]
        assert self.core.state.stop.confirmed == max(confirmed, default=0)

    @invariant()
    def answers_are_kept_while_somebody_may_ask_for_them(self) -> None:
        stop = self.core.state.stop
        assert stop.parts.keys() >= {*stop.orders.values(), *(self.asked.keys() - self.settled)}
        assert len(stop.parts) <= len(self.asked.keys() - self.settled) + len(stop.orders) + 1

    @invariant()
    def both_cores_are_the_same(self) -> None:
        assert encode_state(self.core.state) == encode_state(self.copy.state)


def test_a_core_does_what_its_model_says_and_each_type_of_event_has_its_turn() -> None:
    """A seldom type has it in more games."""
    CoreMachine.played.clear()
    for games in (120, 600):
        if CoreMachine.played != set(RobotCore._handlers):
            limits = settings(max_examples=games, stateful_step_count=40, deadline=None)
            run_state_machine_as_test(CoreMachine, settings=limits)
    assert CoreMachine.played == set(RobotCore._handlers)


def test_a_numbered_call_that_is_over_for_its_caller_is_refused_for_ever() -> None:
    core = new_core()

    def call(number: int, lowest: int) -> on.Invoke:
        key, source = f"k{number}", "lever/arm/7"
        return invocation(key, "move", deadline_at=10.0, source=source, number=number, lowest=lowest)

    core.handle(call(1, 1), 0.0)
    core.handle(on.Finish(key="k1", reply=Returned(key="k1")), 0.0)
    core.handle(call(2, 2), 0.0)
    assert "k1" not in core.state.calls.ended, "its reply is forgotten"
    with pytest.raises(CommandCancelled, match="its caller has given it up"):
        core.handle(call(1, 1), 0.0)


def core_with_a_child() -> tuple[RobotCore, Address]:
    """A robot with a child in the slot `tool`, under epoch 3."""
    core, child = new_core(), Address("robot", "hand-1", "1")
    core.handle(on.Reserve(slot="tool", child=child), 0.0)
    lease = HeldLease.begin(epoch=3, term=TERM, sent=0.0, now=0.0)
    description = RobotDescription(address=child, kinds=("Tool", "Robot"))
    core.handle(on.Bind(slot="tool", bond=Bond(child=child, lease=lease, description=description)), 0.0)
    return core, child


def test_a_late_answer_of_a_child_whose_slot_is_no_longer_declared_changes_nothing() -> None:
    core, child = core_with_a_child()
    core.handle(on.FreeAsked(slot="tool"), 1.0)
    core.handle(on.PageReloaded(slots=(), fields={}), 1.0)
    before = encode_state(core.state)
    assert core.handle(on.Renewed(slot="tool", child=child, epoch=3, sent=0.5, term=TERM), 2.0) == []
    assert core.handle(on.Lose(slot="tool", child=child, epoch=3, reason="it has ended"), 2.0) == []
    assert encode_state(core.state) == before


def test_the_lease_of_a_child_is_asked_for_when_it_is_due_and_again_until_it_ends() -> None:
    core, child = core_with_a_child()
    asked: list[float] = []
    while (now := core.due) < TERM:
        (effect,) = core.handle(on.Tick(unix=UNIX + now), now)
        assert effect == RenewLease(slot="tool", child=child, epoch=3, sent=now)
        asked.append(now)
    assert asked[0] <= TERM / 2
    assert len(asked) > 2
    (gone,) = core.handle(on.Tick(unix=UNIX + TERM), TERM)
    assert isinstance(gone, ChildGone)


def test_a_stop_goes_on_to_the_children_of_a_robot_that_is_a_child_itself() -> None:
    core, _ = core_with_a_child()
    parent = Address("robot", "lever", "1")
    core.handle(
        on.ParentAsked(parent=parent, slot="arm", lineage=("lever",), term=5.0, unix=UNIX, key="p"), 1.0
    )
    effects = core.handle(on.StopAsked(reason="enough", order="o", within=1.0), 2.0)
    assert {part for _, part in asked_parts(effects)} == {HARDWARE, "tool"}


def test_a_stop_ends_every_command_of_an_enslaved_robot_also_beside_one_that_goes_on_by_itself() -> None:
    """Found by a new random case: who stops was taken for somebody who may only end detached commands."""
    core = new_core()
    core.handle(invocation("k0", "go", deadline_at=90.0), 1.0)
    core.handle(on.DetachAsked(key="k0"), 1.0)
    core.handle(invocation("k1", "go", deadline_at=90.0), 1.0)
    parent = Address("robot", "lever", "1")
    core.handle(
        on.ParentAsked(parent=parent, slot="arm", lineage=("lever",), term=5.0, unix=1e9, key="p"), 2.0
    )
    assert [call.key for call in core.state.calls.live.values() if call.cause is None] == []


def test_a_call_that_ran_begins_again_when_its_state_is_decoded() -> None:
    core = new_core()
    core.handle(invocation("k0", "go", deadline_at=10.0), 1.0)
    core.handle(invocation("k1", "go", deadline_at=90.0), 1.0)
    core.handle(on.StepTaken(key="k0", path="1", step=on.StepResult("look", None, 2.5)), 1.0)
    after = RobotCore(decoded(core.state))
    assert after.handle(on.Restored(calls=("k0",)), 2.0) == [Begin(key="k0")]
    assert after.state.calls.live["k0"].steps == {"1": on.StepResult("look", None, 2.5)}
    assert [type(effect) for effect in after.handle(on.Tick(unix=UNIX), 11.0)] == [Interrupt]
    ended = after.handle(on.Finish(key="k0", reply=Returned(key="k0")), 11.0)
    assert [effect.key for effect in ended if isinstance(effect, Begin)] == ["k1"]
