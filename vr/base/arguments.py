"""The one place where arguments are read, checked and refused: for the callee, the command line and the form.

A number is taken as it is in the declared unit; text may name another unit. Lists and records are taken as
they are, or as people type them (`literal.py`). What is refused is refused in one sentence that names the
parameter or the part of it (`points[3].x`), its unit and its range.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar, cast

from robotree.vr.base.description import NESTED, Arguments, CommandSpec, FieldSpec, ParameterType
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.literal import read_list, read_record
from robotree.vr.base.plain import plain_arguments
from robotree.vr.base.units import in_unit, read_quantity, shorten

_T = TypeVar("_T")
_ROUNDING = 1e-9
"""The rounding error of a conversion: 70 cm are 0.7000000000000001 m."""

_TRUTHS = {
    **dict.fromkeys(("true", "yes", "on", "1"), True),
    **dict.fromkeys(("false", "no", "off", "0"), False),
}


def check_arguments(spec: CommandSpec, arguments: Arguments, *, robot: str = "") -> dict[str, Any]:
    """Return the arguments as the command takes them.

    Args:
        spec: the command.
        arguments: by name; numbers in the declared unit, or text with or without a unit.
        robot: its name, for messages.

    Returns:
        The given arguments, numbers in the declared units; defaults are not filled in.

    Raises:
        BadArgument: one is unknown, missing, of the wrong type or dimension, not finite or out of range.
    """
    try:
        return _read_parts(spec.by_name, arguments, "", "parameter; it takes")
    except _Refused as error:
        label = f"{robot}.{spec.name}" if robot else spec.name
        raise BadArgument(command=label, parameter=error.path, reason=error.reason) from None


def check_argument(field: FieldSpec, value: object, *, command: str) -> Any:
    """Return one argument as its command takes it: see `check_arguments`.

    Raises:
        BadArgument: it is of the wrong type or dimension, not finite or out of range.
    """
    try:
        return _read(field, value, field.name)
    except _Refused as error:
        raise BadArgument(command=command, parameter=error.path, reason=error.reason) from None


def expected(field: FieldSpec) -> str:
    """Return what a parameter takes, for people: `a number in m from -0.7 to 0.7`."""
    return _EXPECTED[field.type](field)


def _expected_number(field: FieldSpec) -> str:
    kind = "a whole number" if field.type == "int" else "a number"
    match field.lower, field.upper:
        case None, None:
            span = ""
        case lower, None:
            span = f" of {lower:g} or more"
        case None, upper:
            span = f" of {upper:g} or less"
        case lower, upper:
            span = f" from {lower:g} to {upper:g}"
    return f"{kind}{in_unit(field.unit)}{span}"


_EXPECTED: dict[ParameterType, Callable[[FieldSpec], str]] = {
    "choice": lambda field: f"one of {', '.join(field.choices)}",
    "bool": lambda _: "true or false",
    "str": lambda _: "text",
    "int": _expected_number,
    "float": _expected_number,
    "list": lambda field: f"a list [value, value …], each value {expected(field.items[0])}",
    "tuple": lambda field: f"{len(field.items)} values: ({', '.join(map(expected, field.items))})",
    "dict": lambda field: f"values by name {{name: value, …}}, each value {expected(field.items[0])}",
    "record": lambda field: f"{{{', '.join(f'{part.name}: {expected(part)}' for part in field.items)}}}",
    "bytes": lambda _: "bytes",
}


class _Refused(Exception):
    """A value, or one of those in it, cannot be taken."""

    def __init__(self, path: str, reason: str) -> None:
        """Say which one and why."""
        self.path, self.reason = path, reason


def _read(field: FieldSpec, value: object, path: str) -> Any:
    # a person types that there is none, where none is needed; of a text that cannot be told
    typed = isinstance(value, str) and field.type != "str" and value.strip().lower() in {"none", "null"}
    if (value is None or typed) and field.optional:
        return None
    try:
        if isinstance(value, str) and field.nested:
            value = read_record(value) if field.type in {"dict", "record"} else read_list(value)
        found = _READERS[field.type](field, value)
    except (TypeError, ValueError) as error:
        raise _Refused(path, str(error)) from None
    return _read_inside(field, found, path) if field.type in NESTED else found


def _read_inside(field: FieldSpec, found: Any, path: str) -> Any:
    """Read the values in a list or record."""
    match field.type:
        case "list":
            (item,) = field.items
            return [_read(item, part, f"{path}[{index}]") for index, part in enumerate(found)]
        case "tuple":
            parts = zip(field.items, found, strict=True)
            return [_read(item, part, f"{path}[{index}]") for index, (item, part) in enumerate(parts)]
        case "dict":
            (item,) = field.items
            return {name: _read(item, part, f"{path}.{name}") for name, part in found.items()}
        case _:
            named = {part.name: part for part in field.items}
            return _read_parts(named, found, f"{path}.", "part; it has")


def _read_parts(
    parts: Mapping[str, FieldSpec], given: Mapping[str, object], path: str, known: str
) -> dict[str, Any]:
    for name in given:
        if name not in parts:
            raise _Refused(f"{path}{name}", f"there is no such {known} {', '.join(parts) or 'none'}")
    for name, part in parts.items():
        if part.required and name not in given:
            raise _Refused(f"{path}{name}", f"is missing; give {expected(part)}")
    read: dict[str, Any] = {}
    for name, value in given.items():
        read[name] = _read(parts[name], value, path + name)
    return read


def _number(field: FieldSpec, value: object) -> float:
    if type(value) is float and -1e300 < value < 1e300:
        number = value
    elif isinstance(value, str):
        number = read_quantity(value, field.unit)
    elif isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"{shorten(value)} is not {expected(field)}")
    else:
        number = float(value) if abs(value) < 1e300 else math.inf
    if not math.isfinite(number):
        raise ValueError(f"{value} is not a finite number; give {expected(field)}")
    exact = number
    if field.lower is not None:
        number = max(number, field.lower)
    if field.upper is not None:
        number = min(number, field.upper)
    if number != exact and not math.isclose(number, exact, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
        shown = f"{value}" if isinstance(value, str) else f"{exact:g} {field.unit}".strip()
        raise ValueError(f"{shown} is out of range; give {expected(field)}")
    return number


def _whole(field: FieldSpec, value: object) -> int:
    number = _number(field, value)
    if not number.is_integer():
        raise ValueError(f"{value} is not {expected(field)}")
    return value if type(value) is int else int(number)


def _truth(field: FieldSpec, value: object) -> bool:
    truth = _TRUTHS.get(value.strip().lower()) if isinstance(value, str) else value
    if not isinstance(truth, bool):
        raise TypeError(f"{shorten(value)} is not {expected(field)}")
    return truth


def _choice(field: FieldSpec, value: object) -> str:
    if not isinstance(value, str) or value not in field.choices:
        raise ValueError(f"{shorten(value)} is not {expected(field)}")
    return value


def _tuple(field: FieldSpec, value: object) -> Sequence[object]:
    values = _list(field, value)
    if len(values) != len(field.items):
        raise ValueError(f"{shorten(value)} has {len(values)} values; give {expected(field)}")
    return values


def _dict(field: FieldSpec, value: object) -> Mapping[str, object]:
    named = _record(field, value)
    if odd := [name for name in named if not isinstance(name, str)]:
        raise TypeError(f"the key {shorten(odd[0])} is no text; give {expected(field)}")
    return named


def _instance(cls: type[_T]) -> Callable[[FieldSpec, object], _T]:
    """Return what takes a value of one class as it is; a text is a value of `str` alone."""

    def taken(field: FieldSpec, value: object) -> _T:
        if not isinstance(value, cls) or (isinstance(value, str) and cls is not str):
            raise TypeError(f"{shorten(value)} is not {expected(field)}")
        return value

    return taken


_list = _instance(cast("type[Sequence[Any]]", Sequence))
_record = _instance(cast("type[Mapping[Any, Any]]", Mapping))
_READERS: dict[ParameterType, Callable[[FieldSpec, object], Any]] = {
    "float": _number,
    "int": _whole,
    "bool": _truth,
    "str": _instance(str),
    "choice": _choice,
    "list": _list,
    "tuple": _tuple,
    "dict": _dict,
    "record": _record,
    "bytes": _instance(bytes),
}


def named_arguments(
    label: str, values: Sequence[Any], arguments: Mapping[str, Any], names: Callable[[], Sequence[str]]
) -> dict[str, Any]:
    """Return the arguments of a call by name, as plain values.

    Args:
        label: of the command, for messages.
        values: those that were given by position.
        arguments: those that were given by name.
        names: returns the parameters of the command in their order; asked only if there are values.

    Raises:
        BadArgument: a value cannot travel, there are too many, or one is given twice.
    """
    try:
        named = plain_arguments(arguments)
        numbered = plain_arguments({str(number): value for number, value in enumerate(values, 1)})
    except TypeError as error:
        name, _, reason = str(error).partition(": ")
        raise BadArgument(command=label, parameter=name, reason=reason) from None
    if not values:
        return named
    known = names()
    if len(values) > len(known):
        reason = f"too many; it takes {len(known)} ({', '.join(known)})"
        raise BadArgument(command=label, parameter=f"value {len(known) + 1}", reason=reason)
    positional = dict(zip(known, numbered.values(), strict=False))
    for name in positional.keys() & named:
        raise BadArgument(command=label, parameter=name, reason="is given twice")
    return positional | named
