"""One run of a script, inside its command `start`: happenings go to the rules, their orders to robots.

The command waits in one place only. Acts, timers and messages wake it; `do` begins an act and never waits.
Time and waiting are those of the command, so that a script runs in virtual time, too.
"""

from __future__ import annotations

import math
import shlex
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, cast

import msgspec

from robotree.vr.author.child import ChildCommand
from robotree.vr.author.context import Activity, CallFuture, CallLimit, running
from robotree.vr.author.readings import Record
from robotree.vr.author.together import Started
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.description import CommandSpec
from robotree.vr.base.errors import CommandCancelled, CommandFailed, SlotEmpty, Stopped, VrError
from robotree.vr.base.written import Mark, Scalar, Word, value_of
from robotree.vr.core.events import AT
from robotree.vr.scripts.engine import Engine, ScriptError
from robotree.vr.scripts.happening import (
    CancelAct,
    Do,
    Happening,
    LogLine,
    PersonAsked,
    Play,
    ScriptEnd,
    ScriptOrder,
    ScriptReply,
    Wait,
)
from robotree.vr.scripts.program import CHOICE, READING, Program
from robotree.vr.scripts.questions import MOST_QUESTIONS, Questions

ANSWER = "answer"
"""What happens when one member has ended its part."""


@dataclass(slots=True)
class GroupAct:
    """The answers of the members, as they come."""

    order: Do
    """As the rules gave it: to the group."""
    number: int
    """Among the acts of the script."""
    open: set[str]
    """Slots of members that have not answered."""
    results: dict[str, tuple[Scalar, ...]] = field(default_factory=dict[str, tuple[Scalar, ...]])
    """Of those that have done it, by slot."""
    reasons: dict[str, str] = field(default_factory=dict[str, str])
    """Of those that have not, by slot."""

    def answer(self, slot: str, robot: str, ended: Happening) -> Happening:
        """Take how a member's part has ended; return what the rules are told of it.

        Args:
            slot: of the member.
            robot: the one that was in it when the act began.
            ended: `done` or a failure, as the end of any act.
        """
        self.open.discard(slot)
        well = ended.performative != "failure"
        values = ended.arguments[1:] if well else ended.arguments
        if well:
            self.results[slot] = values
        else:
            self.reasons[slot] = f"{robot or slot}: {values[0] if values else 'no reason given'}"
        return Happening(
            act=ANSWER,
            sender=self.order.partner,
            arguments=(self.order.act, robot or slot, well, *(values or ("none",))),
            conversation=self.order.conversation,
        )

    def end(self) -> Happening:
        """Return how the whole act has ended: done if all have done it; the results in the order of slots."""
        if not self.reasons:
            results = (value for slot in sorted(self.results, key=_place) for value in self.results[slot])
            return Happening(
                act="done",
                sender=self.order.partner,
                arguments=(self.order.act, *results),
                conversation=self.order.conversation,
                number=self.number,
            )
        count = len(self.reasons) + len(self.results)
        first = self.reasons[min(self.reasons, key=_place)]
        return Happening(
            performative="failure",
            act=self.order.act,
            sender=self.order.partner,
            arguments=(f"{len(self.reasons)} of {count} did not do it: {first}",),
            conversation=self.order.conversation,
            number=self.number,
        )


def _place(slot: str) -> int:
    return int(slot.rpartition("_")[2])


LONGEST = 500
"""Messages that may wait: more is a flood."""


TICK = 0.05
"""[s] Longest time until the thread looks again: at partners, at a cancel, at progress."""
MOST_ACTS = 64
"""Acts under way."""
MOST_A_SECOND = 200
"""Orders in one second; more is a flood."""
QUIET = 1.0
"""[s] Least time between two looks at the readings of a partner."""
STEP = 0.05
"""Share of an act after which its progress is told again."""
REMEMBERED = 1000
"""Messages that are remembered as told; their senders have their answers long before."""
ANSWERED = "answered"
"""What happens when a person has answered a question."""
ROLE = "role"
"""Conversation of the acts by which partners take roles."""
TIMER = "(timer)"
"""Sender of the end of a timer of the script's own: no message comes from it."""


class _Act(msgspec.Struct):
    """An act under way."""

    order: Do
    call: CallFuture | None
    """None: it could not begin."""
    error: VrError | None = None
    """Why it could not."""
    progress: float = 0.0
    """How far it was when the rules were told of it last, 0 to 1."""
    after: int = 0
    """Number of the act by which its partner takes the role that was given before it; 0: it has begun."""
    group: int = 0
    """Number of the act of a group that it is a part of; 0: of none."""
    robot: str = ""
    """The member that does it."""


class _Asked(NamedTuple):
    """The arguments of an act, by the names that its partner has for them."""

    named: Mapping[str, Any]
    limit: CallLimit | None
    error: str
    """Why it has none; empty: it has."""


class ScriptRun:
    """Leads the partners of one script until it ends.

    All that comes from outside comes by one way, `_next`, as a step of the command: messages, ends of acts,
    timers, who is in a slot and how he is. What it knows changes only when such a happening is told, and the
    acts are steps, too. So after a crash of the host the same happenings give the same facts and acts.
    """

    def __init__(
        self, robot: VirtualRobot, program: Program, parameters: Mapping[str, Scalar], activity: Activity
    ) -> None:
        """Build the rules; nothing is done yet.

        Args:
            robot: the script.
            program: its rules.
            parameters: with which it was started.
            activity: its running command.

        Raises:
            ScriptError: they cannot be built.
        """
        self.is_current = False
        """Whether it has told the rules all that they were told before a crash of its host."""
        self._simulated = activity.simulated
        self.engine = Engine(program, parameters, spent=self._spent)
        self.lock = threading.Lock()
        """Held while the rules work or are looked at, never during a wait: CLIPS takes one thread."""
        self.inbox, self._wake = deque[Happening | int](), activity.wake
        """Messages, and the numbers of acts that have ended, until this command takes them out."""
        self.missing = ""
        """The partners that it lacks, in words; empty: it is active."""
        self.answers: dict[str, ScriptReply] = {}
        """To conversations that are open."""
        self.open_conversations: set[str] = set()
        """Conversations in which somebody waits for an answer."""
        self.taken: dict[str, str] = {}
        """Conversations of messages that the rules were told, by key of the call; the newest `REMEMBERED`."""
        self.talks = 0  # number of the latest conversation that the rules were told of
        self.waiting: dict[str, Callable[[], None]] = {}
        """Wakes who waits until a message is taken, or answered: by key of the call that brought it."""
        self._robot, self._program, self._now = robot, program, activity.now
        self._at = 0.0
        """[s] When the latest happening was taken out."""
        self._slots = {partner.name: partner.slots for partner in program.partners}
        self._names = {slot: name for name, slots in self._slots.items() for slot in slots}
        self._groups = {partner.name: partner for partner in program.partners if partner.count}
        self._left: frozenset[str] = frozenset()  # slots whose robots were lost
        self._seats = dict.fromkeys(self._names, "")
        """The robot in each slot, as the rules know it."""
        self._held: dict[str, str] = {}  # why partners are stopped
        self._stops: dict[str, int] = {}
        """The number of the stop of each partner that the rules were told of last, as far as is known."""
        self._readings: dict[str, dict[str, float]] = {}  # of each partner, as the rules have them
        self._looked: dict[str, float] = {}  # when the readings of a partner were looked at [s]
        self._news: deque[Happening] = deque()
        """Happenings that were found at a look, beside those that were taken out there."""
        self.questions = Questions()
        self.late: set[str] = set()  # keys of calls that answered what was answered already
        self._wants_readings = _names_in(program, READING, "name")
        self._wants_choices = _names_in(program, CHOICE, "argument")
        self._acts: dict[int, _Act] = {}
        """Acts of single robots, each with the slot of its partner."""
        self._of_groups: dict[int, GroupAct] = {}
        self._timers: list[tuple[float, Wait]] = []
        self._numbers, self._orders, self._second = 0, 0, 0.0
        self._over: ScriptEnd | None = None
        self._wants_progress = any("progress" in rule.clips for rule in program.rules)

    @property
    def under_way(self) -> int:
        """How many acts are under way."""
        return len(self._acts)

    def _spent(self) -> float:
        """Return processor time [s], which counts for rules at work.

        In virtual time, and while it is told again what has happened, only firings are counted: what follows
        must not depend on how quick the machine is.
        """
        return 0.0 if self._simulated or not self.is_current else time.thread_time()

    # -- the loop ----------------------------------------------------------------------------------

    def whole(self) -> str:
        """Lead until a rule ends it; return what it says at the end. What it has begun ends with its command.

        Raises:
            CommandFailed: it cannot go on.
            CommandCancelled: it was ended from outside.
        """
        try:
            self._next(self._whether_whole)
            self._say("active")
            self._tell(Happening(act="start"))
            while self._over is None:
                self.take(self._next(self.look))
        except ScriptError as error:
            raise self._failed(str(error)) from None
        if not self._over.well:
            raise self._failed(self._over.text)
        return self._over.text

    def _failed(self, detail: str) -> CommandFailed:
        return CommandFailed(robot=self._robot.name, command="start", detail=detail)

    def _next(self, look: Callable[[], Happening | None]) -> Happening:
        """Wait for what happens next, as one step of the command."""

        def kept() -> dict[str, Any] | None:
            self.is_current = True
            happening = look()
            return (
                None if happening is None else {AT: self._now(), "happening": msgspec.to_builtins(happening)}
            )

        received = running().receive(kept, TICK)
        self._at = received[AT]
        return msgspec.convert(received["happening"], Happening)

    def _whether_whole(self) -> Happening | None:
        missing = lacking(self._robot, self._program)
        if missing and missing != self.missing:
            self._say(f"inactive: {missing}")
        self.missing = missing
        return None if missing else Happening(act="whole")

    def put(self, item: Happening | int) -> None:
        """Take in a message, or the number of an act that has ended; from any thread."""
        self.inbox.append(item)
        self._wake()

    # -- what the rules are told -------------------------------------------------------------------

    def take(self, happening: Happening) -> None:
        """Take note of what has happened, and tell the rules."""
        if happening.number:
            act = self._acts.pop(happening.number, None)
            if act is not None:
                self._take_end(act, happening)
            return
        partner = happening.partner
        match happening.act:
            case "found" | "lost" if partner:
                self._seats[partner] = happening.robot
                self._left = self._left - {partner} if happening.robot else self._left | {partner}
                for kept in (self._held, self._stops, self._readings, self._looked):
                    kept.pop(partner, None)
            case "stopped" if partner:
                self._held[partner] = str(happening.arguments[-1])
            case "released" if partner:
                self._held.pop(partner, None)
            case "timer" if happening.sender == TIMER:
                due = next(timer for timer in self._timers if _is_of(timer[1], happening))
                self._timers.remove(due)
                happening = msgspec.structs.replace(happening, sender="script")
            case _:
                pass
        if happening.key:
            self._take_message(happening)
        if happening.act != ANSWERED or self._take_answer(happening):
            self._tell(happening)

    def _take_answer(self, happening: Happening) -> bool:
        """Take what a person has answered; False: somebody else was faster, the rules have one answer."""
        if self.questions.meant(happening.conversation) is None:
            self.late.add(happening.key)
            return False
        self.questions.take_back(happening.conversation)
        return True

    def _take_end(self, act: _Act, ended: Happening) -> None:
        """Take note of the end of an act; of a part of a group's act, and whether it was the last one."""
        if act.order.conversation == ROLE:
            refused = ended.performative == "failure"
            self._begin_after(ended.number, str(ended.arguments[0]) if refused else "")
        whole = self._of_groups.get(act.group)
        if whole is None:
            self._tell(ended)
            return
        slot = act.order.partner
        self._tell(whole.answer(slot, act.robot or self._seats[slot], ended))
        if not whole.open and whole.number in self._of_groups:  # a rule has not cancelled it just now
            del self._of_groups[whole.number]
            self._tell(whole.end())

    def _take_message(self, happening: Happening) -> None:
        """Remember a message as told, so that its sender is answered and it is not told twice."""
        key = happening.key
        if happening.reply_by:
            self.open_conversations.add(happening.conversation)
        self.taken[key] = happening.conversation
        number = happening.conversation.removeprefix("talk-")
        self.talks = max(self.talks, int(number) if number.isdigit() else 0)
        if len(self.taken) > REMEMBERED:
            del self.taken[next(iter(self.taken))]
        self.waiting.get(key, _nobody)()

    def _tell(self, happening: Happening) -> None:
        if self._over is not None:
            return
        sender, arguments = happening.sender, happening.arguments
        with self.lock:
            self._note_facts(happening)
            orders = self.engine.feed(happening)
        played: dict[str, str] = {}
        for order in orders:
            if isinstance(order, Play) and played.setdefault(order.partner, order.role) != order.role:
                raise ScriptError(
                    f"{order.partner} is given two roles at once ({played[order.partner]} and {order.role})"
                )
        for order in orders:
            self._carry_out(order)
        if happening.act == "finish":
            self._over = self._over or ScriptEnd(text="finished on request")
        here = any(self._seats[slot] for slot in self._slots.get(sender, ()))
        if happening.performative == "failure" and here and not self.engine.handled:
            raise ScriptError(f"{sender}.{happening.act} failed ({arguments[0]}) and no rule handles it")

    def _note_facts(self, happening: Happening) -> None:
        """Have the rules know what partners play, read and take, as it is from now on."""
        sender, arguments = happening.sender, happening.arguments
        if happening.act == "role":
            self.engine.role(sender, str(arguments[0]))
        elif happening.act == "reading":
            self.engine.reading(happening.robot or sender, str(arguments[0]), float(arguments[1]))
        elif happening.number and arguments[0] == "play" and len(arguments) > 1:
            self.engine.role(sender, str(arguments[1]))
        for argument, value in happening.choices:
            self.engine.choice(happening.partner, argument, value)

    # -- what happens ------------------------------------------------------------------------------

    def look(self) -> Happening | None:
        """Return what has happened and was not told yet; None: nothing. The rules are told later."""
        if not self._news and (change := self._change_of_partners()) is not None:
            return change
        if not self._news and self._wants_progress:
            self._look_at_progress()
        if self._news:
            return self._news.popleft()
        now = self._now()
        for due, timer in self._timers:
            if due <= now:
                return Happening(
                    act="timer", sender=TIMER, arguments=(timer.name,), conversation=timer.conversation
                )
        while self.inbox:
            item = self.inbox.popleft()
            happening = self._end_of(item) if isinstance(item, int) else item
            if happening is not None:
                return happening
        return None

    def _change_of_partners(self) -> Happening | None:
        """Return that a partner is there, gone, stopped or released, where the rules do not know it yet."""
        self.missing = lacking(self._robot, self._program)
        for place in self._names:
            slot = self._robot.child_slots[place]
            bond = slot.bond
            fit = bond is not None and not unfit(self._robot, place, self._program)
            name = bond.child.name if bond is not None and fit else slot.watched.name if slot.watched else ""
            before = self._seats[place]
            if before and name != before:
                return self._changed("lost", place, "", before, slot.lost or "it was released")
            if name != before:
                found = self._changed("found", place, name, name)
                asked = self._wants_choices and bond is not None
                choices = choices_of(bond.description.commands) if asked and bond is not None else []
                meant = tuple(choice for choice in choices if is_meant(choice[0], self._wants_choices))
                return msgspec.structs.replace(found, choices=meant)
            if name and (change := self._change_of_stop(place)) is not None:
                return change
        return None

    def _change_of_stop(self, partner: str) -> Happening | None:
        """Return that a partner is stopped or released, as it publishes it; look at its readings at times."""
        try:
            state = running().published(partner)
        except SlotEmpty:  # it has just been lost
            return None
        if state is None:
            return None
        name = self._seats[partner]
        stops = self._stops.setdefault(partner, state.stops - bool(state.stop_reason))
        if state.stop_reason and partner not in self._held:
            self._stops[partner] = state.stops
            return self._changed("stopped", partner, name, name, state.stop_reason)
        if not state.stop_reason and partner in self._held and (state.stops < 0 or state.stops >= stops):
            return self._changed("released", partner, name, name)
        if partner not in self._held and all(act.order.partner != partner for act in self._acts.values()):
            self._stops[partner] = state.stops
        if self._wants_readings and self._now() >= self._looked.get(partner, -math.inf) + QUIET:
            self._looked[partner] = self._now()
            self._look_at_readings(partner, state.readings)
        return None

    def _look_at_readings(self, partner: str, readings: Mapping[str, float]) -> None:
        latest = self._readings.setdefault(partner, {})
        for name, value in readings.items():
            if is_meant(name, self._wants_readings) and value != latest.get(name) and math.isfinite(value):
                latest[name] = value
                of = self._names[partner]
                self._news.append(Happening(act="reading", sender=of, robot=partner, arguments=(name, value)))

    def _look_at_progress(self) -> None:
        for act in self._acts.values():
            share = math.nan if act.call is None or act.call.done else act.call.progress
            if not math.isnan(share) and abs(share - act.progress) >= STEP:
                act.progress = share
                self._news.append(
                    Happening(
                        act="progress",
                        sender=self._names[act.order.partner],
                        arguments=(act.order.act, share),
                        conversation=act.order.conversation,
                    )
                )

    def _end_of(self, number: int) -> Happening | None:
        """Return how an act has ended, or what is to be told before that; None: nobody wants to know."""
        act = self._acts.get(number)
        if act is None:
            return None
        order = act.order
        try:
            value = None if act.call is None else cast("Started", act.call).get(0.0)
            if act.error is not None:
                raise act.error  # as one that was under way
        except VrError as error:
            running().check()
            failure = Happening(
                performative="failure",
                act=order.act,
                sender=self._names[order.partner],
                arguments=(str(error),),
                conversation=order.conversation,
                number=number,
            )
            if (change := self._change_of_partners()) is not None:  # that one is lost is told before
                self.inbox.appendleft(number)
                return change
            name = self._seats.get(order.partner, "")
            if isinstance(error, Stopped) and error.data["robot"] == name and order.partner not in self._held:
                self._news.append(failure)  # and that it is stopped, though it has not published that
                if order.partner in self._stops:  # it is released when it has published that, and the end
                    self._stops[order.partner] += 1
                return self._changed("stopped", order.partner, name, name, str(error.data["reason"]))
            return failure
        return Happening(
            act="done",
            sender=self._names[order.partner],
            arguments=(order.act, *flat(value)),
            conversation=order.conversation,
            number=number,
        )

    # -- orders ------------------------------------------------------------------------------------

    def _carry_out(self, order: ScriptOrder) -> None:  # noqa: C901 # one for each
        self._count()
        match order:
            case Do():
                self._do(order)
            case Play(partner=partner, role=role):
                self._do(Do(conversation=ROLE, partner=partner, act="play", named={"role": role}))
            case ScriptReply(conversation=conversation):
                if conversation in self.open_conversations:
                    self.answers[conversation] = order
                    for key in [key for key, talk in self.taken.items() if talk == conversation]:
                        self.waiting.get(key, _nobody)()
            case PersonAsked():
                self._ask(order)
            case Wait(seconds=seconds):
                self._timers.append((self._at + seconds, order))
            case CancelAct(what=what):
                self._cancel(what)
            case LogLine(text=text):
                self._say(text)
                running().say("info", text)
            case ScriptEnd():
                self._over = self._over or order

    def _ask(self, question: PersonAsked) -> None:
        if len(self.questions) >= MOST_QUESTIONS:
            raise ScriptError(f"it floods: {MOST_QUESTIONS} questions wait for people")
        self.questions.ask(question)
        self._say(f"asks: {question.question}")

    def _count(self) -> None:
        if self._at - self._second >= 1.0:
            self._second, self._orders = self._at, 0
        self._orders += 1
        if self._orders > MOST_A_SECOND:
            raise ScriptError(f"it floods: more than {MOST_A_SECOND} orders in one second")
        if len(self._timers) > MOST_A_SECOND:
            raise ScriptError(f"it floods: more than {MOST_A_SECOND} timers at once")

    def _do(self, order: Do) -> None:
        if order.partner not in self._groups:
            self._do_alone(order)
            return
        slots, optional = self._slots[order.partner], self._groups[order.partner].optional
        there = [slot for slot in slots if self._seats[slot] or not (optional or slot in self._left)]
        there = there or [slots[0]]  # that one says that it is not there
        self._numbers += 1
        number = self._numbers
        self._of_groups[number] = GroupAct(order, number, {*there})
        for slot in there:
            self._do_alone(msgspec.structs.replace(order, partner=slot), number)

    def _do_alone(self, order: Do, group: int = 0) -> None:
        if len(self._acts) >= MOST_ACTS:
            raise ScriptError(
                f"it floods: {MOST_ACTS} acts are under way, {order.partner}.{order.act} would be one more"
            )
        self._numbers += 1
        robot, role = self._seats[order.partner], self._role_under_way(order.partner)
        self._acts[self._numbers] = act = _Act(order, None, after=role, group=group, robot=robot)
        if not act.after:
            self._begin(self._numbers, act)

    def _role_under_way(self, partner: str) -> int:
        """Return the number of the latest act by which a partner takes a role; 0: none is under way."""
        taken = (
            number
            for number, act in self._acts.items()
            if act.order.partner == partner and act.order.conversation == ROLE
        )
        return max(taken, default=0)

    def _begin_after(self, role: int, failure: str) -> None:
        """Begin the acts that waited until their partner plays a role.

        Where it does not play it, they fail: the manner in which it would act is not the one that was meant.

        Args:
            role: number of the act by which the partner took the role.
            failure: why it could not; empty: it plays it.
        """
        for number, act in [*self._acts.items()]:
            if act.after != role:
                continue
            act.after = 0
            if failure and act.order.conversation != ROLE:
                act.error = VrError(detail=f"{act.order.partner} does not play the role for it: {failure}")
                self.put(number)
            else:
                self._begin(number, act)

    def _begin(self, number: int, act: _Act) -> None:
        order = act.order
        asked = msgspec.convert(running().receive(lambda: self._asked(order), TICK), _Asked)
        try:
            if asked.error:
                raise VrError(detail=asked.error)  # noqa: TRY301 # it fails as what its partner refuses
            act.call = running().start(order.partner, order.act, asked.named, asked.limit)
        except CommandCancelled:
            raise
        except VrError as error:
            act.error = error
            self.put(number)
        else:
            act.call.when_done(lambda: self.put(number))

    def _asked(self, order: Do) -> Any:
        """Return an `_Asked` as plain data: the names are known only while the partner is there."""
        try:
            named, limit = ChildCommand(self._robot, order.partner, order.act).asked(
                order.values, dict(order.named)
            )
        except VrError as error:
            return [{}, None, str(error)]
        return [dict(named), None if limit is None else [*limit], ""]

    def _cancel(self, what: str) -> None:
        self.questions.take_back(what)
        cancelled: list[int] = []
        for number, act in list(self._acts.items()):
            partner = self._names[act.order.partner]
            if what in {act.order.conversation, act.order.partner, partner}:
                del self._acts[number]
                self._of_groups.pop(act.group, None)
                if act.call is not None:
                    act.call.cancel()
                cancelled.append(number)
        for number in cancelled:
            self._begin_after(number, "that was cancelled")
        self._timers = [timer for timer in self._timers if timer[1].conversation != what]

    def _say(self, text: str) -> None:
        running().progress(math.nan, text)

    def _changed(self, act: str, slot: str, robot: str, *arguments: str) -> Happening:
        return Happening(act=act, sender=self._names[slot], partner=slot, robot=robot, arguments=arguments)


def _nobody() -> None:
    """Wake nobody: nobody waits."""


def _is_of(timer: Wait, happening: Happening) -> bool:
    return (timer.name, timer.conversation) == (happening.arguments[0], happening.conversation)


def _names_in(program: Program, template: str, slot: str) -> frozenset[str]:
    """Return which names conditions on a kind of fact are about; "" among them: any."""
    return frozenset(str(one.wanted.get(slot, "")) for one in program.wanted(template))


def is_meant(name: str, wanted: frozenset[str]) -> bool:
    """Whether a condition is about this name, or about any."""
    return name in wanted or "" in wanted


def choices_of(commands: Iterable[CommandSpec]) -> list[tuple[str, str]]:
    """Return arguments and the values that they take, where these are named: places, things."""
    found = (
        (parameter.name, value)
        for spec in commands
        for parameter in spec.parameters
        for value in parameter.choices
    )
    return [*dict.fromkeys(found)]


def flat(value: Any) -> tuple[Scalar, ...]:
    """Return a result as plain values, its parts in their order."""
    if value is None:
        return ()
    if isinstance(value, Record | dict):
        return tuple(one for part in cast("dict[str, Any]", value).values() for one in flat(part))
    if isinstance(value, list | tuple):
        return tuple(one for part in cast("list[Any]", value) for one in flat(part))
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        return (float(value),)
    return (value if isinstance(value, bool | int | float | str) else str(value),)


def lacking(robot: VirtualRobot, program: Program) -> str:
    """Return which needed partners are missing, as words: `needs robot (Companion)`; empty: none."""
    found: list[str] = []
    needed = [
        (partner, slot) for partner in program.partners if not partner.optional for slot in partner.slots
    ]
    for partner, slot in needed:
        if robot.child_slots[slot].bond is None and robot.child_slots[slot].watched is None:
            found.append(f"{slot} ({partner.kind})")
        elif reason := unfit(robot, slot, program):
            found.append(f"{slot} ({partner.kind}): {reason}")
    return f"needs {', '.join(found)}" if found else ""


def unfit(robot: VirtualRobot, slot: str, program: Program) -> str:
    """Return what the robot in a slot lacks of what its partner must have; empty: nothing."""
    partner = program.of_slot(slot)
    bond = robot.child_slots[slot].bond
    if bond is None or partner is None:
        return ""
    known = {command.name for command in bond.description.commands if command.available}
    lacks = [need for need in partner.needs if need not in known]
    if lacks:
        return f"{bond.child.name} has no {', '.join(lacks)}"
    wrong = [
        f"{key} {value}"
        for key, value in partner.attributes.items()
        if bond.description.attributes.get(key, "") != value
    ]
    return f"{bond.child.name} has no {', '.join(wrong)}" if wrong else ""


def words(text: str) -> tuple[Scalar, ...]:
    """Return the values of an argument that is typed as one text: `Anna "the kitchen" 3`."""
    try:
        return tuple(value_of(Word(one, Mark())) for one in shlex.split(text))
    except ValueError:
        return (text,)
