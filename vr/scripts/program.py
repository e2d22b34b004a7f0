"""A script as it was read: what it needs, what it hears, its facts and its rules. Pure.

Both ways to write a script end here, so engine, tests, explanations and the robot know one form only.
"""

from __future__ import annotations

import hashlib
import keyword
import re

import msgspec

from robotree.vr.base.written import Mark, Scalar
from robotree.vr.scripts.expression import Atom, Form, Node, plain, show

LONGEST_LIST = 64
"""Values in one slot that holds several."""
MOST_RULES = 500
MOST_CONDITIONS = 8
"""Of one rule. The work of the matcher may grow as the number of facts to the power of it."""

MOST_TOGETHER = 16
"""Robots in one partner: each act of a group is one of the script's acts for each of them."""

_NAME = re.compile(r"[a-z][a-z0-9_-]{0,39}\Z")
_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]{0,39}\Z")


class Partner(msgspec.Struct, frozen=True, kw_only=True):
    """A slot for a robot that the script commands."""

    name: str
    kind: str
    needs: tuple[str, ...] = ()
    """Commands that it must have."""
    attributes: dict[str, str] = {}
    """The attributes that it must have."""
    takes: dict[str, tuple[str, ...]] = {}
    """Values that its commands take beside the choices of its kind, by the name of the argument."""
    optional: bool = False
    returns: float = 0.0
    """[s] in which it is bound again after it was lost; 0: as every child."""
    choose: str = ""
    """`free`: the script itself chooses a robot that has nothing to do; empty: a person puts one in."""
    where: str = ""
    """What a chosen one must be (`requirement`)."""
    count: int = 0
    """How many robots it is; 0: one alone, else a group, whose acts are given to each member."""
    watched: bool = False
    """It is only watched: the rules know its readings, and nothing is asked of it; it takes no lease."""
    doc: str = ""

    @property
    def slots(self) -> tuple[str, ...]:
        """The slots of its robots: its own name, or of a group `rovers_1`, `rovers_2` …."""
        return tuple(f"{self.name}_{each + 1}" for each in range(self.count)) or (self.name,)


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """A value that may be chosen when the script is started."""

    name: str
    default: Scalar
    doc: str = ""


class ScriptSlot(msgspec.Struct, frozen=True, kw_only=True):
    """One part of a fact."""

    name: str
    several: bool = False
    default: Scalar | None = None
    """None: `none`, or no values at all where there may be several."""


class FactTemplate(msgspec.Struct, frozen=True, kw_only=True):
    """A kind of fact."""

    name: str
    slots: tuple[ScriptSlot, ...]
    doc: str = ""
    mark: Mark = Mark()

    def slot(self, name: str) -> ScriptSlot | None:
        """Return the slot of this name, or None."""
        return next((slot for slot in self.slots if slot.name == name), None)


class Hears(msgspec.Struct, frozen=True, kw_only=True):
    """A message that the script understands: one of its robot's commands."""

    name: str
    parts: tuple[tuple[str, str], ...] = ()
    """Name and type of each argument: `text`, `number` or `yes/no`."""
    doc: str = ""


class Condition(msgspec.Struct, frozen=True, kw_only=True):
    """One condition of a rule, for explanations."""

    text: str
    """As its author wrote it, in one line."""
    mark: Mark = Mark()
    template: str = ""
    """Kind of fact that it wants; empty: it tests values only."""
    wanted: dict[str, Scalar] = {}
    """Slots that must have a certain value."""
    negated: bool = False
    """It wants that there is no such fact."""


class Rule(msgspec.Struct, frozen=True, kw_only=True):
    """One rule."""

    name: str
    form: Form
    """The whole `defrule`."""
    conditions: tuple[Condition, ...]
    mark: Mark = Mark()
    doc: str = ""

    @property
    def priority(self) -> int:
        """The higher one goes first."""
        declare = self.form.rest[1] if len(self.form.rest) > 1 else None
        if not isinstance(declare, Form) or declare.head != "declare":
            return 0
        salience = declare.rest[0]
        assert isinstance(salience, Form)  # noqa: S101 # the guard has seen to it
        return int(show(salience.rest[0]))

    @property
    def clips(self) -> str:
        """The rule as CLIPS is given it, and as `robotree rules check --listing` prints it."""
        name, *rest = map(show, self.form.rest)
        lines = [f"(defrule {name}"]
        bound = ""
        for text in rest:
            if text.startswith("?") or text == "<-":
                bound += f"{text} "
            else:
                lines.append(f"  {bound}{text}")
                bound = ""
        return "\n".join(lines) + ")"


class Program(msgspec.Struct, frozen=True, kw_only=True):
    """A whole script."""

    name: str
    path: str
    source: str
    doc: str = ""
    partners: tuple[Partner, ...] = ()
    parameters: tuple[Parameter, ...] = ()
    templates: tuple[FactTemplate, ...] = ()
    hears: tuple[Hears, ...] = ()
    starters: tuple[str, ...] = ()
    """Names of those who may start it; empty: anyone."""
    itself: bool = False
    """It starts by itself when it has been made."""
    facts: tuple[Form, ...] = ()
    """With which it begins."""
    rules: tuple[Rule, ...] = ()

    @property
    def hash(self) -> str:
        """SHA-256 of the source, in hex."""
        return hashlib.sha256(self.source.encode()).hexdigest()

    @property
    def for_experts(self) -> bool:
        """Whether it is written in CLIPS, and not as when and then."""
        return self.path.lower().endswith(".clp")

    def of_slot(self, slot: str) -> Partner | None:
        """Return the partner of a slot; None: there is none."""
        return next((partner for partner in self.partners if slot in partner.slots), None)

    def template(self, name: str) -> FactTemplate | None:
        """Return a kind of fact that it declares or that every script has."""
        return next((one for one in (*self.templates, *SYSTEM) if one.name == name), None)

    def rule(self, name: str) -> Rule | None:
        """Return the rule of this name, or None."""
        return next((rule for rule in self.rules if rule.name == name), None)

    def wanted(self, template: str) -> list[Condition]:
        """Return the conditions of all rules that want a kind of fact."""
        return [
            condition
            for rule in self.rules
            for condition in rule.conditions
            if condition.template == template
        ]

    @property
    def listing(self) -> str:
        """All that CLIPS is given, one construct for each thing that its author wrote."""
        parts = [template_form(one) for one in (*SYSTEM, *self.templates)]
        where = [f"; {rule.mark.path}:{rule.mark.line}\n{rule.clips}" for rule in self.rules]
        begin = [f"; with which it begins\n{show(fact)}" for fact in self.facts]
        return "\n".join([*parts, *begin, *where])


MESSAGE, PARTNER, PARAMETER, ROLE = "msg", "partner", "parameter", "role"
READING, CHOICE = "reading", "choice"

SYSTEM = (
    FactTemplate(
        name=MESSAGE,
        doc="What has just happened: a message, the end of an act, a timer. It is gone when the rules have"
        " come to rest.",
        slots=(
            ScriptSlot(name="perf"),
            ScriptSlot(name="from"),
            ScriptSlot(name="act"),
            ScriptSlot(name="args", several=True),
            ScriptSlot(name="conv"),
            ScriptSlot(name="by"),
        ),
    ),
    FactTemplate(
        name=PARTNER,
        doc="A partner slot, and whether somebody is in it: here, stopped or missing; a group has several.",
        slots=(ScriptSlot(name="name"), ScriptSlot(name="robot"), ScriptSlot(name="state")),
    ),
    FactTemplate(name=PARAMETER, slots=(ScriptSlot(name="name"), ScriptSlot(name="value"))),
    FactTemplate(
        name=ROLE,
        doc="Which role a partner plays.",
        slots=(ScriptSlot(name="partner"), ScriptSlot(name="name")),
    ),
    FactTemplate(
        name=READING,
        doc="What a partner reads, as it publishes it: `battery`. Each new value is a new fact.",
        slots=(ScriptSlot(name="partner"), ScriptSlot(name="name"), ScriptSlot(name="value")),
    ),
    FactTemplate(
        name=CHOICE,
        doc="A value that commands of a partner take for an argument: a place, a thing.",
        slots=(ScriptSlot(name="partner"), ScriptSlot(name="argument"), ScriptSlot(name="value")),
    ),
)
"""The facts of every script; a message: performative, sender, act, arguments, conversation, reply-by."""

RESERVED = frozenset({
    "and", "or", "not", "test", "exists", "forall", "logical", "object", "declare", "if", "then",
    "else", "while", "is-a", "initial-fact", "do", "do-as", "ask", "ask-as", "reply", "cancel", "play",
    "wait", "log", "end", "fail", "remember", "forget", "update", "slot", "multislot", "default",
})  # fmt: skip
TAKEN = frozenset({
    "stream_outlet", "thaw", "move_to", "host_of",
    "answer", "attributes", "begins", "cancelled", "check", "checkpoint", "child_slots", "cleanup",
    "condition", "context", "facts", "finish", "first", "halted", "hear", "isolated", "kinds", "lead",
    "learn_role", "message", "name", "now", "on_resume", "one_at_a_time", "online", "pinned", "placement",
    "play", "program", "progress", "random", "reading_units", "readings", "resume", "safe_stop", "sleep",
    "slots_now", "space", "start", "together", "verify", "wait_until", "why", "witness",
})  # fmt: skip
"""Names that the script's robot uses itself."""


def template_form(template: FactTemplate) -> str:
    """Write a kind of fact as CLIPS reads it."""
    slots: list[str] = []
    for slot in template.slots:
        if slot.several:
            slots.append(f"(multislot {slot.name} (cardinality 0 {LONGEST_LIST}))")
        else:
            default = "none" if slot.default is None else show(literal(slot.default))
            slots.append(f"(slot {slot.name} (default {default}))")
    return f"(deftemplate {template.name} {' '.join(slots)})"


def literal(value: Scalar, mark: Mark = Mark()) -> Node:  # noqa: B008 # frozen
    """Return a plain value as it stands in a rule."""
    if isinstance(value, bool):
        return Atom("symbol", "TRUE" if value else "FALSE", mark)
    if isinstance(value, int | float):
        return Atom("number", repr(value), mark)
    return plain(value, mark)


def check_name(name: str, mark: Mark, what: str) -> str:
    """Return a name of a rule or fact.

    Raises:
        BrokenScript: it cannot be one.
    """
    if what == "a fact" and name in RESERVED:
        raise mark.error(f"{name!r} cannot be the name of a fact: it is a word of the language")
    if not _NAME.match(name):
        reason = "use small letters, digits, '-' or '_', beginning with a letter"
        raise mark.error(f"{name!r} cannot be the name of {what}: {reason}")
    return name


def check_identifier(name: str, mark: Mark, what: str) -> str:
    """Return a name of something that the script's robot shows to others.

    Raises:
        BrokenScript: it cannot be one.
    """
    if not _IDENTIFIER.match(name) or keyword.iskeyword(name) or name in TAKEN:
        reason = "every script uses it itself" if name in TAKEN else "use small letters, digits and '_'"
        raise mark.error(f"{name!r} cannot be the name of {what}: {reason}")
    return name
