"""The texts in the fields of a form, and their values. Pure.

A form is made from a command's types; the same reader judges it that the robot itself uses
(`robotree.vr.base.arguments`), so nothing that the form lets through is refused for its form later.

Angles are in degrees, as everywhere on the screen: `45` in a field for an angle is 45°, also where a command
declares radians. The command line that does the same says `45deg`.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

from rich.cells import cell_len

from robotree.tui.seen import wording
from robotree.tui.terminal import one_line
from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import CommandSpec, FieldSpec
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.readable import as_shown, in_radians, is_angle, number, with_units

SEPARATOR = " · "
"""Between the parts of a hint."""
ANGLE = 2
"""Decimals of a present angle [°]: a fifth of a millirad."""
DIGITS = 4
"""Significant digits of a present value that is put into a field: tenths of millimetres for an arm."""


@dataclass(frozen=True, slots=True)
class Entry:
    """A form, read: arguments for the command, and what is wrong beside which field."""

    arguments: Mapping[str, Any]
    complaints: Mapping[str, str]


def first_text(field: FieldSpec, readings: Mapping[str, float]) -> str:
    """Return what stands in a field when its form opens.

    The default, if it has one; else the present value, if the robot reads one of that name, so that a
    form which is sent as it stands moves nothing; else nothing.
    """
    shown = as_shown(field)
    if not field.required and field.default is not None:
        return wording.typed(shown.default)
    if field.type in {"float", "int"} and field.name in readings:
        return _present(field, readings)
    if field.type == "bool":
        return "no"
    return ""


def follows(field: FieldSpec, readings: Mapping[str, float]) -> bool:
    """Whether a field that nobody touched shows what the robot reads now, as long as its form is open."""
    return first_text(field, readings) != first_text(field, {})


def _present(field: FieldSpec, readings: Mapping[str, float]) -> str:
    value = readings[field.name]
    if is_angle(field):
        return wording.typed(round(degrees(value), ANGLE) + 0.0).removesuffix(".0")
    return number(value, DIGITS)


def command_line(robot: str, spec: CommandSpec, texts: Mapping[str, str], *, realm: str = "") -> str:
    """Return the line for a shell that does the same as a form.

    Args:
        robot: its name.
        spec: the command.
        texts: what stands in the fields, by name; empty fields are left out.
        realm: named in the line, unless it is empty.
    """
    words = ["robotree", *(["--realm", realm] if realm else []), "call", f"{robot}.{spec.name}"]
    given = [(field.name, with_units(field, texts.get(field.name, ""))) for field in spec.parameters]
    return shlex.join([*words, *(f"{name}={one_line(text)}" for name, text in given if text)])


def complaint(field: FieldSpec, text: str) -> str:
    """Return why a field would be refused, or nothing."""
    field = as_shown(field)
    if not text.strip() and field.type != "str":
        return f"needs {wording.wanted(field)}" if field.required else ""
    try:
        check_argument(field, text, command="")
    except BadArgument as error:
        reason, part = str(error.data["reason"]), str(error.data["parameter"]).removeprefix(field.name)
        return f"{part.removeprefix('.')}: {reason}" if part else reason
    return ""


def read(spec: CommandSpec, texts: Mapping[str, str]) -> Entry:
    """Read a whole form.

    Args:
        spec: the command.
        texts: what stands in the fields, by name. Empty fields that may be left out are left out.

    Returns:
        The arguments, and the complaints; it can be sent when there are none.
    """
    arguments: dict[str, Any] = {}
    complaints: dict[str, str] = {}
    for field in spec.parameters:
        text = texts.get(field.name, "")
        if wrong := complaint(field, text):
            complaints[field.name] = wrong
        elif text.strip() or (field.type == "str" and field.required):
            value = check_argument(as_shown(field), text, command=spec.name)
            arguments[field.name] = in_radians(field, value)
    return Entry(arguments, complaints)


def fitting(parts: Sequence[str], width: int) -> str:
    """Return the first parts of a hint, as many as fit into `width` cells whole; the first in any case."""
    whole = max(len(parts), 1)
    while whole > 1 and cell_len(SEPARATOR.join(parts[:whole])) > width:
        whole -= 1
    return SEPARATOR.join(parts[:whole])


def hints(field: FieldSpec, readings: Mapping[str, float]) -> list[str]:
    """Return the parts of a hint: unit and range, whether it may stay empty, the value now."""
    shown = as_shown(field)
    parts = [wording.span(shown)]
    if not field.required:
        parts.append("may stay empty" if shown.default is None else f"default {wording.value(shown.default)}")
    if field.name in readings:
        parts.append(f"now {_present(field, readings)}")
    return [part for part in parts if part]
