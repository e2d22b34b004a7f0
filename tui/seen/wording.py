"""How agents read as text: one wording for the command line, the widgets and the session's report.

Pure; plain text without markup or colour.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

from robotree.tui.seen import status
from robotree.vr.base.readable import as_shown, in_degrees, number

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import (
        CommandSpec,
        FieldSpec,
        HostLoad,
        RobotDescription,
        SlotSpec,
        StreamSpec,
    )
    from robotree.vr.base.requests import LoggedLine


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Lay out rows so that their columns align; the last column is left ragged."""
    if not rows:
        return ""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    return "\n".join(
        "  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]).rstrip()
        for row in rows
    )


def span(spec: FieldSpec) -> str:
    """Return the range of a value in its unit: `-0.7 … 0.7 m`, `≥ 0 m/s`, the unit, or the form of a list."""
    if spec.nested:
        return form(spec)
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
    if isinstance(thing, str):
        return thing
    from robotree.vr.base.literal import write  # help must not wait for the agents

    return write(thing)


def wanted(spec: FieldSpec) -> str:
    """Return what a field takes: `a number in m`, `one of open, close`."""
    from robotree.vr.base.arguments import expected

    return expected(spec)


def parameter(spec: FieldSpec) -> str:
    """Return one parameter as in a signature: `x: m`, `action: open|close`, `speed: m/s = 0.1`."""
    default = "" if spec.required else f" = {value(spec.default)}"
    return f"{spec.name}: {form(spec)}{default}"


def form(spec: FieldSpec) -> str:
    """Return how a value is written: `m`, `open|close`, `[m, …]`, `{x: m}`; `m?` may be none."""
    match spec.type:
        case "list":
            text = f"[{form(spec.items[0])}, …]"
        case "tuple":
            text = f"({', '.join(map(form, spec.items))})"
        case "dict":
            text = f"{{name: {form(spec.items[0])}, …}}"
        case "record":
            text = f"{{{', '.join(f'{part.name}: {form(part)}' for part in spec.items)}}}"
        case _:
            text = "|".join(spec.choices) if spec.choices else (spec.unit or spec.type)
    return f"{text}?" if spec.nullable else text


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
            return ", ".join(_within(part) for part in cast("Sequence[Any]", thing))
        case _:
            return _size(thing) if isinstance(thing, bytes) else str(thing)


def _size(picture: bytes) -> str:
    kind = "JPEG, " if picture.startswith(_JPEG) else ""
    return f"{kind}{len(picture) / 1000:.1f} kB"


_JPEG = b"\xff\xd8\xff"


def _within(thing: Any) -> str:
    """Write a value that lies in a list: another list or a record keeps its brackets."""
    match thing:
        case Mapping():
            return f"{{{value(thing)}}}"
        case list() | tuple():
            return f"[{value(thing)}]"
        case _:
            return value(thing)


def measured(spec: FieldSpec | None, thing: Any) -> str:
    """Write a value with the units that its description knows."""
    if spec is None or thing is None:
        return value(thing)
    if isinstance(thing, Mapping):
        named = cast("dict[str, Any]", thing).items()
        return ", ".join(f"{name} {measured(_part(spec, name), part)}" for name, part in named)
    if spec.type == "tuple" and isinstance(thing, list):
        pairs = zip(spec.items, cast("Sequence[Any]", thing), strict=False)
        return ", ".join(measured(part, one) for part, one in pairs)
    unit = spec.items[0].unit if spec.type == "list" else spec.unit
    return f"{value(thing)} {unit}".rstrip()


def given(spec: FieldSpec | None, thing: Any) -> str:
    """Write an argument, also one that came as text, `30 cm`, in its declared unit, angles in degrees."""
    from robotree.vr.base.arguments import check_argument  # help must not wait for the agents
    from robotree.vr.base.errors import BadArgument

    if spec is None:
        return value(thing)
    try:
        return measured(as_shown(spec), in_degrees(spec, check_argument(spec, thing, command="")))
    except BadArgument:  # the command has changed since
        return value(thing)


def _part(spec: FieldSpec, name: str) -> FieldSpec | None:
    """Return the description of a value by name in a record or a dictionary."""
    if spec.type == "dict":
        return spec.items[0]
    return next((part for part in spec.items if part.name == name), None)


def result(fields: Sequence[FieldSpec], thing: Any) -> list[tuple[str, str]]:
    """Return a result as rows of name and text with unit, angles in degrees; empty when there is none."""
    if thing is None:
        return []
    known = {part.name: part for part in fields}
    rows: list[tuple[str, str]] = []
    parts = cast("dict[str, Any]", thing) if isinstance(thing, Mapping) else {"": thing}
    each_part = known[""].items[0] if "" in known and known[""].type == "dict" else None
    for name, part in parts.items():
        unit = each_part or known.get(name)
        shown = as_shown(unit) if unit else None
        value = in_degrees(unit, part) if unit else part
        if shown and shown.type == "list" and shown.items[0].nested and isinstance(value, list):
            each = enumerate(cast("Sequence[Any]", value))
            rows += [(f"{name}[{index}]", measured(shown.items[0], one)) for index, one in each]
        else:
            rows.append((str(name), measured(shown, value)))
    return rows


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


APART = {
    "process": "in a process of its own, with limits of the kernel",
    "sandbox": "in a sandbox: a process of its own, which sees no files of people",
}
"""The levels of isolation, for people."""


def portrait(robot: RobotDescription, absence: str = "") -> str:
    """Describe one robot in full.

    Args:
        robot: as it describes itself.
        absence: how it is absent; its stop may have been resumed since then.
    """
    facts = [
        ("name", robot.name),
        ("kinds", " < ".join(robot.kinds)),
        ("about", summary(robot.doc)),
        ("host", robot.host),
        ("placement", "" if robot.placement == "manual" else robot.placement),
        ("placed", robot.placed),
        ("advice", robot.advice),
        ("isolated", APART.get(robot.isolation, "")),
        ("state", absence or status.text(robot)),
        ("was stopped" if absence else "stopped", robot.stop_reason),
        ("paused", robot.paused and f"by {robot.paused}"),
        ("drill", robot.drill),
        ("abandoned", _abandoned(robot)),
        *(("hook", fault) for fault in robot.faults),
        ("link", _link(robot)),
        ("parent", f"{robot.bond.parent.name}.{robot.bond.slot}" if robot.bond else ""),
        *((f"@{key}", text) for key, text in sorted(robot.attributes.items()) if key != "link"),
    ]
    blocks = [columns([fact for fact in facts if fact[1]])]
    if robot.slots:
        rows = [
            (f"  {slot.name}", slot.kind, inhabitant(slot) or slot.lost or vacant(slot), bond(slot))
            for slot in robot.slots
        ]
        chosen = [f"  {slot.name} was chosen: {slot.why}" for slot in robot.slots if slot.why]
        far = [f"  {slot.name}: {delay(slot)}" for slot in robot.slots if slot.way]
        blocks.append("\n".join(["slots", columns(rows), *chosen, *far]))
    if robot.streams:
        blocks.append("streams\n" + columns([stream_row(stream) for stream in robot.streams]))
    if settings(robot):
        blocks.append("settings\n" + columns([(f"  {row[0]}", *row[1:]) for row in setting_rows(robot)]))
    if robot.kept:
        blocks.append("state\n" + columns([(f"  {name}", value(one)) for name, one in robot.kept.items()]))
    commands = [
        (
            f"  {signature(command)}",
            _calls(robot, command.name),
            summary(command.doc) if command.available else f"needs {command.through.partition('.')[0]}",
        )
        for command in robot.commands
    ]
    if commands:
        blocks.append("commands\n" + columns(commands))
    return "\n\n".join(blocks)


def load(of: HostLoad | None) -> str:
    """Say what a host has to do; `-`: it does not say."""
    if of is None:
        return "-"
    room = "" if of.room is None else f", room for {of.room}"
    return f"{of.running} running, {of.cpu:.0%} of a processor{room}"


def ways(found: Mapping[str, float]) -> str:
    """Say how far other hosts are: `host-2 0.4 ms`."""
    return ", ".join(f"{name} {way(seconds)}" for name, seconds in found.items()) or "-"


def way(seconds: float) -> str:
    """Write a round trip: `0.4 ms`, `150 ms`."""
    from robotree.vr.core.placement import milliseconds

    return milliseconds(seconds)


def bond(slot: SlotSpec) -> str:
    """Say how far a child is, and what goes to and fro; empty: nothing is known."""
    if slot.child is None or not slot.round_trip:
        return ""
    size = f", {slot.bytes / 1000:.1f} kB/s" if slot.bytes else ""
    return f"{way(slot.round_trip)} there and back, {slot.calls:.1f} calls/s{size}"


def inhabitant(slot: SlotSpec) -> str:
    """Return the name of who is in a slot; of one that is only watched it says so; empty: nobody is."""
    if slot.watched:
        return f"{slot.watched.name}, watched"
    return slot.child.name if slot.child else ""


def delay(slot: SlotSpec) -> str:
    """Say how far away the child of a slot is, and what delay its lease bears."""
    name = slot.child.name if slot.child else ""
    return f"{slot.way:.1f} s to {name} and back; its lease bears {slot.bears:.1f} s more, or a cut as long"


def stream_row(stream: StreamSpec) -> tuple[str, str, str, str]:
    """Return name and type, rate, what is sent now, and what a stream is."""
    rate = f"up to {stream.rate:g}/s" if stream.rate else "each value"
    return (
        f"  {parameter(stream.value)}",
        rate,
        traffic(stream) or "nobody listens",
        summary(stream.value.doc),
    )


def traffic(stream: StreamSpec) -> str:
    """Return how much a stream sends, and to how many processes; empty: nobody listens."""
    if not stream.listeners:
        return ""
    return f"{stream.sent / 1000:.1f} kB/s to {stream.listeners}"


def vacant(slot: SlotSpec) -> str:
    """Say that a slot is empty, and whether that matters."""
    if slot.choose:
        return f"empty: chosen when one is free{f' where {slot.where}' if slot.where else ''}"
    return "empty, optional" if slot.optional else "empty"


def log_line(line: LoggedLine, robot: str = "") -> str:
    """Return one line of a log: when, how important, of which robot unless that is clear, what."""
    clock = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(line.unix))
    named = re.search(rf"(?<![\w-]){re.escape(robot)}(?![\w-])", line.text)
    who = f"{robot}: " if robot and not named else ""
    return f"{clock}  {line.level:9}  {who}{line.text}"


def is_waiting(text: str) -> bool:
    """Whether a progress text says that the command waits for its turn."""
    return text.startswith("waits: ")


def without_seconds(text: str) -> str:
    """Return a progress text without the time that the command has waited: that is news each second."""
    return text.rpartition(", ")[0] if is_waiting(text) and text.endswith(" s") else text


def settings(robot: RobotDescription) -> tuple[FieldSpec, ...]:
    """Return the settings of a robot; the default of each is its present value."""
    spec = robot.command("set")
    return spec.parameters if spec is not None and spec.beside and not spec.through else ()


def setting_rows(robot: RobotDescription) -> list[tuple[str, str, str, str]]:
    """Return the settings as rows: name, present value with its unit (of angles: °), range, documentation."""
    return [
        (one.name, f"{value(one.default)} {one.unit}".rstrip(), span(one), summary(one.doc))
        for one in map(as_shown, settings(robot))
    ]


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
    return f"called {count}x" if count else ""
