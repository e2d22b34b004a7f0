"""Angles as people read and type them: in degrees, also inside lists and records. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import degrees, inf, radians
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec, FieldSpec

IN_DEGREES: Mapping[str, str] = {"rad": "°", "rad/s": "°/s"}
"""By declared unit: the unit of the screen."""

ROUNDING = 9
"""Decimals [°] that are kept: the digits behind them come from the conversion."""


def is_angle(field: FieldSpec) -> bool:
    """Whether a field is an angle, or a speed of turning."""
    return field.type == "float" and field.unit in IN_DEGREES


def as_shown(field: FieldSpec) -> FieldSpec:
    """Return a field as the screen has it: units, bounds and default of all angles in it in degrees."""
    import msgspec

    if not _turns(field):
        return field
    lower, upper = field.lower, field.upper
    if is_angle(field):
        lower, upper = (None if bound is None else degrees(bound) for bound in (lower, upper))
    return msgspec.structs.replace(
        field,
        unit=IN_DEGREES[field.unit] if is_angle(field) else field.unit,
        lower=lower,
        upper=upper,
        default=in_degrees(field, field.default),
        items=tuple(map(as_shown, field.items)),
    )


def _turns(field: FieldSpec) -> bool:
    return is_angle(field) or any(map(_turns, field.items))


def command_as_shown(command: CommandSpec) -> CommandSpec:
    """Return a command with its parameters as the screen has them."""
    import msgspec

    return msgspec.structs.replace(command, parameters=tuple(map(as_shown, command.parameters)))


def in_degrees(field: FieldSpec, value: Any) -> Any:
    """Return a value of a command, its angles in degrees.

    Args:
        field: as the robot declares it.
        value: in the declared units.
    """
    return _each(field, value, lambda _, angle: round(degrees(angle), ROUNDING))


def typed(field: FieldSpec, value: Any) -> Any:
    """Return an angle as people type it, `45deg`, to a tenth; what is none, or lies at a bound, as it is."""
    if not is_angle(field) or not isinstance(value, int | float):
        return value
    shown = round(degrees(value), 1) + 0.0  # no -0.0
    lower, upper = (
        infinite if end is None else end for end, infinite in ((field.lower, -inf), (field.upper, inf))
    )
    return with_unit(f"{shown:g}", field.unit) if lower <= radians(shown) <= upper else value


def in_radians(field: FieldSpec, value: Any) -> Any:
    """Return what `in_degrees` was made from, but for rounding."""
    return _each(field, value, lambda _, angle: radians(angle))


def with_units(field: FieldSpec, text: str) -> str:
    """Write `deg` behind each angle without a unit: the command line takes plain numbers in the declared one.

    Args:
        field: as the robot declares it.
        text: as it was typed into a form, in degrees. What cannot be read stays as it is.
    """
    from robotree.vr.base.literal import read_list, read_record, write

    if not field.nested:
        return str(_each(field, text, _with_unit))
    try:
        value = read_record(text) if field.type == "record" else read_list(text)
    except ValueError:
        return text
    found = _each(field, value, _with_unit)
    return text if found == value else write(found)


def with_unit(text: str, unit: str) -> str:
    """Write `deg` behind an angle that was typed in degrees, without a unit; `unit`: the declared one."""
    try:
        float(text)
    except ValueError:
        return text
    return text.strip() + IN_DEGREES[unit].replace("°", "deg") if unit in IN_DEGREES else text


def _with_unit(field: FieldSpec, text: str) -> str:
    return with_unit(text, field.unit)


def _each(field: FieldSpec, value: Any, turned: Callable[[FieldSpec, Any], Any]) -> Any:
    """Return a value of this form, each angle in it replaced; what has another form stays as it is."""
    if is_angle(field) and isinstance(value, int | float | str):
        return turned(field, value)
    if field.type == "record" and isinstance(value, Mapping):
        parts = {part.name: part for part in field.items}
        named = cast("Mapping[str, Any]", value).items()
        return {name: _each(parts[name], part, turned) if name in parts else part for name, part in named}
    if field.type == "dict" and isinstance(value, Mapping):
        named = cast("Mapping[str, Any]", value).items()
        return {name: _each(field.items[0], part, turned) for name, part in named}
    if field.type in {"list", "tuple"} and isinstance(value, list | tuple):
        values = cast("Sequence[Any]", value)
        items = field.items * len(values) if field.type == "list" else field.items
        return [_each(item, part, turned) for item, part in zip(items, values, strict=False)]
    return value
