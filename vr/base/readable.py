"""How a value with its unit is written for people: on the screen, in logs and by verbs. Pure.

Angles are read and typed in degrees, also inside lists and records. A number has four digits (`quantity`); a
reading that changes on the screen has the decimals of its unit, so that it stands still (`figure`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import degrees, inf, radians
from typing import TYPE_CHECKING, Any, cast

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec, FieldSpec

IN_DEGREES: Mapping[str, str] = {"rad": "°", "rad/s": "°/s"}
"""By declared unit: the unit that people read."""

NOISE = 1e-6
"""Size below which a number is written as zero: no robot measures that."""

DIGITS = 4
"""Of a number: enough to know it."""

ENTERED = 9
"""Digits of a number that a person has entered: none of them is lost, and those of a conversion are."""

DECIMALS: Mapping[str, int] = {
    "m": 3, "mm": 0, "m/s": 2, "rad": 1, "°": 1, "rad/s": 1, "N": 1, "N m": 2, "s": 1, "V": 1, "A": 2, "%": 0,
    "count": 0,
}  # fmt: skip
"""Digits behind the point, by unit: what an arm can distinguish, and no more. Another unit has `OTHER`."""

OTHER = 3
MOST_DECIMALS = 17
LARGE = 1e6
"""From which on a number is written with its power of ten: no robot measures that."""

ROUNDING = 9
"""Decimals [°] that are kept: the digits behind them come from the conversion."""


def number(value: float, digits: int = DIGITS) -> str:
    """Write a number as short as its digits allow."""
    return "0" if abs(value) < NOISE else f"{value:.{digits}g}"


def quantity(value: float, unit: str, digits: int = DIGITS) -> str:
    """Write a number in `unit`, with its unit if it has one; an angle in degrees."""
    value, shown = converted(value, unit)
    return f"{number(value, digits)} {shown}".rstrip()


def entered(value: float, unit: str) -> str:
    """Write a number in `unit` that a person has entered: with its unit, and as it was entered."""
    return quantity(value, "" if unit == "count" else unit, ENTERED)


def converted(value: float, unit: str) -> tuple[float, str]:
    """Return a number in `unit` in the unit that people read, and that."""
    return (degrees(value), IN_DEGREES[unit]) if unit in IN_DEGREES else (value, unit)


def figure(value: float, unit: str) -> tuple[str, str]:
    """Write a number with the decimals of its unit.

    Args:
        value: in `unit`.
        unit: as the robot says it.

    Returns:
        The number and its unit as shown: angles in degrees, counts without a unit. What rounds to zero has
        no sign.
    """
    value, shown = converted(value, unit)
    return _fixed(value, DECIMALS.get(unit, OTHER)), "" if unit == "count" else shown


def finest(unit: str) -> float:
    """Return the least difference, in `unit`, that `figure` shows; 0: the unit has no decimals of its own."""
    if unit not in DECIMALS:
        return 0.0
    return 10.0 ** -DECIMALS[unit] / converted(1.0, unit)[0]


def apart(value: float, limit: float, unit: str) -> tuple[str, str]:
    """Write a reading beside a limit: the limit as it was entered, the reading as fine, or finer."""
    shown, bound = converted(value, unit)[0], entered(limit, unit)
    number, _, symbol = bound.partition(" ")
    decimals = max(DECIMALS.get(unit, OTHER), len(number.partition(".")[2]))
    while value != limit and float(_fixed(shown, decimals)) == float(number) and decimals < MOST_DECIMALS:
        decimals += 1
    return f"{_fixed(shown, decimals)} {symbol}".rstrip(), bound


def _fixed(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}" if abs(value) < LARGE else f"{value:.4g}"
    return text if text.strip("-0.") else text.removeprefix("-")


def rounded(value: Any) -> Any:
    """Return a plain value with the digits that people read, and noise as 0."""
    if isinstance(value, float):
        return float(number(value))
    if isinstance(value, Mapping):
        return {name: rounded(part) for name, part in cast("Mapping[str, Any]", value).items()}
    if isinstance(value, list | tuple):
        return [rounded(part) for part in cast("Sequence[Any]", value)]
    return value


def in_words(fields: Iterable[FieldSpec], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments for a line of a log: rounded, and angles as a person would type them, `45deg`.

    Args:
        fields: as the command declares them; what is not among them keeps its unit.
        arguments: by name, in the declared units, or texts as they came.
    """
    known, values = {field.name: field for field in fields}, rounded(arguments)
    return {name: _each(known[name], value, _in_words) if name in known else value
            for name, value in values.items()}  # fmt: skip


def _in_words(field: FieldSpec, angle: float | str) -> str:
    return angle if isinstance(angle, str) else with_unit(number(degrees(angle)), field.unit)


def is_angle(field: FieldSpec) -> bool:
    """Whether a field is an angle, or a speed of turning."""
    return field.type == "float" and field.unit in IN_DEGREES


def as_shown(field: FieldSpec) -> FieldSpec:
    """Return a field as people read it: units, bounds and default of all angles in it in degrees."""
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
    """Return a command with its parameters as people read them."""
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
