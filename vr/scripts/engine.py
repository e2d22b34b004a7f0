"""The rules at work: a happening in, orders out. It has no thread, no robot and no clock of its own.

One CLIPS environment for each engine. The same happenings in the same order give the same orders. Whatever
the rules do ends: after `MOST_FIRINGS`, after `LONGEST` of processor time, or when memory grows too much.
"""

from __future__ import annotations

import contextlib
import re
import weakref
from collections import deque
from collections.abc import Callable, Generator, Mapping
from typing import Any, cast

import clips
import msgspec
from clips.common import CLIPSError

from robotree.vr.base.written import Scalar
from robotree.vr.scripts import expression, joins
from robotree.vr.scripts.expression import Form, is_word, show
from robotree.vr.scripts.guard import CHECK
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
    seconds_of,
)
from robotree.vr.scripts.memory import RuleAgenda, WorkingMemory
from robotree.vr.scripts.program import (
    CHOICE,
    LONGEST_LIST,
    MESSAGE,
    PARAMETER,
    PARTNER,
    READING,
    ROLE,
    SYSTEM,
    Program,
    Rule,
    template_form,
)

MOST_FIRINGS = 1500
"""Rules that may fire for one happening."""
LONGEST = 0.04
"""[s] of processor time for one happening."""
MOST_MEMORY = 64_000_000
"""[bytes] of one environment."""
MOST_ORDERS = 64
"""For one happening."""
MOST_CONVERSATIONS = 1000
"""Conversations of which it is known that their rules named them by a number."""
LONGEST_QUESTION = 400
"""Letters."""
LONGEST_WAIT = 7 * 24 * 3600.0
"""[s] of one timer."""
LONGEST_TEXT = 1_000
"""Characters that a rule may put together."""
REMEMBERED = 200
"""Firings that are remembered for explanations."""
_TOLD = 100
"""Firings of one happening whose facts are remembered."""
_GLANCE = 16
"""Firings between two looks at the clock."""
_RULE = re.compile(r"in rule (\S+)")
_PLAIN = (
    (re.compile(r"Attempt to divide by zero.*"), "it divides by zero"),
    (
        re.compile(r"Function '(.+)' expected argument #\d+ to be of type integer or float\."),
        r"\1 takes numbers only",
    ),
)
"""Messages of CLIPS, and their form here."""


class ScriptError(Exception):
    """A script cannot go on. Its text is one sentence that names the rule."""


class Firing(msgspec.Struct, frozen=True):
    """A rule that has fired, and why."""

    rule: str
    because: tuple[str, ...]
    """The facts that met its conditions; `*` for a condition that no fact was to meet."""
    orders: tuple[ScriptOrder, ...]
    number: int
    """Of the happening, counted from 1."""


class Engine:
    """One run of a script."""

    def __init__(
        self,
        program: Program,
        parameters: Mapping[str, Scalar] | None = None,
        *,
        spent: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """Build the rules and assert what the script begins with; nothing fires yet.

        Args:
            program: the script.
            parameters: those that differ from their defaults.
            spent: returns the processor time of this thread [s].

        Raises:
            ScriptError: CLIPS does not take a rule.
        """
        self.program = program
        self.firings: deque[Firing] = deque(maxlen=REMEMBERED)
        self._spent = spent
        self._orders: list[ScriptOrder] = []
        self._error = ""
        self._numbers = 0
        self._conversations: dict[str, Any] = {}
        """What rules have named by a number, by its text, the oldest first."""
        self.happened = 0
        """Happenings so far."""
        self.fired = 0
        """Firings so far."""
        self.handled = False
        """Whether a rule has used the latest happening."""
        self._told: list[str] = []
        self._crowded: int | None = None
        """Number of the rule whose join was compared when there were too many comparisons."""
        self._env = clips.Environment()
        self._env.add_router(_Ear(self._told))
        self._agenda = RuleAgenda(self._env, program.rules)
        self._define()
        self._build()
        self._env.reset()
        self._compared = self._env.find_global(joins.COUNT)
        self._memory = WorkingMemory(self._env)
        self._partners: dict[str, Any] = {}
        self._roles: dict[str, Any] = {}
        self._told_of: dict[str, dict[tuple[str, Scalar], Any]] = {}
        """The readings and commands of a partner, as facts, by partner."""
        self._slots = {partner.name: partner.slots for partner in program.partners}
        """The slots of each partner: of a group several."""
        self._names = {slot: name for name, slots in self._slots.items() for slot in slots}
        for slot in self._names:
            self._seat(slot, "")
        self._begin_with(parameters or {})
        self._look()
        self._raise("with its first facts")

    def _begin_with(self, parameters: Mapping[str, Scalar]) -> None:
        """Take the parameters of the start, and the facts that are there at the beginning."""
        values = {one.name: one.default for one in self.program.parameters} | dict(parameters)
        for name, value in values.items():
            self._memory.begin(PARAMETER, name=into(name), value=into(value))
        for count, fact in enumerate(self.program.facts):
            self._memory.begin(fact.head, **_slots(self.program, fact))
            if count % _GLANCE == 0 or self._crowded is not None:
                self._look()
                self._raise("with its first facts")

    def __del__(self) -> None:
        """Let go of the facts before their environment ends."""
        if hasattr(self, "_memory"):
            given = (fact for facts in self._told_of.values() for fact in facts.values())
            for fact in (*self._partners.values(), *self._roles.values(), *given):
                self._memory.remove(fact)
            self._memory.close()
            self._env.clear()  # else CLIPS says on standard output that not all memory is free

    # -- what it does ------------------------------------------------------------------------------

    def feed(self, happening: Happening) -> list[ScriptOrder]:
        """Tell the rules what has happened and let them come to rest.

        Returns:
            What they want done, in order.

        Raises:
            ScriptError: they do not come to rest, or one of them failed.
        """
        self.happened += 1
        self._orders.clear()
        self._told.clear()
        self._compared.value = 0
        for slot in self._meant(happening.partner) if happening.partner else ():
            self._seat(slot, happening.robot, stopped=happening.act == "stopped")
        event = self._memory.insert(
            MESSAGE,
            perf=into(happening.performative),
            **{"from": into(happening.sender)},
            act=into(happening.act),
            args=[into(value) for value in happening.arguments[:LONGEST_LIST]],
            conv=self._conversations.get(happening.conversation, into(happening.conversation)),
            by=happening.reply_by,
        )
        number = self._memory.number(event)
        try:
            self._look()
            self._raise("as it was told something")
            self.handled = self._settle(number)
        finally:
            self._memory.remove(event)
        self._settle(number)  # what a rule wanted when there was no such message
        if happening.act == "lost" and happening.partner and not self.handled:
            reason = f"{happening.sender} is lost ({_first(happening)})"
            raise ScriptError(f"{reason} and no rule of {self.program.name} handles it")
        return list(self._orders)

    def called(self, name: str, values: tuple[Any, ...]) -> Any:
        """Do what a rule calls for; the error is kept, for CLIPS would print it and go on."""
        try:
            return self._acts[name](*values)
        except Exception as error:
            self._error = self._error or str(error)
            raise

    def role(self, partner: str, role: str) -> None:
        """Take note of the role that a partner plays from now on."""
        if (fact := self._roles.pop(partner, None)) is not None:
            self._memory.remove(fact)
        name = self._names.get(partner, partner)
        self._roles[partner] = self._memory.insert(ROLE, partner=into(name), name=into(role))

    def reading(self, partner: str, name: str, value: float) -> None:
        """Take note of what a partner reads from now on."""
        facts = self._told_of.setdefault(partner, {})
        if (fact := facts.pop((READING, name), None)) is not None:
            self._memory.remove(fact)
        of = self._names.get(partner, partner)
        facts[READING, name] = self._memory.insert(
            READING, partner=into(of), name=into(name), value=float(value)
        )

    def choice(self, partner: str, argument: str, value: str) -> None:
        """Take note of a value that commands of a partner take for an argument; several times is once."""
        facts = self._told_of.setdefault(partner, {})
        if (argument, value) not in facts:
            facts[argument, value] = self._memory.insert(
                CHOICE,
                partner=into(self._names.get(partner, partner)),
                argument=into(argument),
                value=into(value),
            )

    # -- what it looks like ------------------------------------------------------------------------

    def facts(self) -> list[str]:
        """Return all facts as text, the oldest first."""
        with self._unheard():
            return [self._memory.text(fact) for fact in self._memory.each()]

    def agenda(self) -> list[str]:
        """Return the names of the rules that would fire next."""
        return [one.rule for one in self._agenda.each()]

    def matches(self, rule: str) -> list[str]:
        """Return what CLIPS says about how far the conditions of a rule are met."""
        self._told.clear()
        self._env.eval(f"(matches {rule} succinct)")
        text = "".join(self._told)
        self._told.clear()
        return text.splitlines()

    # -- inside ------------------------------------------------------------------------------------

    def _meant(self, partner: str) -> tuple[str, ...]:
        """Return the slots that are meant: one, or in a table of tests all of a group."""
        return (partner,) if partner in self._names else self._slots.get(partner, (partner,))

    def _seat(self, slot: str, robot: str, *, stopped: bool = False) -> None:
        state = "missing" if not robot else "stopped" if stopped else "here"
        if (fact := self._partners.pop(slot, None)) is not None:
            self._memory.remove(fact)
        for fact in () if robot else self._told_of.pop(slot, {}).values():
            self._memory.remove(fact)
        self._partners[slot] = self._memory.insert(
            PARTNER, name=into(self._names.get(slot, slot)), robot=into(robot or "none"), state=into(state)
        )

    def _settle(self, event: int) -> bool:
        """Let rules fire until none wants to; return whether one of them has used a certain fact.

        A rule fires once for one happening and the same facts, also when it changes one of these facts: else
        a counter of messages would count for ever. (A fact that is modified keeps its number, CLIPS 6.4.)
        """
        begun, used = self._spent(), False
        done: set[tuple[str, str]] = set()
        self._memory.learn()
        for count in range(MOST_FIRINGS):
            with self._unheard():
                activation = self._agenda.first()
            if activation is None:
                return used
            rule, basis = activation.rule, activation.basis
            if event in activation.numbers:
                used = True
                if (rule, basis) in done:  # the rule has changed one of these facts itself: not twice
                    self._agenda.drop(activation)
                    continue
                done.add((rule, basis))
            because = self._because(basis) if count < _TOLD else ()
            before = len(self._orders)
            self._env.run(1)
            self.fired += 1
            self._memory.learn()
            self._look()
            self._raise(f"in rule {rule}")
            self.firings.append(Firing(rule, because, tuple(self._orders[before:]), self.happened))
            if count % _GLANCE == _GLANCE - 1 and self._spent() - begun > LONGEST:
                raise ScriptError(f"the rules of {self.program.name} do not come to rest: {self._busiest()}")
        raise ScriptError(f"the rules of {self.program.name} do not come to rest: {self._busiest()}")

    def _because(self, basis: str) -> tuple[str, ...]:
        """Write the facts of an activation."""
        with self._unheard():
            return tuple(self._text(part) for part in basis.split(","))

    @contextlib.contextmanager
    def _unheard(self) -> Generator[None]:
        """Write facts without asking our listeners about each piece of them: that takes most of the time."""
        for listener in self._env.routers():
            listener.deactivate()
        try:
            yield
        finally:
            for listener in self._env.routers():
                listener.activate()

    def _text(self, part: str) -> str:
        found = re.search(r"f-(\d+)", part)
        return f"{found.group()} {self._memory.known(int(found.group(1)))}".strip() if found else "*"

    def _busiest(self) -> str:
        last = [firing.rule for firing in self.firings][-20:]
        names = sorted(set(last))
        return (
            f"{' and '.join(names[:4])} set each other off"
            if len(names) > 1
            else f"{names[0]} sets itself off"
        )

    @property
    def memory(self) -> int:
        """Memory of the environment [bytes]."""
        return int(self._env.call("mem-used"))

    def _look(self) -> None:
        if self._crowded is not None and not self._error:
            self._error = self._crowd(self.program.rules[self._crowded])
        if self.memory > MOST_MEMORY:
            self._error = (
                self._error
                or f"the rules need more than {MOST_MEMORY // 1_000_000} MB: too many facts fit together"
            )

    def _crowd(self, rule: Rule) -> str:
        """Say which conditions are met by so many facts that their combinations cannot be compared."""
        counts = [line.rpartition(" ")[2] for line in self.matches(rule.name) if line.startswith("Pattern ")]
        wanted = [condition for condition in rule.conditions if condition.template]
        each = [
            f"{count} for {one.template} (line {one.mark.line})"
            for one, count in zip(wanted, counts, strict=False)
        ]
        return (
            f"the conditions of rule {rule.name} (line {rule.mark.line}) can be met in too many ways, "
            f"more than {joins.MOST_COMPARISONS:,} were compared for one happening; facts that fit are "
            f"{', '.join(each)}: let the conditions share a variable, or forget facts"
        )

    def _raise(self, where: str) -> None:
        complaint = "".join(self._told).strip()
        if self._error or complaint:
            reason = self._error or _sentence(complaint)
            if (found := _RULE.search(complaint)) and not self._error:
                where = f"in rule {found.group(1)}"
            where = "" if self._crowded is not None else f", {where}"
            self._error = ""
            self._told.clear()
            raise ScriptError(f"{self.program.name}{where}: {reason}")

    def _build(self) -> None:
        self._env.eval("(set-dynamic-constraint-checking TRUE)")
        for template in (*SYSTEM, *self.program.templates):
            self._env.build(template_form(template))
        self._env.build(joins.counter())
        for number, rule in enumerate(self.program.rules):
            form = joins.bounded(rule.form, number, self.program.template)
            if form is not None:
                self._env.build(joins.join_function(number))
            try:
                self._env.build(show(self._agenda.leveled(form or rule.form, rule)))
            except CLIPSError:
                raise ScriptError(
                    f"rule {rule.name} (line {rule.mark.line}): {_sentence(''.join(self._told))}"
                ) from None

    def _define(self) -> None:
        mine: weakref.ref[Any] = weakref.ref(
            self
        )  # clipspy keeps functions for ever: they must not keep the engine
        for name in self._acts:
            self._env.define_function(_fenced(mine, name), name)

    @property
    def _acts(self) -> dict[str, Callable[..., Any]]:
        """Functions that rules can call, by the name in CLIPS."""
        return {
            "do": self._do,
            "do-as": self._do_as,
            "ask": self._ask,
            "ask-as": self._ask_as,
            "reply": self._reply,
            "cancel": self._cancel,
            "play": self._play,
            "wait": self._wait,
            "note": lambda *values: self._order(LogLine(text=joined(values))),
            "end": lambda *values: self._order(ScriptEnd(text=joined(values))),
            "fail": lambda *values: self._order(ScriptEnd(text=joined(values), well=False)),
            "text": lambda *values: into(joined(values)),
            "fields": self._fields,
            CHECK: self._check,
            joins.CROWDED: self._crowds,
        }

    def _order(self, order: ScriptOrder) -> None:
        if len(self._orders) >= MOST_ORDERS:
            raise ScriptError(f"it floods: more than {MOST_ORDERS} orders for one happening")
        self._orders.append(order)

    def _do(self, *values: Any) -> Any:
        self._numbers += 1
        return self._do_as(into(f"act-{self._numbers}"), *values)

    def _do_as(self, conversation: Any, partner: Any, act: Any, *values: Any) -> Any:
        if str(partner) not in self._slots:
            known = ", ".join(self._slots) or "none"
            raise ScriptError(f"there is no partner {partner}; it has: {known}")
        plain: list[Scalar] = []
        named: dict[str, Scalar] = {}
        rest = iter(values)
        for value in rest:
            if isinstance(value, clips.Symbol) and value.endswith("=") and len(value) > 1:
                named[value[:-1]] = out(next(rest, "none"))
            else:
                plain.append(out(value))
        self._order(
            Do(
                conversation=self._spelled(conversation),
                partner=str(partner),
                act=str(act),
                values=tuple(plain),
                named=named,
            )
        )
        return conversation

    def _ask(self, question: Any, *answers: Any) -> Any:
        self._numbers += 1
        return self._ask_as(into(f"ask-{self._numbers}"), question, *answers)

    def _ask_as(self, conversation: Any, question: Any, *answers: Any) -> Any:
        asked, given = str(out(question)).strip(), tuple(_spoken(out(one)) for one in answers)
        if not asked or len(asked) > LONGEST_QUESTION:
            raise ScriptError(f"a question has 1 to {LONGEST_QUESTION} letters, and {asked[:40]!r} has not")
        self._order(PersonAsked(conversation=self._spelled(conversation), question=asked, answers=given))
        return conversation

    def _spelled(self, conversation: Any) -> str:
        """Return a conversation as others know it, by a text; what comes of it has the rule's value again.

        Else a number would not be equal to what a rule compares it with, and no rule would hear of it.
        """
        text = str(conversation)
        self._conversations.pop(text, None)
        if isinstance(conversation, int | float):
            self._conversations[text] = conversation
            if len(self._conversations) > MOST_CONVERSATIONS:
                del self._conversations[next(iter(self._conversations))]
        return text

    def _reply(self, conversation: Any, performative: Any, *values: Any) -> None:
        self._order(
            ScriptReply(
                conversation=str(conversation), performative=str(performative), values=tuple(map(out, values))
            )
        )

    def _wait(self, name: Any, seconds: Any, conversation: Any = "none") -> None:
        length = seconds_of(out(seconds))
        if length is None or not 0 <= length <= LONGEST_WAIT:
            raise ScriptError(
                f"wait {name}: {seconds} is no time from 0 s to 7 days; write it as 5 s or 2 min"
            )
        self._order(Wait(name=str(name), seconds=length, conversation=self._spelled(conversation)))

    def _cancel(self, what: Any) -> None:
        self._order(CancelAct(what=str(what)))

    def _play(self, partner: Any, role: Any) -> None:
        self._order(Play(partner=str(partner), role=str(role)))

    def _fields(self, *values: Any) -> list[Any]:
        if len(values) > LONGEST_LIST:
            raise ScriptError(f"a list of more than {LONGEST_LIST} values")
        return list(values)

    def _crowds(self, number: int) -> Any:
        self._crowded = number
        return clips.Symbol("FALSE")

    def _check(self) -> None:
        self._look()
        if self._error:
            raise ScriptError(self._error)


def _slots(program: Program, fact: Form) -> dict[str, Any]:
    template = program.template(fact.head)
    slots: dict[str, Any] = {}
    for slot in fact.rest:
        assert isinstance(slot, Form)  # noqa: S101 # the guard has seen to it
        values = [into(expression.value(one)) for one in slot.rest]
        known = template.slot(slot.head) if template else None
        slots[slot.head] = values if known is not None and known.several else values[0]
    return slots


def _spoken(value: Scalar) -> str:
    """Return an answer as people read and write it."""
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def _fenced(mine: weakref.ref[Any], name: str) -> Callable[..., Any]:
    """Return a function for CLIPS that keeps its error: CLIPS would print it and go on."""

    def fenced(*values: Any) -> Any:
        engine: Engine | None = mine()
        return None if engine is None else engine.called(name, values)

    return fenced


class _Ear(clips.Router):
    """Hears what CLIPS says of mistakes: nothing of it reaches the terminal, and nothing is lost."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__("robotree-ear", 100)
        self._heard = lines

    def query(self, name: str) -> bool:
        return name in {"stdout", "stderr", "stdwrn"}

    def write(self, name: str, message: str) -> None:
        del name
        self._heard.append(message)


def into(value: Scalar) -> Any:
    """Return a plain value as CLIPS holds it: the same text is always the same value there."""
    if isinstance(value, bool):
        return clips.Symbol("TRUE" if value else "FALSE")
    if isinstance(value, str):
        value = value[:LONGEST_TEXT].replace("\0", "")
        return clips.Symbol(value) if is_word(value) else value
    if isinstance(value, int) and abs(value) >= 2**63:
        return float(value)
    return value


def out(value: Any) -> Any:
    """Return a value of CLIPS as a plain one."""
    if isinstance(value, clips.Symbol):
        return {"TRUE": True, "FALSE": False}.get(str(value), str(value))
    if isinstance(value, list | tuple):
        return [out(one) for one in cast("list[Any]", value)]
    return value


def joined(values: tuple[Any, ...]) -> str:
    """Return the text that a rule puts together."""
    text = "".join(f"{value:g}" if isinstance(value, float) else str(value) for value in values)
    if len(text) > LONGEST_TEXT:
        raise ScriptError(f"a text of more than {LONGEST_TEXT} characters")
    return text


def _first(happening: Happening) -> str:
    return str(happening.arguments[-1]) if happening.arguments else "no reason given"


def _sentence(text: str) -> str:
    """Return the first thing that CLIPS said, without its code."""
    line = next((line for line in text.splitlines() if line.strip()), "CLIPS gives no reason")
    line = re.sub(r"^\[\w+\]\s*(WARNING:\s*)?", "", line.strip())
    for pattern, words in _PLAIN:
        line = pattern.sub(words, line)
    return line
