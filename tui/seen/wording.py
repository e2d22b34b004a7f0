"""How agents read as text: one wording for the command line, the widgets and the session's report.

Pure; plain text without markup or colour.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from robotree.tui.seen import status

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.description import CommandSpec, FieldSpec, RobotDescription, SlotSpec


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Lay out rows so that their columns align; the last column is left ragged."""
    if not rows:
        return ""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    return "\n".join(
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    )


NOISE = 1e-6
"""Size below which a number is written as zero: no robot measures that."""


def number(value: float, digits: int = 4) -> str:
    """Write a number as short as its digits allow."""
    if abs(value) < NOISE:
        return "0"
    text = f"{value:.{digits}g}"
    return "0" if text == "-0" else text


def quantity(value: float, unit: str, digits: int = 4) -> str:
    """Write a number with its unit, if it has one."""
    return f"{number(value, digits)} {unit}".rstrip()


def span(spec: FieldSpec) -> str:
    """Return the range of a value in its unit: `-0.7 … 0.7 m`, `≥ 0 m/s`, or only the unit."""
    match spec.lower, spec.upper:
        case None, None:
            return spec.unit
        case lower, None:
            text = f"≥ {number(float(lower or 0))}"
        case None, upper:
            text = f"≤ {number(float(upper or 0))}"
        case lower, upper:
            text = f"{number(float(lower or 0))} … {number(float(upper or 0))}"
    return f"{text} {spec.unit}".rstrip()


def typed(thing: object) -> str:
    """Write a value as a person would type it: so that it is read back as it was."""
    if isinstance(thing, bool):
        return "yes" if thing else "no"
    return repr(thing) if isinstance(thing, float) else str(thing)


def wanted(spec: FieldSpec) -> str:
    """Return what a field takes: `a number in m`, `one of open, close`."""
    from robotree.vr.arguments import expected

    return expected(spec)


def parameter(spec: FieldSpec) -> str:
    """Return one parameter as in a signature: `x: m`, `action: open|close`, `speed: m/s = 0.1`."""
    kind = "|".join(spec.choices) if spec.choices else (spec.unit or spec.type)
    default = "" if spec.required else f" = {value(spec.default)}"
    return f"{spec.name}: {kind}{default}"


def signature(command: CommandSpec) -> str:
    """Return `go_to(x: m, y: m, speed: m/s = 0.1)`."""
    return f"{command.name}({', '.join(parameter(spec) for spec in command.parameters)})"


def value(thing: Any) -> str:
    """Write a result or an argument for people."""
    match thing:
        case None:
            return "-"
        case bool():
            return "yes" if thing else "no"
        case float():
            return number(thing)
        case Mapping():
            return ", ".join(f"{key} {value(part)}" for key, part in cast("dict[str, Any]", thing).items())
        case list() | tuple():
            return ", ".join(value(part) for part in cast("list[Any]", thing))
        case _:
            return str(thing)


def result(spec: CommandSpec | None, thing: Any) -> list[tuple[str, str]]:
    """Return a result as rows of name and text with unit; empty when there is none."""
    if thing is None:
        return []
    units = {part.name: part.unit for part in spec.result} if spec else {}
    parts = cast("dict[str, Any]", thing) if isinstance(thing, Mapping) else {"": thing}
    return [(str(name), f"{value(part)} {units.get(name, '')}".rstrip()) for name, part in parts.items()]


_ORIGINS = {"yes": "sim", "no": "real"}
"""Words for what a controller says that it moves, by its attribute `simulated`."""


def kind(words: str, attributes: Mapping[str, str]) -> str:
    """Return a kind, and what its controller says that it moves: `Arm (sim)`, `Arm (real)`."""
    origin = _ORIGINS.get(attributes.get("simulated", ""))
    return f"{words} ({origin})" if origin else words


def inserted(words: str, attributes: Mapping[str, str]) -> str:
    """Return the same as it stands in a sentence, in parentheses: `(Arm, sim)`."""
    origin = _ORIGINS.get(attributes.get("simulated", ""))
    return f"({words}, {origin})" if origin else f"({words})"


def summary(doc: str) -> str:
    """Return the first sentence-line of a documentation."""
    return doc.strip().partition("\n")[0]


def portrait(robot: RobotDescription) -> str:
    """Describe one robot in full."""
    facts = [
        ("name", robot.name),
        ("kinds", " < ".join(robot.kinds)),
        ("about", summary(robot.doc)),
        ("host", robot.host),
        ("state", status.text(robot)),
        ("stopped", robot.stop_reason),
        ("abandoned", _abandoned(robot)),
        ("link", _link(robot)),
        ("parent", f"{robot.bond.parent.name}.{robot.bond.slot}" if robot.bond else ""),
        *((f"@{key}", text) for key, text in sorted(robot.attributes.items()) if key != "link"),
    ]
    blocks = [columns([fact for fact in facts if fact[1]])]
    if robot.slots:
        rows = [
            (f"  {one.name}", one.kind, one.child.name if one.child else one.lost or vacant(one))
            for one in robot.slots
        ]
        blocks.append("slots\n" + columns(rows))
    commands = [
        (
            f"  {signature(one)}",
            _calls(robot, one.name),
            summary(one.doc) if one.available else f"needs {one.through.partition('.')[0]}",
        )
        for one in robot.commands
    ]
    if commands:
        blocks.append("commands\n" + columns(commands))
    return "\n\n".join(blocks)


def vacant(slot: SlotSpec) -> str:
    """Say that a slot is empty, and whether that matters."""
    return "empty, optional" if slot.optional else "empty"


def _abandoned(robot: RobotDescription) -> str:
    """Say which code ignores every cancel, and what ends it."""
    if not robot.abandoned:
        return ""
    home = f"host {robot.host}" if robot.host else "its process"
    return f"{', '.join(robot.abandoned)} ignores every cancel and still runs; restart {home}"


def _link(robot: RobotDescription) -> str:
    """Say how the link to its controller is guarded."""
    if robot.unguarded:
        return "open: every program that reaches its controller can command it; start both with --key"
    return robot.link


def _calls(robot: RobotDescription, command: str) -> str:
    count = robot.calls.get(command, 0)
    return f"{count}x" if count else ""
