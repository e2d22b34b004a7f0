"""A composition as text: one line for each step, what belongs to a step is indented by two more spaces. Pure.

    robot cup "Takes the cup from here to there."
    slot arm Arm
    parameter from_y = -0.2
    command carry "Do what was shown."
    do
      part take
        arm.go_to x=0.3 y=$from_y z=0.15 twist=0
        arm.grip action=close
        expect arm.get_info.holding is true else "nothing is there"
      repeat 3
        arm.go_to x=0.3 y=$from_y+0.05 z=0.15 twist=0
      repeat 20 until rover.get_info.x above 1
        rover.move x=0.1 y=0
      if arm.get_info.z above 0.1
        wait 1
      else
        arm.grip action=open
      together
        arm.hold
        rover.move x=1 y=0

`$NAME` is a parameter, `$NAME+0.05` the same and a little more; `$$` begins a text that begins with a dollar.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import msgspec

from robotree.tui.composing.steps import (
    LONGEST_TEXT,
    Comparison,
    ComposedBranch,
    ComposedCall,
    ComposedExpectation,
    ComposedPart,
    ComposedRepeat,
    ComposedStep,
    ComposedTogether,
    ComposedWait,
    Composition,
    Relation,
    Value,
    Variable,
)
from robotree.tui.errors import BadComposition, UsageError
from robotree.tui.line import grammar

INDENT: Final = "  "
LARGEST: Final = 100_000
"""[characters] of the text of a composition."""
RELATIONS: Final[tuple[Relation, ...]] = ("is not", "is", "above", "below")
BLOCKS: Final = frozenset({"part", "repeat", "if", "else", "together"})
"""Steps in which there are steps."""


class StepLine(NamedTuple):
    """One step without what is in it, and how deep it lies."""

    depth: int
    text: str


# -- writing ---------------------------------------------------------------------------------------


def written(composition: Composition) -> str:
    """Return a composition as text."""
    head = [f"robot {composition.name} {_quoted(composition.doc)}"]
    head += [f"slot {name} {kind}" for name, kind in composition.slots]
    head += [f"parameter {name} = {_literal(value)}" for name, value in composition.parameters]
    head += [f"command {composition.command} {_quoted(composition.does)}", "do"]
    rows = [f"{INDENT * (1 + line.depth)}{line.text}" for line in step_lines(composition.steps)]
    return "\n".join([*head, *rows]) + "\n"


def step_lines(steps: Iterable[ComposedStep], depth: int = 0) -> list[StepLine]:
    """Return steps as lines, each with what is in it behind it."""
    found: list[StepLine] = []
    for step in steps:
        found.append(StepLine(depth, line_of(step)))
        match step:
            case ComposedBranch(_, then, otherwise):
                found += step_lines(then, depth + 1)
                if otherwise:
                    found += [StepLine(depth, "else"), *step_lines(otherwise, depth + 1)]
            case ComposedPart() | ComposedRepeat() | ComposedTogether():
                found += step_lines(step.steps, depth + 1)
            case _:
                pass
    return found


def line_of(step: ComposedStep) -> str:  # noqa: PLR0911 # one for each step
    """Return one step as a line, without what is in it."""
    match step:
        case ComposedCall(slot, command, arguments):
            given = [f"{name}={literal_of(value)}" for name, value in arguments]
            return " ".join([f"{slot}.{command}", *given])
        case ComposedWait(seconds):
            return f"wait {literal_of(seconds)}"
        case ComposedExpectation(that, otherwise):
            return f"expect {comparison_text(that)} else {_quoted(otherwise)}"
        case ComposedPart(name):
            return f"part {name}"
        case ComposedRepeat(times, _, until):
            return f"repeat {literal_of(times)}" + (f" until {comparison_text(until)}" if until else "")
        case ComposedBranch(that):
            return f"if {comparison_text(that)}"
        case ComposedTogether():
            return "together"


def comparison_text(that: Comparison) -> str:
    """Return a comparison as people write it."""
    return f"{that.path} {that.relation} {literal_of(that.value)}"


def literal_of(value: Any) -> str:
    """Return a value as a line has it."""
    if isinstance(value, Variable):
        return f"${value.name}" + (f"{value.plus:+.6f}".rstrip("0").rstrip(".") if value.plus else "")
    text = _literal(value)
    return f"'$'{text}" if isinstance(value, str) and value.startswith("$") else text


def _literal(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float | int) else _quoted(value)


def _quoted(text: str) -> str:
    """Write a text, all of which can be printed, as one word of a line."""
    return shlex.quote(str(text))


# -- reading ---------------------------------------------------------------------------------------


def read_lines(text: str, name: str = "") -> Composition:
    """Read a composition.

    Args:
        text: as `written` writes it.
        name: of its file, for what is told.

    Raises:
        BadComposition: it cannot be read; with the number of the line.
    """
    if len(text) > LARGEST:
        raise BadComposition(f"{name or 'the text'} has more than {LARGEST} characters: it is no composition")
    reading = _Reading(name)
    for number, row in enumerate(text.splitlines(), 1):
        reading.take(number, row)
    return reading.composition()


def number_of(text: str, step: ComposedStep) -> int:
    """Return the number of the first line at which a step begins in a composition; 0: it is at none."""
    rows = text.splitlines()
    begin = next((number for number, row in enumerate(rows, 1) if row.strip() == "do"), len(rows))
    for number, row in enumerate(rows[begin:], begin + 1):
        read = read_line(row) if row.strip() else None
        if read is not None and line_of(read) == line_of(step):
            return number
    return 0


def read_steps(rows: Sequence[StepLine]) -> tuple[ComposedStep, ...]:
    """Read steps from their lines.

    Raises:
        BadComposition: a line cannot be read, or lies too deep.
    """
    steps, rest = _block(list(rows), 0)
    if rest:
        raise BadComposition(f"`{rest[0].text}` lies deeper than what is above it")
    return steps


def read_line(text: str) -> ComposedStep | None:  # noqa: PLR0911 # one for each step
    """Read one step without what is in it; None: it is `else`, and belongs to the `if` above.

    Raises:
        BadComposition: it cannot be read.
    """
    words = _words(text)
    match words:
        case ["else"]:
            return None
        case ["part", name]:
            return ComposedPart(name)
        case ["repeat", times]:
            return ComposedRepeat(_read_value(times))
        case ["repeat", times, "until", *rest]:
            return ComposedRepeat(_read_value(times), until=_read_comparison(rest, text))
        case ["together"]:
            return ComposedTogether()
        case ["wait", seconds]:
            return ComposedWait(_read_value(seconds))
        case ["if", *rest]:
            return ComposedBranch(_read_comparison(rest, text))
        case ["expect", *rest] if len(rest) >= 3 and rest[-2] == "else":
            return ComposedExpectation(_read_comparison(rest[:-2], text), rest[-1])
        case [path, *given] if "." in path and path.split(" ")[0] == path:
            return _read_call(path, given, text)
        case _:
            raise BadComposition(
                f"`{text.strip()[:LONGEST_TEXT]}` is no step; a step is SLOT.COMMAND NAME=VALUE …, part NAME,"
                " repeat N, repeat N until SLOT.COMMAND.VALUE is VALUE, if SLOT.COMMAND.VALUE is VALUE, else,"
                ' together, wait SECONDS, or expect … else "TEXT"'
            )


def _words(text: str) -> list[str]:
    try:
        return list(grammar.split(text))
    except UsageError as error:
        raise BadComposition(str(error)) from None


def _read_call(path: str, given: Sequence[str], text: str) -> ComposedCall:
    slot, _, command = path.partition(".")
    arguments: list[tuple[str, Value]] = []
    for word in given:
        name, equals, value = word.partition("=")
        if not (name and equals):
            raise BadComposition(f"`{text.strip()[:LONGEST_TEXT]}`: {word[:40]!r} is no NAME=VALUE")
        arguments.append((name, _read_value(value)))
    return ComposedCall(slot, command, tuple(arguments))


def _read_comparison(words: Sequence[str], text: str) -> Comparison:
    match words:
        case [path, "is", "not", value]:
            relation: Relation = "is not"
        case [path, "is" | "above" | "below" as relation, value]:
            pass
        case _:
            path = value = ""
            relation = "is"
    parts = path.split(".")
    if len(parts) not in {2, 3} or not all(parts):
        raise BadComposition(
            f"`{text.strip()[:LONGEST_TEXT]}`: a comparison is SLOT.COMMAND.VALUE is, is not, above or below"
            " VALUE"
        )
    slot, command, *field = parts
    return Comparison(slot, command, field[0] if field else "", relation, _read_value(value))


def _read_value(word: str) -> Value:
    if word.startswith("$$"):
        return word[1:]
    if not word.startswith("$"):
        return word
    for sign in "+-":
        name, found, plus = word[1:].partition(sign)
        if found:
            try:
                return Variable(name, float(f"{sign}{plus}"))
            except ValueError:
                raise BadComposition(f"{word[:40]!r}: what is added to a parameter is a number") from None
    return Variable(word[1:])


def _block(rows: list[StepLine], depth: int) -> tuple[tuple[ComposedStep, ...], list[StepLine]]:
    """Read the steps that lie so deep; return them, and the lines behind them."""
    steps: list[ComposedStep] = []
    while rows and rows[0].depth == depth:
        row, rows = rows[0], rows[1:]
        step = read_line(row.text)
        if step is None:
            raise BadComposition("`else` stands alone; it belongs right behind the steps of an `if`")
        if row.text.split(" ")[0] in BLOCKS and "." not in row.text.split(" ")[0]:
            inside, rows = _block(rows, depth + 1)
            if isinstance(step, ComposedBranch):
                otherwise: tuple[ComposedStep, ...] = ()
                if rows and rows[0].depth == depth and _words(rows[0].text) == ["else"]:
                    otherwise, rows = _block(rows[1:], depth + 1)
                step = ComposedBranch(step.that, inside, otherwise)
            elif isinstance(step, ComposedPart | ComposedRepeat | ComposedTogether):
                step = msgspec.structs.replace(step, steps=inside)
        steps.append(step)
    return tuple(steps), rows


class _Reading:
    """Takes the lines of a text, one after the other."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._about: dict[str, str] = {}
        self._slots: list[tuple[str, str]] = []
        self._parameters: list[tuple[str, Any]] = []
        self._rows: list[StepLine] = []
        self._steps = False

    def take(self, number: int, row: str) -> None:
        try:
            words = _words(row)
            if not words:
                return
            if self._steps:
                self._rows.append(self._row(row))
                read_line(row)
            else:
                self._head(words, row)
        except BadComposition as error:
            where = f"{self._name}, line {number}" if self._name else f"line {number}"
            raise BadComposition(f"{where}: {error}") from None

    def _row(self, row: str) -> StepLine:
        text = row.strip()
        spaces = len(row) - len(row.lstrip())
        if row[:spaces].strip(" ") or spaces % len(INDENT) or not spaces:
            raise BadComposition("a step is indented by two spaces, and by two more for each that it is in")
        return StepLine(spaces // len(INDENT) - 1, text)

    def _head(self, words: Sequence[str], row: str) -> None:
        match words:
            case ["robot" | "command" as what, name, *doc] if len(doc) <= 1:
                self._about |= {what: name, f"{what} doc": doc[0] if doc else ""}
            case ["slot", name, kind]:
                self._slots.append((name, kind))
            case ["parameter", name, "=", value]:
                self._parameters.append((name, value))
            case ["do"]:
                self._steps = True
            case _:
                raise BadComposition(
                    f"`{row.strip()[:LONGEST_TEXT]}` cannot stand here; before `do` stand robot NAME TEXT,"
                    " slot NAME KIND, parameter NAME = VALUE and command NAME TEXT"
                )

    def composition(self) -> Composition:
        if "robot" not in self._about:
            where = f"{self._name}: " if self._name else ""
            raise BadComposition(f"{where}the first line says `robot NAME`; it is no composition without")
        plain = Composition(self._about["robot"])
        return Composition(
            self._about["robot"],
            tuple(self._slots),
            read_steps(self._rows),
            tuple(self._parameters),
            self._about.get("command", plain.command),
            self._about["robot doc"] or plain.doc,
            self._about.get("command doc") or plain.does,
        )
