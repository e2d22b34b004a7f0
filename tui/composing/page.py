"""The page of a composition, its panel and its test, as text. Pure.

Nothing that a person has written becomes code: names are checked (`steps`), numbers are numbers, and a text
is written as a literal of Python, or in a docstring without quotes, backslashes and breaks. Lines are broken
as `ruff format` breaks them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from robotree.tui.composing.lines import comparison_text
from robotree.tui.composing.play import Order, Played, play
from robotree.tui.composing.steps import (
    Checked,
    Comparison,
    ComposedBranch,
    ComposedCall,
    ComposedExpectation,
    ComposedPart,
    ComposedRepeat,
    ComposedStep,
    ComposedTogether,
    ComposedWait,
    Kinds,
    Value,
    Variable,
    compared_in,
    variables,
    walk,
)
from robotree.vr.base.description import FieldSpec

WIDTH: Final = 88
"""[characters] of a line, as `ruff format` breaks them unless a project says otherwise."""
MANY: Final = 40
"""Commands from which on a test counts them instead of naming each."""
ALIASES: Final = {
    "m": "Metres", "rad": "Radians", "s": "Seconds", "m/s": "Speed", "N": "Newtons", "rad/s": "Turning",
}  # fmt: skip
"""Names of types by the unit of the value."""
TAKEN: Final = frozenset(
    {"Annotated", "Child", "Failed", "Fake", "Literal", "Path", "Range", "Unit", "VirtualRobot", "Value"}
) | frozenset(ALIASES.values())


def texts(checked: Checked, kinds: Kinds, shipped: Iterable[str], origin: str) -> dict[str, str]:
    """Return the page of a composition, its panel and its test, by the names of their files.

    Args:
        checked: it can be meant.
        kinds: of its robots.
        shipped: names of the kinds that can be imported from `robotree.kinds`.
        origin: how it was composed, one line.

    Raises:
        BadComposition: one call would take too many steps for a test.
    """
    maker = _PageMaker(checked, kinds, frozenset(shipped), origin)
    name = checked.composition.name
    return {f"{name}.py": maker.page(), f"{name}.panel.yaml": maker.panel(), f"test_{name}.py": maker.test()}


def class_name(name: str, taken: Iterable[str]) -> str:
    """Return the name of the class of a page."""
    made = "".join(part.capitalize() for part in name.split("_"))
    return f"{made}Robot" if made in TAKEN or made in set(taken) else made


def described_in(name: str, slot: str) -> str:
    """Return the name of the file that describes a robot whose kind cannot be imported."""
    return f"{name}.{slot}.json"


class _PageMaker:
    def __init__(self, checked: Checked, kinds: Kinds, shipped: frozenset[str], origin: str) -> None:
        self._checked, self._kinds, self._origin = checked, kinds, origin
        self._made = checked.composition
        self._imported = sorted({kind for _, kind in self._made.slots} & shipped)
        self._class = class_name(self._made.name, kinds)
        self._fields = checked.fields
        fields = [self._fields[name] for name, _ in self._made.parameters]
        self._aliases, self._alias_rows = _aliases(fields)
        self._methods = [
            step for depth, step in walk(self._made.steps) if isinstance(step, ComposedPart) and depth > 1
        ]
        """Parts in other steps; those on top stand in the command, under their names."""

    # -- the page -----------------------------------------------------------------------------------

    def page(self) -> str:
        rows = [f'"""{prose(self._made.doc)} {prose(self._origin)} It is yours."""', ""]
        rows += [*self._imports(), ""]
        if self._aliases:
            rows += [*self._alias_rows, ""]
        rows += ["", f"class {self._class}(VirtualRobot):", f'    """{prose(self._made.doc)}"""', ""]
        for slot, kind in self._made.slots:
            rows.append(f"    {slot} = Child({kind if kind in self._imported else literal(kind)})")
        names = [name for name, _ in self._made.parameters]
        defaults = dict(self._made.parameters)
        given = [f"{name}: {self._type(name)} = {literal(defaults[name])}" for name in names]
        rows += ["", "    @command"]
        rows += self._method(self._made.command, given, self._made.does, self._made.steps)
        for part in self._methods:
            names = variables(part.steps)
            given = [f"{name}: {self._type(name)}" for name in names]
            rows += ["", *self._method(f"_{part.name}", given, "", part.steps)]
        return "\n".join(rows) + "\n"

    def _imports(self) -> list[str]:
        used = {name for text in self._aliases for name in ("Annotated", "Literal") if f"{name}[" in text}
        rows = [f"from typing import {', '.join(sorted(used))}", ""] if used else []
        rows += [f"from robotree.kinds import {', '.join(self._imported)}"] if self._imported else []
        names = {"Child", "VirtualRobot", "command"}
        names |= {name for text in self._aliases for name in ("Range", "Unit") if f"{name}(" in text}
        steps = [step for _, step in walk(self._made.steps)]
        if any(compared_in(step) and not isinstance(step, ComposedBranch) for step in steps):
            names.add("Failed")
        ordered = sorted(names, key=lambda name: (name.islower(), name))
        return [*rows, *_call("from robotree.vr import ", ordered, "", "")]

    def _type(self, name: str) -> str:
        text = str(annotation(self._fields[name]))
        return self._aliases.get(text, text)

    def _method(self, name: str, given: Sequence[str], doc: str, steps: Sequence[ComposedStep]) -> list[str]:
        rows = _call(f"    def {name}", ["self", *given], "(", ") -> None:")
        rows += [f'        """{prose(doc)}"""'] if doc else []
        for index, step in enumerate(steps):
            if doc and isinstance(step, ComposedPart):
                share = round(index / len(steps), 2)
                rows += [
                    f"        self.progress({share!r}, {literal(step.name)})",
                    *self._block(step.steps, 2),
                ]
            else:
                rows += self._step(step, 2)
        return rows

    def _step(self, step: ComposedStep, depth: int) -> list[str]:  # noqa: PLR0911 # one for each step
        pad = "    " * depth
        match step:
            case ComposedCall(slot, command, arguments):
                given = [f"{name}={_expression(value)}" for name, value in arguments]
                return _call(f"{pad}self.{slot}.{command}", given, "(", ")")
            case ComposedWait(seconds):
                return [f"{pad}self.sleep({_expression(seconds)})"]
            case ComposedExpectation(that, otherwise):
                return [
                    *_if(pad, _comparison(that, holds=False)),
                    *_call(f"{pad}    raise Failed", [literal(otherwise)], "(", ")"),
                ]
            case ComposedPart(name, inside):
                return _call(f"{pad}self._{name}", variables(inside), "(", ")")
            case ComposedRepeat(times, inside, until):
                rows = [f"{pad}for _ in range({_expression(times)}):", *self._block(inside, depth + 1)]
                if until is None:
                    return rows
                never = [literal(f"it was never so: {comparison_text(until)}")]
                rows += [*_if(f"{pad}    ", _comparison(until)), f"{pad}        break", f"{pad}else:"]
                return [*rows, *_call(f"{pad}    raise Failed", never, "(", ")")]
            case ComposedBranch(that, then, otherwise):
                rows = [*_if(pad, _comparison(that)), *self._block(then, depth + 1)]
                return rows + ([f"{pad}else:", *self._block(otherwise, depth + 1)] if otherwise else [])
            case ComposedTogether(inside):
                return [f"{pad}with self.together() as both:", *self._together(inside, depth + 1)]

    def _block(self, steps: Sequence[ComposedStep], depth: int) -> list[str]:
        return [row for step in steps for row in self._step(step, depth)]

    def _together(self, steps: Sequence[ComposedStep], depth: int) -> list[str]:
        rows: list[str] = []
        for step in steps:
            if isinstance(step, ComposedCall):
                given = [f"{name}={_expression(value)}" for name, value in step.arguments]
                started = f"self.{step.slot}.{step.command}"
            elif isinstance(step, ComposedPart):
                started, given = f"self._{step.name}", variables(step.steps)
            else:
                continue
            rows += _call(f"{'    ' * depth}both.start", [started, *given], "(", ")")
        return rows

    # -- the panel ----------------------------------------------------------------------------------

    def panel(self) -> str:
        """Return a panel: a button that does it as it was composed, and the form of its parameters."""
        made = self._made
        rows = [
            f"title: {json.dumps(class_name(made.name, ()), ensure_ascii=False)}",
            "parts:",
            f"  - text: {json.dumps(prose(made.does), ensure_ascii=False)}",
            f"  - button: {made.command}",
            "    label: as it was composed",
            "    confirm: Is the way free?",
        ]
        if any(isinstance(step, ComposedPart) for step in made.steps):
            rows += ["  - bar: progress", "    from: 0", "    to: 1"]
        return "\n".join([*rows, f"  - form: {made.command}"]) + "\n"

    # -- the test -----------------------------------------------------------------------------------

    def test(self) -> str:
        plain = play(self._checked, self._kinds, {})
        moved = self._moved()
        body = self._case("test_it_does_what_was_composed", {}, plain)
        if moved:
            again = play(self._checked, self._kinds, moved)
            body += ["", "", *self._case("test_it_follows_its_parameters", moved, again)]
        described = [slot for slot, kind in self._made.slots if kind not in self._imported]
        rows = [f'"""What {self._class} does, with fakes for its robots. It is yours."""', ""]
        rows += ["from pathlib import Path", ""] if described else []
        rows += [f"from robotree.kinds import {', '.join(self._imported)}"] if self._imported else []
        turns = any("=in_turn(" in row for row in body)
        rows += [f"from robotree.testing import Fake, {'in_turn, ' if turns else ''}rehearse", ""]
        rows += [f"from {self._made.name} import {self._class}", ""]
        rows += ["HERE = Path(__file__).parent", ""] if described else []
        return "\n".join([*rows, "", *body]) + "\n"

    def _case(self, name: str, arguments: Mapping[str, Any], played: Played) -> list[str]:
        fakes = [self._fake(slot, kind, played) for slot, kind in self._made.slots]
        rows = [f"def {name}() -> None:", *_call("    team = rehearse", [self._class, *fakes], "(", ")")]
        given = [f"{key}={literal(value)}" for key, value in arguments.items()]
        late = [f"within={round(2 * played.seconds) + 60}"] if played.seconds > 20.0 else []
        rows += _call("    team.call", [literal(self._made.command), *given, *late], "(", ")")
        return [*rows, *_expected(played)]

    def _fake(self, slot: str, kind: str, played: Played) -> Bracket:
        what = kind if kind in self._imported else f"HERE / {literal(described_in(self._made.name, slot))}"
        reads = {command: found for (where, command), found in played.reads.items() if where == slot}
        results = [_results(command, found) for command, found in reads.items() if any(found)]
        return Bracket(f"{slot}=Fake(", [what, *results], ")")

    def _moved(self) -> dict[str, Any]:
        """Return another value for the first parameter that is a number; empty: there is none."""
        for name, value in self._made.parameters:
            field = self._fields[name]
            if field.type == "float" and not isinstance(value, bool):
                for by in (0.01, -0.01):
                    moved = round(value + by, 6)
                    low = field.lower if field.lower is not None else moved
                    high = field.upper if field.upper is not None else moved
                    if low <= moved <= high:
                        return {name: moved}
        return {}


# -- words of Python -------------------------------------------------------------------------------


def literal(value: Any) -> str:
    """Return a value as Python, on one line: a text with the quotes that `ruff format` prefers."""
    if not isinstance(value, str):
        return repr(value)
    plain = value.replace("\\", "\\\\")
    plain = "".join(each if each.isprintable() else _escaped(each) for each in plain)
    if plain.count('"') > plain.count("'"):
        return "'" + plain.replace("'", "\\'") + "'"
    return '"' + plain.replace('"', '\\"') + '"'


def _escaped(character: str) -> str:
    code = ord(character)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def prose(text: str) -> str:
    """Return a text as it can stand in a docstring: one line, without quotes and backslashes, ended."""
    plain = "".join(each if each.isprintable() else " " for each in text)
    plain = " ".join(plain.replace("\\", "/").replace('"', "'").split())
    return plain if plain.endswith((".", "!", "?")) else f"{plain}."


def annotation(field: FieldSpec) -> Bracket | str:
    """Return the type of a parameter; a text: it is a word alone."""
    if field.type == "choice":
        return Bracket("Literal[", [literal(choice) for choice in field.choices], "]")
    more = [f"Unit({literal(field.unit)})"] if field.unit else []
    if field.lower is not None or field.upper is not None:
        ends = [field.lower, field.upper]
        more.append(f"Range({', '.join('None' if end is None else _bound(end) for end in ends)})")
    return Bracket("Annotated[", [field.type, *more], "]") if more else field.type


def _bound(end: float) -> str:
    return repr(int(end)) if end == int(end) else repr(end)


def _aliases(fields: Iterable[FieldSpec]) -> tuple[dict[str, str], list[str]]:
    """Return a name for each type that is more than a word, and the rows that give it this name."""
    found: dict[str, str] = {}
    rows: list[str] = []
    for field in fields:
        kind = annotation(field)
        if isinstance(kind, Bracket) and str(kind) not in found:
            stem = ALIASES.get(field.unit, "Value")
            count = sum(alias.rstrip("0123456789") == stem for alias in found.values())
            alias = found[str(kind)] = f"{stem}{count + 1 if count else ''}"
            rows += laid_out(kind._replace(head=f"{alias} = {kind.head}"), "")
    return found, rows


class Bracket(NamedTuple):
    """Something in brackets, such as a call."""

    head: str
    """Up to the opening bracket."""
    parts: Sequence[Bracket | str]
    close: str

    def __str__(self) -> str:
        """Return it on one line."""
        return f"{self.head}{', '.join(map(str, self.parts))}{self.close}"


def laid_out(words: Bracket | str, pad: str, tail: str = "") -> list[str]:
    """Return words on one line; a line for each part in brackets where they do not fit."""
    line = f"{pad}{words}{tail}"
    if isinstance(words, str) or len(line) <= WIDTH or not words.parts:
        return [line]
    inside = [row for part in words.parts for row in laid_out(part, f"{pad}    ", ",")]
    return [f"{pad}{words.head}", *inside, f"{pad}{words.close}{tail}"]


def _call(head: str, parts: Sequence[Bracket | str], opening: str, closing: str) -> list[str]:
    """Return a line with parts between brackets; more lines if they do not fit."""
    pad = head[: len(head) - len(head.lstrip())]
    if not opening and len(f"{head}{', '.join(map(str, parts))}") <= WIDTH:
        return [f"{head}{', '.join(map(str, parts))}"]
    return laid_out(Bracket(f"{head.lstrip()}{opening or '('}", parts, closing or ")"), pad)


def _if(pad: str, condition: str) -> list[str]:
    line = f"{pad}if {condition}:"
    if len(line) <= WIDTH:
        return [line]
    return [f"{pad}if (", f"{pad}    {condition}", f"{pad}):"]


def _expression(value: Value) -> str:
    if not isinstance(value, Variable):
        return literal(value)
    if not value.plus:
        return value.name
    return f"{value.name} {'-' if value.plus < 0 else '+'} {_number(abs(value.plus))}"


def _number(value: float) -> str:
    return repr(int(value)) if value == int(value) else repr(round(value, 9))


def _comparison(that: Comparison, *, holds: bool = True) -> str:
    reading = f"self.{that.slot}.{that.command}()" + (f".{that.field}" if that.field else "")
    if isinstance(that.value, bool):
        when_true = that.value is (that.relation == "is")
        return reading if when_true is holds else f"not {reading}"
    signs = {"is": "==", "is not": "!=", "above": ">", "below": "<"}
    inverse = {"==": "!=", "!=": "=="}
    sign = signs[that.relation]
    if not holds and sign not in inverse:  # the inverse sign would let a reading pass that is not a number
        return f"not ({reading} {sign} {_expression(that.value)})"
    return f"{reading} {sign if holds else inverse[sign]} {_expression(that.value)}"


def _results(command: str, found: Sequence[Mapping[str, Any]]) -> Bracket | str:
    each = [_result(one) for one in found]
    if len({str(one) for one in each}) > 1:
        return Bracket(f"{command}=in_turn(", each, ")")
    first = each[0]
    return (
        first._replace(head=f"{command}={first.head}") if isinstance(first, Bracket) else f"{command}={first}"
    )


def _result(found: Mapping[str, Any]) -> Bracket | str:
    if not found:
        return "None"  # what a fake returns unless it is told
    return literal(found[""]) if set(found) == {""} else _dict(found)


def _dict(found: Mapping[str, Any]) -> Bracket:
    return Bracket("{", [f"{literal(key)}: {literal(value)}" for key, value in found.items()], "}")


def _expected(played: Played) -> list[str]:
    orders = played.orders
    if len(orders) > MANY:
        return [f"    assert len(team.commanded) == {len(orders)}"]
    rows = [_order(each) for each in orders]
    if not played.unordered:
        return _call("    assert team.commanded == ", rows, "[", "]")
    wanted = _call("    expected = ", rows, "[", "]")
    return [*wanted, "    assert sorted(team.commanded, key=str) == sorted(expected, key=str)"]


def _order(order: Order) -> Bracket:
    slot, command, arguments = order
    return Bracket("(", [literal(slot), literal(command), _dict(arguments)], ")")
