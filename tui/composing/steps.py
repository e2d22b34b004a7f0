"""What a composition is: slots, parameters and steps, and whether they can be meant. Pure."""

from __future__ import annotations

import builtins
import keyword
import math
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, Literal

import msgspec

from robotree.tui.errors import BadComposition
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import CommandSpec, FieldSpec, offered
from robotree.vr.base.errors import BadArgument

Kinds = Mapping[str, Mapping[str, CommandSpec]]
"""The commands of the kinds of robots, by name of the kind."""
Relation = Literal["is", "is not", "above", "below"]

NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,23}")
WORD: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
"""A name that a robot gives to a command, an argument or a part of a result."""
DEEPEST: Final = 4
"""Steps in steps in steps."""
MOST: Final = 200
"""Steps of one composition."""
OFTEN: Final = 1000
"""Times that something is repeated, at most."""
LONGEST: Final = 3600.0
"""[s] of one wait."""
LONGEST_TEXT: Final = 120
"""[characters] of a text that a person has written."""
RESERVED: Final = frozenset(
    {"self", "name", "kept", "attributes", "log", "within", "team", "both"}
    | set(dir(VirtualRobot))
    | set(dir(builtins))
)
"""What a page means already."""
TIMES: Final = FieldSpec(name="times", type="int", lower=1, upper=OFTEN)
SECONDS: Final = FieldSpec(name="seconds", type="float", unit="s", lower=0.0, upper=LONGEST)


class Variable(msgspec.Struct, frozen=True):
    """A value that is given when the page is called: a parameter, and what is added to it."""

    name: str
    plus: float = 0.0


Value = Variable | float | int | bool | str


class Comparison(msgspec.Struct, frozen=True):
    """A reading of a child, and what it is compared with."""

    slot: str
    command: str
    """One that only reads."""
    field: str
    """The part of its result; empty: the result is one value."""
    relation: Relation
    value: Value

    @property
    def path(self) -> str:
        """As people write it."""
        return ".".join(filter(None, (self.slot, self.command, self.field)))


class ComposedCall(msgspec.Struct, frozen=True):
    """A command of a child."""

    slot: str
    command: str
    arguments: tuple[tuple[str, Value], ...] = ()


class ComposedWait(msgspec.Struct, frozen=True):
    """A time [s] in which nothing is asked."""

    seconds: Value


class ComposedExpectation(msgspec.Struct, frozen=True):
    """What must hold, or the page fails and says why."""

    that: Comparison
    otherwise: str


class ComposedPart(msgspec.Struct, frozen=True):
    """Steps under a name: a method of the page."""

    name: str
    steps: tuple[ComposedStep, ...] = ()


class ComposedRepeat(msgspec.Struct, frozen=True):
    """Steps that are carried out several times, or until a reading is so."""

    times: Value
    """How often, or how often at most."""
    steps: tuple[ComposedStep, ...] = ()
    until: Comparison | None = None
    """Looked at after each time; when it never holds, the page fails. None: all times are carried out."""


class ComposedBranch(msgspec.Struct, frozen=True):
    """Steps that depend on a reading."""

    that: Comparison
    steps: tuple[ComposedStep, ...] = ()
    otherwise: tuple[ComposedStep, ...] = ()


class ComposedTogether(msgspec.Struct, frozen=True):
    """Calls and parts that begin at the same time."""

    steps: tuple[ComposedStep, ...] = ()


ComposedStep = (
    ComposedCall | ComposedWait | ComposedExpectation | ComposedPart | ComposedRepeat | ComposedBranch
    | ComposedTogether
)  # fmt: skip
Block = ComposedPart | ComposedRepeat | ComposedBranch | ComposedTogether


class Composition(msgspec.Struct, frozen=True):
    """A virtual robot, as it was composed."""

    name: str
    """Of the page."""
    slots: tuple[tuple[str, str], ...] = ()
    """Name and kind of each."""
    steps: tuple[ComposedStep, ...] = ()
    parameters: tuple[tuple[str, Any], ...] = ()
    """Name and default of each."""
    command: str = "work"
    doc: str = "What was composed of the commands of other robots."
    does: str = "Do all steps."
    """What its command does."""


def inner(step: ComposedStep) -> Iterator[tuple[ComposedStep, ...]]:
    """Yield the blocks of steps in a step."""
    if isinstance(step, ComposedBranch):
        yield step.steps
        yield step.otherwise
    elif isinstance(step, Block):
        yield step.steps


def walk(steps: Iterable[ComposedStep], depth: int = 1) -> Iterator[tuple[int, ComposedStep]]:
    """Yield all steps, those in steps too, in the order in which they are written, and how deep each is."""
    for step in steps:
        yield depth, step
        for block in inner(step):
            yield from walk(block, depth + 1)


def values_of(step: ComposedStep) -> Iterator[Value]:
    """Yield the values of one step, without those of the steps in it."""
    match step:
        case ComposedCall():
            yield from (value for _, value in step.arguments)
        case ComposedWait(value) | ComposedRepeat(value):
            yield value
        case _:
            pass
    if (that := compared_in(step)) is not None:
        yield that.value


def compared_in(step: ComposedStep) -> Comparison | None:
    """Return the comparison on which a step depends; None: it depends on none."""
    if isinstance(step, ComposedRepeat):
        return step.until
    return step.that if isinstance(step, ComposedExpectation | ComposedBranch) else None


def variables(steps: Iterable[ComposedStep]) -> list[str]:
    """Return the names of the parameters that steps use, in their order, each once."""
    used = (value for _, step in walk(steps) for value in values_of(step))
    return list(dict.fromkeys(value.name for value in used if isinstance(value, Variable)))


def slots_of(steps: Iterable[ComposedStep]) -> set[str]:
    """Return the slots that steps use."""
    found: set[str] = set()
    for _, step in walk(steps):
        if isinstance(step, ComposedCall):
            found.add(step.slot)
        elif (that := compared_in(step)) is not None:
            found.add(that.slot)
    return found


# -- whether it can be meant -----------------------------------------------------------------------


class Checked(msgspec.Struct, frozen=True):
    """A composition that can be meant: its values are those that its robots take."""

    composition: Composition
    fields: Mapping[str, FieldSpec]
    """What each parameter is."""


def checked(given: Composition, kinds: Kinds) -> Checked:
    """Return a composition with the values that its robots take, each in their units.

    Args:
        given: with values as a person has written them, such as `30 cm`.
        kinds: of the robots that can be in its slots.

    Raises:
        BadComposition: it cannot be meant; one sentence, with the step.
    """
    _check_names(given)
    meaning = _Meaning(given, kinds)
    steps = meaning.block(given.steps)
    if not any(isinstance(step, ComposedCall) for _, step in walk(steps)):
        raise BadComposition("no step calls a robot; add one, such as `arm.go_to x=0.3 y=0 z=0.2 twist=0`")
    unused = [name for name, _ in given.parameters if name not in meaning.fields]
    if unused:
        raise BadComposition(f"no step uses the parameter {unused[0]}; write ${unused[0]} where it belongs")
    spare = [name for name, _ in given.slots if name not in slots_of(steps)]
    if spare:
        raise BadComposition(f"no step uses the slot {spare[0]}; take it out, or call it")
    defaults = tuple((name, meaning.default(name)) for name, _ in given.parameters)
    return Checked(msgspec.structs.replace(given, steps=steps, parameters=defaults), meaning.fields)


def _check_names(given: Composition) -> None:
    for what, names in (
        ("page", [given.name]),
        ("command", [given.command]),
        ("slot", [name for name, _ in given.slots]),
        ("parameter", [name for name, _ in given.parameters]),
        ("part", [step.name for _, step in walk(given.steps) if isinstance(step, ComposedPart)]),
    ):
        for name in names:
            _check_name(what, name, reserved=what != "page")
        if len(names) > len(set(names)):
            twice = next(name for name in names if names.count(name) > 1)
            raise BadComposition(f"two {what}s are called {twice}; give one another name")
    members = [given.command, *(name for name, _ in given.slots)]
    if len(members) > len(set(members)):
        raise BadComposition(f"the command and a slot are both called {given.command}; rename one")
    if given.name in sys.stdlib_module_names or given.name == "robotree":
        raise BadComposition(f"Python has a module {given.name} itself; take another name, my_{given.name}")
    for what, text in (("doc", given.doc), ("does", given.does)):
        if not _is_text(text):
            raise BadComposition(
                f"`{what}` needs a text of 1 to {LONGEST_TEXT} characters that can be printed"
            )


def _expect_words(where: str, *names: str) -> None:
    """Refuse a name that a robot gives and that is no word of Python: nothing else can stand in a page."""
    for name in names:
        if not WORD.fullmatch(name) or keyword.iskeyword(name):
            raise BadComposition(f"{where}: {name[:40]!r} cannot be the name of anything in a page")


def _is_text(text: str) -> bool:
    return bool(text.strip()) and len(text) <= LONGEST_TEXT and text.isprintable()


def _check_name(what: str, name: str, *, reserved: bool) -> None:
    if not NAME.fullmatch(name):
        raise BadComposition(
            f"{name[:40]!r} cannot be the name of a {what}: up to 24 small letters, digits and _"
        )
    if keyword.iskeyword(name) or keyword.issoftkeyword(name) or (reserved and name in RESERVED):
        raise BadComposition(f"{name} means something in a page already; give the {what} another name")


class _Meaning:
    """Finds out what each value is."""

    def __init__(self, given: Composition, kinds: Kinds) -> None:
        self.fields: dict[str, FieldSpec] = {}
        self._slots = dict(given.slots)
        self._defaults = dict(given.parameters)
        self._kinds = kinds
        self._count = 0
        for name, kind in given.slots:
            if kind not in kinds:
                known = ", ".join(sorted(kinds))
                raise BadComposition(f"slot {name}: nothing is known of a kind {kind!r}; known are {known}")

    def block(self, steps: Sequence[ComposedStep], depth: int = 1) -> tuple[ComposedStep, ...]:
        if depth > DEEPEST and steps:
            raise BadComposition(f"steps lie more than {DEEPEST} deep in each other; make fewer of them")
        return tuple(self._named(step, depth) for step in steps)

    def _named(self, step: ComposedStep, depth: int) -> ComposedStep:
        try:
            return self._step(step, depth)
        except BadComposition as error:
            error.step = error.step or step
            raise

    def _step(self, step: ComposedStep, depth: int) -> ComposedStep:  # noqa: C901, PLR0911 # one for each step
        self._count += 1
        if self._count > MOST:
            raise BadComposition(f"it has more than {MOST} steps; make two robots, one on top of the other")
        match step:
            case ComposedCall():
                return self._call(step)
            case ComposedWait():
                return ComposedWait(self._value(SECONDS, step.seconds, "wait"))
            case ComposedExpectation():
                if not _is_text(step.otherwise):
                    raise BadComposition(
                        f"`expect {step.that.path} …` needs a text of up to {LONGEST_TEXT} characters that"
                        ' can be printed, behind `else`, that says what is wrong: else "nothing is there"'
                    )
                return ComposedExpectation(self._comparison(step.that), step.otherwise)
            case ComposedPart() | ComposedTogether() | ComposedRepeat() | ComposedBranch() if not step.steps:
                raise BadComposition(f"there is no step in `{_word(step)}`; add one, or take it out")
            case ComposedPart():
                return ComposedPart(step.name, self.block(step.steps, depth + 1))
            case ComposedRepeat():
                times = self._value(TIMES, step.times, "repeat")
                until = None if step.until is None else self._comparison(step.until)
                return ComposedRepeat(times, self.block(step.steps, depth + 1), until)
            case ComposedBranch():
                then = self.block(step.steps, depth + 1)
                return ComposedBranch(
                    self._comparison(step.that), then, self.block(step.otherwise, depth + 1)
                )
            case ComposedTogether():
                return self._together(step, depth)

    def _together(self, step: ComposedTogether, depth: int) -> ComposedStep:
        busy: set[str] = set()
        for each in step.steps:
            if not isinstance(each, ComposedCall | ComposedPart):
                raise BadComposition(f"`together` takes commands and parts; put `{_word(each)}` into a part")
            slots = slots_of([each])
            if both := slots & busy:
                raise BadComposition(f"{min(both)} cannot do two things at the same time in `together`")
            busy |= slots
        return ComposedTogether(self.block(step.steps, depth + 1))

    def _spec(self, slot: str, command: str) -> CommandSpec:
        if slot not in self._slots:
            known = ", ".join(self._slots) or "none"
            raise BadComposition(f"{slot}.{command}: there is no slot {slot}; there is: {known}")
        kind = self._slots[slot]
        spec = self._kinds[kind].get(command)
        if spec is None:
            known = offered(self._kinds[kind], command)
            raise BadComposition(f"{slot}.{command}: {kind} has no such command; it has: {known}")
        _expect_words(slot, spec.name)  # a description may come from anybody
        return spec

    def _call(self, step: ComposedCall) -> ComposedCall:
        spec, label = self._spec(step.slot, step.command), f"{step.slot}.{step.command}"
        given = dict(step.arguments)
        if len(given) < len(step.arguments):
            raise BadComposition(f"{label}: an argument is given twice")
        _expect_words(label, *given)
        for name in given:
            if name not in spec.by_name:
                takes = ", ".join(spec.by_name) or "none"
                raise BadComposition(f"{label} has no parameter {name}; it takes: {takes}")
        missing = [each.name for each in spec.parameters if each.required and each.name not in given]
        if missing:
            raise BadComposition(f"{label} needs {', '.join(missing)}")
        return ComposedCall(
            step.slot,
            step.command,
            tuple((name, self._value(spec.by_name[name], value, label)) for name, value in step.arguments),
        )

    def _comparison(self, that: Comparison) -> Comparison:
        spec = self._spec(that.slot, that.command)
        if spec.effect != "read" or any(each.required for each in spec.parameters):
            raise BadComposition(f"{that.slot}.{that.command} cannot be compared: it does not only read")
        part = next((each for each in spec.result if each.name == that.field), None)
        if part is None or part.nested or part.type == "bytes":
            known = ", ".join(each.name or "(one value)" for each in spec.result) or "nothing"
            raise BadComposition(f"{that.path}: the result has no such value; it has: {known}")
        numeric = part.type in {"float", "int"}
        if (that.relation in {"above", "below"}) != numeric and part.type != "int":
            fitting = "`above` or `below`" if numeric else "`is` or `is not`"
            raise BadComposition(f"{that.path}: compare it with {fitting}")
        _expect_words(that.path, *filter(None, [that.field]))
        plain = msgspec.structs.replace(part, name=that.field or "value", lower=None, upper=None)
        return msgspec.structs.replace(that, value=self._value(plain, that.value, that.path))

    def _value(self, field: FieldSpec, value: Value, label: str) -> Value:
        if field.nested or field.type == "bytes":
            raise BadComposition(f"{label}: {field.name} is no single value, and cannot be composed")
        if isinstance(value, Variable):
            return self._variable(field, value, label)
        try:
            plain = check_argument(field, value, command=label)
        except BadArgument as error:
            raise BadComposition(str(error)) from None
        if isinstance(plain, str) and not plain.isprintable():
            raise BadComposition(
                f"{label}: {field.name} has characters that cannot be printed; leave them out"
            )
        return float(plain) if field.type == "float" else plain

    def _variable(self, field: FieldSpec, value: Variable, label: str) -> Value:
        name = value.name
        if name not in self._defaults:
            raise BadComposition(
                f"{label}: there is no parameter {name}; write `parameter {name} = VALUE` above"
            )
        if value.plus and field.type not in {"float", "int"}:
            raise BadComposition(f"{label}: nothing can be added to ${name}, which is no number")
        before = self.fields.get(name)
        self.fields[name] = _both(before, field, name)
        start = self.default(name)  # what is added must stay what the command takes
        if value.plus:
            self._value(field, start + value.plus, label)
        return value

    def default(self, name: str) -> Any:
        return self._value(self.fields[name], self._defaults[name], f"parameter {name}")


def _both(before: FieldSpec | None, field: FieldSpec, name: str) -> FieldSpec:
    """Return what a parameter is that is used in two places."""
    ends = {end: value if value is not None and math.isfinite(value) else None
            for end, value in (("lower", field.lower), ("upper", field.upper))}  # fmt: skip
    plain = {"name": name, "required": True, "default": None, "nullable": False, "doc": ""}
    now = msgspec.structs.replace(field, **plain, **ends)
    if before is None:
        return now
    if (before.type, before.unit, before.choices) != (now.type, now.unit, now.choices):
        raise BadComposition(f"the parameter {name} is used for values that differ in type or unit; make two")
    lower = max((one.lower for one in (before, now) if one.lower is not None), default=None)
    upper = min((one.upper for one in (before, now) if one.upper is not None), default=None)
    return msgspec.structs.replace(now, lower=lower, upper=upper)


def _word(step: ComposedStep) -> str:
    """Return how a step that is no call begins, as a line has it."""
    if isinstance(step, ComposedPart):
        return f"part {step.name}"
    words: Mapping[type, str] = {ComposedRepeat: "repeat", ComposedTogether: "together", ComposedBranch: "if"}
    return words.get(type(step), "wait" if isinstance(step, ComposedWait) else "expect")
