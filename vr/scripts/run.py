"""One run of a script, inside its command `start`: happenings go to the rules, their orders to robots.

The command waits in one place only. Acts, timers and messages wake it; `do` begins an act and never waits.
Time and waiting are those of the command, so that a script runs in virtual time, too.
"""

from __future__ import annotations

import math
import shlex
import threading
import time
from collections.abc import Iterable, Mapping
from typing import Any, cast

import msgspec

from robotree.vr.author.child import ChildCommand
from robotree.vr.author.context import Activity, CallFuture, running
from robotree.vr.author.readings import Record
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.description import CommandSpec
from robotree.vr.base.errors import CommandCancelled, CommandFailed, SlotEmpty, Stopped, VrError
from robotree.vr.base.written import Mark, Scalar, Word, value_of
from robotree.vr.scripts.engine import Engine, ScriptError
from robotree.vr.scripts.happening import (
    CancelAct,
    Do,
    Happening,
    LogLine,
    Play,
    ScriptEnd,
    ScriptOrder,
    ScriptReply,
    Wait,
)
from robotree.vr.scripts.inbox import ScriptInbox
from robotree.vr.scripts.program import CHOICE, READING, Program

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


class _Act(msgspec.Struct):
    """An act under way."""

    order: Do
    call: CallFuture
    told: float = 0.0
    cancelled: bool = False


class ScriptRun:
    """Leads the partners of one script until it ends."""

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
        # in virtual time only firings are counted: a trace must not depend on how quick the machine is
        self.engine = Engine(program, parameters, spent=_no_time if activity.simulated else time.thread_time)
        self.lock = threading.Lock()
        """Held while the rules work or are looked at, never during a wait: CLIPS takes one thread."""
        self.inbox = ScriptInbox(activity)
        self.missing = ""
        """What it needs and does not have, as words; empty: it is active."""
        self.answers: dict[str, ScriptReply] = {}
        self.open_conversations: set[str] = set()
        """Conversations in which somebody waits for an answer."""
        self.last_log = ""
        self._robot, self._program, self._now = robot, program, activity.now
        self._seats = dict.fromkeys((one.name for one in program.partners), "")
        self._held: dict[str, str] = {}
        """The partners that are stopped, with the reason."""
        self._readings: dict[str, dict[str, float]] = {}
        """What the rules were told of the readings of each partner."""
        self._looked: dict[str, float] = {}
        """When the readings of a partner were looked at [s]."""
        self._wants_readings = _names_in(program, READING, "name")
        self._wants_choices = _names_in(program, CHOICE, "argument")
        self._acts: dict[int, _Act] = {}
        self._timers: list[tuple[float, Wait]] = []
        self._numbers = 0
        self._second, self._orders = 0.0, 0
        self._over: ScriptEnd | None = None
        self._wants_progress = any("progress" in rule.clips for rule in program.rules)

    @property
    def under_way(self) -> int:
        """How many acts are under way."""
        return len(self._acts)

    # -- the loop ----------------------------------------------------------------------------------

    def whole(self) -> str:
        """Lead until a rule ends it; return what it says at the end.

        Raises:
            CommandFailed: it cannot go on; all that it has begun is cancelled.
            CommandCancelled: it was ended from outside.
        """
        try:
            self._await_partners()
            self._tell(Happening(act="start"))
            while self._over is None:
                running().check()
                next_one = self.inbox.take(self._patience())
                if isinstance(next_one, int):
                    self._close(next_one)
                elif next_one is not None:
                    self._tell(next_one)
                self._look_around()
        except ScriptError as error:
            raise self._failed(str(error)) from None
        finally:
            self._cancel(None)
        if not self._over.well:
            raise self._failed(self._over.text)
        return self._over.text

    def _failed(self, detail: str) -> CommandFailed:
        return CommandFailed(robot=self._robot.name, command="start", detail=detail)

    def _await_partners(self) -> None:
        while missing := lacking(self._robot, self._program):
            if missing != self.missing:
                self.missing = missing
                self._say(f"inactive: {missing}")
            running().sleep(TICK)
        self.missing = ""
        self._say("active")
        self._look_at_partners()

    def _tell(self, happening: Happening) -> None:
        if self._over is not None:
            return
        if happening.act == "role":
            with self.lock:
                self.engine.role(happening.sender, str(happening.arguments[0]))
        if happening.act == "reading":
            with self.lock:
                self.engine.reading(
                    happening.sender, str(happening.arguments[0]), float(happening.arguments[1])
                )
        if happening.act == "found" and self._wants_choices:
            self._tell_choices(happening.partner)
        with self.lock:
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
        here = self._seats.get(happening.sender, "")
        if happening.performative == "failure" and here and not self.engine.handled:
            raise ScriptError(
                f"{happening.sender}.{happening.act} failed ({happening.arguments[0]}) and no rule handles it"
            )

    def _patience(self) -> float:
        due = min((at for at, _ in self._timers), default=math.inf) - self._now()
        return max(0.0, min(due, TICK))

    def _look_around(self) -> None:
        now = self._now()
        for timer in [one for one in self._timers if one[0] <= now]:
            self._timers.remove(timer)
            wait = timer[1]
            self.inbox.put(Happening(act="timer", arguments=(wait.name,), conversation=wait.conversation))
        self._look_at_partners()
        if self._wants_progress:
            self._look_at_progress()

    def _look_at_partners(self) -> None:
        for partner in self._program.partners:
            bond = self._robot.child_slots[partner.name].bond
            name = "" if bond is None or unfit(self._robot, partner.name, self._program) else bond.child.name
            before = self._seats[partner.name]
            if name != before:
                self._seats[partner.name] = name
                for kept in (self._held, self._readings, self._looked):
                    kept.pop(partner.name, None)
                if before:
                    reason = self._robot.child_slots[partner.name].lost or "it was released"
                    self._changed("lost", partner.name, "", before, reason)
                if name:
                    self._changed("found", partner.name, name, name)
            if name:
                self._look_at_stop(partner.name)
        self.missing = lacking(self._robot, self._program)

    def _look_at_stop(self, partner: str) -> None:
        """Tell the rules that a partner is stopped or released, as it publishes it."""
        try:
            state = running().published(partner)
        except SlotEmpty:  # it has just been lost
            return
        if state is not None:
            self._stopped(partner, state.stop_reason)
            if self._wants_readings and self._now() >= self._looked.get(partner, -math.inf) + QUIET:
                self._looked[partner] = self._now()
                self._tell_readings(partner, state.readings)

    def _tell_readings(self, partner: str, readings: Mapping[str, float]) -> None:
        told = self._readings.setdefault(partner, {})
        for name, value in readings.items():
            if is_meant(name, self._wants_readings) and value != told.get(name) and math.isfinite(value):
                told[name] = value
                self.inbox.put(Happening(act="reading", sender=partner, arguments=(name, value)))

    def _tell_choices(self, partner: str) -> None:
        bond = self._robot.child_slots[partner].bond
        with self.lock:
            for argument, value in () if bond is None else choices_of(bond.description.commands):
                if is_meant(argument, self._wants_choices):
                    self.engine.choice(partner, argument, value)

    def _stopped(self, partner: str, reason: str) -> None:
        """Take note whether a partner is stopped, and why; empty: it is not."""
        name = self._seats[partner]
        if reason and partner not in self._held:
            self._changed("stopped", partner, name, name, reason)
        elif not reason and self._held.pop(partner, ""):
            self._changed("released", partner, name, name)
        if reason:
            self._held[partner] = reason

    def _changed(self, act: str, partner: str, robot: str, *arguments: str) -> None:
        self.inbox.put(Happening(act=act, sender=partner, partner=partner, robot=robot, arguments=arguments))

    def _look_at_progress(self) -> None:
        for act in self._acts.values():
            share = act.call.progress
            if not math.isnan(share) and abs(share - act.told) >= STEP:
                act.told = share
                self.inbox.put(
                    Happening(
                        act="progress",
                        sender=act.order.partner,
                        arguments=(act.order.act, share),
                        conversation=act.order.conversation,
                    )
                )

    # -- orders ------------------------------------------------------------------------------------

    def _carry_out(self, order: ScriptOrder) -> None:
        self._count()
        match order:
            case Do():
                self._do(order)
            case Play(partner=partner, role=role):
                self._do(Do(conversation="role", partner=partner, act="play", named={"role": role}))
            case ScriptReply(conversation=conversation):
                if conversation in self.open_conversations:
                    self.answers[conversation] = order
            case Wait(seconds=seconds):
                self._timers.append((self._now() + seconds, order))
            case CancelAct(what=what):
                self._cancel(what)
            case LogLine(text=text):
                self._say(text)
                running().say("info", text)
            case ScriptEnd():
                self._over = self._over or order

    def _count(self) -> None:
        now = self._now()
        if now - self._second >= 1.0:
            self._second, self._orders = now, 0
        self._orders += 1
        if self._orders > MOST_A_SECOND:
            raise ScriptError(f"it floods: more than {MOST_A_SECOND} orders in one second")
        if len(self._timers) > MOST_A_SECOND:
            raise ScriptError(f"it floods: more than {MOST_A_SECOND} timers at once")

    def _do(self, order: Do) -> None:
        if len(self._acts) >= MOST_ACTS:
            raise ScriptError(
                f"it floods: {MOST_ACTS} acts are under way, {order.partner}.{order.act} would be one more"
            )
        try:
            call = ChildCommand(self._robot, order.partner, order.act).start(*order.values, **order.named)
        except CommandCancelled:
            raise
        except VrError as error:
            self._ended(order, error, None)
            return
        self._numbers += 1
        number = self._numbers
        self._acts[number] = _Act(order, call)
        call.when_done(lambda: self.inbox.put(number))

    def _close(self, number: int) -> None:
        """Tell the rules how an act has ended."""
        act = self._acts.pop(number)
        if act.cancelled:
            return
        try:
            value = act.call.result(0.0)
        except VrError as error:
            running().check()
            self._look_at_partners()  # that one is lost is told before what failed because of it
            self._ended(act.order, error, None)
        else:
            self._ended(act.order, None, value)

    def _ended(self, order: Do, error: VrError | None, value: Any) -> None:
        if error is not None:
            if isinstance(error, Stopped) and error.data["robot"] == self._seats.get(order.partner):
                self._stopped(order.partner, str(error.data["reason"]))  # before it publishes that
            self.inbox.put(
                Happening(
                    performative="failure",
                    act=order.act,
                    sender=order.partner,
                    arguments=(str(error),),
                    conversation=order.conversation,
                )
            )
            return
        if order.act == "play" and isinstance(value, str):
            with self.lock:
                self.engine.role(order.partner, value)
        self.inbox.put(
            Happening(
                act="done",
                sender=order.partner,
                arguments=(order.act, *flat(value)),
                conversation=order.conversation,
            )
        )

    def _cancel(self, what: str | None) -> None:
        for act in list(self._acts.values()):
            if what is None or what in {act.order.conversation, act.order.partner}:
                act.cancelled = True
                act.call.cancel()
        self._timers = [] if what is None else [one for one in self._timers if one[1].conversation != what]

    def _say(self, text: str) -> None:
        self.last_log = text
        running().progress(math.nan, text)


def _names_in(program: Program, template: str, slot: str) -> frozenset[str]:
    """Return which names conditions on a kind of fact are about; "" among them: any."""
    return frozenset(str(one.wanted.get(slot, "")) for one in program.wanted(template))


def is_meant(name: str, wanted: frozenset[str]) -> bool:
    """Whether a condition is about this name, or about any."""
    return name in wanted or "" in wanted


def choices_of(commands: Iterable[CommandSpec]) -> list[tuple[str, str]]:
    """Return arguments and the values that they take, where these are named: places, things."""
    found = ((one.name, value) for spec in commands for one in spec.parameters for value in one.choices)
    return [*dict.fromkeys(found)]


def flat(value: Any) -> tuple[Scalar, ...]:
    """Return a result as plain values, its parts in their order."""
    if value is None:
        return ()
    if isinstance(value, Record | dict):
        return tuple(one for part in cast("dict[str, Any]", value).values() for one in flat(part))
    if isinstance(value, list | tuple):
        return tuple(one for part in cast("list[Any]", value) for one in flat(part))
    return (value if isinstance(value, bool | int | float | str) else str(value),)


def lacking(robot: VirtualRobot, program: Program) -> str:
    """Return which needed partners are missing, as words: `needs robot (Companion)`; empty: none."""
    found: list[str] = []
    for partner in program.partners:
        if partner.optional:
            continue
        if robot.child_slots[partner.name].bond is None:
            found.append(f"{partner.name} ({partner.kind})")
        elif reason := unfit(robot, partner.name, program):
            found.append(f"{partner.name} ({partner.kind}): {reason}")
    return f"needs {', '.join(found)}" if found else ""


def unfit(robot: VirtualRobot, slot: str, program: Program) -> str:
    """Return what the robot in a slot lacks of what its partner must have; empty: nothing."""
    partner = next(one for one in program.partners if one.name == slot)
    bond = robot.child_slots[slot].bond
    if bond is None:
        return ""
    known = {one.name for one in bond.description.commands if one.available}
    lacks = [one for one in partner.needs if one not in known]
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


def _no_time() -> float:
    return 0.0
