"""The steps that can be chosen: a line for each command of a robot, with values that it could take. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from robotree.tui.composing.lines import line_of, literal_of, read_line
from robotree.tui.composing.steps import (
    ComposedCall,
    ComposedRepeat,
    ComposedStep,
    ComposedWait,
    Value,
    Variable,
)
from robotree.tui.errors import BadComposition
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription
from robotree.vr.base.readable import typed


class Offer(NamedTuple):
    """One step that can be chosen."""

    shown: str
    """As the list names it: with the name of the robot."""
    about: str
    line: str
    """With `SLOT` in place of the slot."""

    def text(self, slot: str) -> str:
        """Return the line of the step, with the slot of its robot."""
        return self.line.replace("SLOT", slot, 1)


def of_robot(robot: RobotDescription, readings: Mapping[str, float]) -> Iterator[Offer]:
    """Yield a step for each command of a robot that does something.

    Args:
        robot: which.
        readings: of now: an argument of the same name begins with it.
    """
    for spec in robot.commands:
        if spec.effect != "read" and not spec.beside and spec.available:
            given = [
                f"{field.name}={_example(field, readings)}" for field in spec.parameters if field.required
            ]
            about = spec.doc.partition("\n")[0]
            yield Offer(f"{robot.name}.{spec.name}", about, " ".join([f"SLOT.{spec.name}", *given]))


def asked_of(robot: RobotDescription) -> Iterator[Offer]:
    """Yield the steps that depend on what a robot tells."""
    for spec in robot.commands:
        if spec.effect == "read" and not any(field.required for field in spec.parameters):
            yield from _comparisons(robot.name, spec)


def _comparisons(robot: str, spec: CommandSpec) -> Iterator[Offer]:
    for part in spec.result:
        path = ".".join(filter(None, (spec.name, part.name)))
        about = part.doc or "depends on what it reads"
        match part.type:
            case "bool":
                why = "expect that it is so, or fail"
                yield Offer(f"expect {robot}.{path}", why, f"expect SLOT.{path} is true else 'it is not so'")
                so = "is true"
            case "float" | "int":
                so = "above 0"
            case "str" | "choice":
                so = f"is {literal_of(part.choices[0] if part.choices else 'text')}"
            case _:
                continue
        yield Offer(f"if {robot}.{path}", about, f"if SLOT.{path} {so}")
        until = "what is in it, until it reads so; fails when it never does"
        yield Offer(f"repeat until {robot}.{path}", until, f"repeat 20 until SLOT.{path} {so}")


def of_blocks() -> Iterator[Offer]:
    """Yield the steps that need no robot."""
    yield Offer("repeat", "what is in it, several times", "repeat 2")
    yield Offer("together", "what is in it, at the same time", "together")
    yield Offer("part", "what is in it, under a name", "part NAME")
    yield Offer("else", "behind the steps of an `if`: what happens otherwise", "else")
    yield Offer("wait", "some seconds", "wait 1")


def _example(field: FieldSpec, readings: Mapping[str, float]) -> str:
    """Return a value that a parameter could take, as a line has it."""
    low = field.lower if field.lower is not None else 0.0
    high = field.upper if field.upper is not None else max(low, 1.0)
    value: Any
    match field.type:
        case "choice":
            value = field.choices[0]
        case "bool":
            value = False
        case "int":
            value = int(min(max(1, low), high))
        case "float":
            value = typed(field, round(min(max(readings.get(field.name, 0.0), low), high), 4) + 0.0)
        case _:
            value = "text"
    return literal_of(value)


def values_in(line: str) -> dict[str, str]:
    """Return the values of a step that are no parameters yet, by their names."""
    try:
        step = read_line(line)
    except BadComposition:
        return {}
    return {name: str(value) for name, value in _values(step) if not isinstance(value, Variable)}


def _values(step: ComposedStep | None) -> list[tuple[str, Value]]:
    match step:
        case ComposedCall():
            return list(step.arguments)
        case ComposedRepeat(times):
            return [("times", times)]
        case ComposedWait(seconds):
            return [("seconds", seconds)]
        case _:
            return []


def with_parameter(line: str, argument: str, name: str) -> str:
    """Return a step in which a value is the parameter of this name.

    Raises:
        BadComposition: the line is no step.
    """
    step = read_line(line)
    match step:
        case ComposedCall(slot, command, arguments):
            values = ((key, Variable(name) if key == argument else value) for key, value in arguments)
            return line_of(ComposedCall(slot, command, tuple(values)))
        case ComposedRepeat(_, _, until):
            return line_of(ComposedRepeat(Variable(name), until=until))
        case ComposedWait():
            return line_of(ComposedWait(Variable(name)))
        case _:
            return line
