"""The one place where arguments are read, checked and refused: for the callee, the command line and the form.

A number is taken as it is in the declared unit; text may name another unit. What is refused is refused in
one sentence that names the parameter, its unit and its range.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from robotree.vr.description import Arguments, CommandSpec, FieldSpec, ParameterType
from robotree.vr.errors import BadArgument
from robotree.vr.units import in_unit, read_quantity, shorten

_ROUNDING = 1e-9
"""What a conversion may overshoot a bound by: 70 cm are 0.7000000000000001 m."""

_WORDS = {
    "true": True,
    "yes": True,
    "on": True,
    "1": True,
    "false": False,
    "no": False,
    "off": False,
    "0": False,
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
    label = f"{robot}.{spec.name}" if robot else spec.name
    fields = {field.name: field for field in spec.parameters}
    for name in arguments:
        if name not in fields:
            takes = ", ".join(fields) or "none"
            raise BadArgument(
                command=label, parameter=name, reason=f"there is no such parameter; it takes {takes}"
            )
    for field in spec.parameters:
        if field.required and field.name not in arguments:
            raise BadArgument(
                command=label, parameter=field.name, reason=f"is missing; give {expected(field)}"
            )
    return {name: check_argument(fields[name], value, command=label) for name, value in arguments.items()}


def check_argument(field: FieldSpec, value: object, *, command: str) -> Any:
    """Return one argument as its command takes it.

    Args:
        field: the parameter.
        value: a number in its unit, or text as a person types it.
        command: for messages.

    Raises:
        BadArgument: it is of the wrong type or dimension, not finite or out of range.
    """
    if value is None and not field.required and field.default is None:
        return None
    try:
        return _READERS[field.type](field, value)
    except (TypeError, ValueError) as error:
        raise BadArgument(command=command, parameter=field.name, reason=str(error)) from None


def expected(field: FieldSpec) -> str:
    """Return what a parameter takes, for people: `a number in m from -0.7 to 0.7`."""
    match field.type:
        case "choice":
            return f"one of {', '.join(field.choices)}"
        case "bool":
            return "true or false"
        case "str":
            return "text"
        case "int":
            return f"a whole number{in_unit(field.unit)}{_span(field)}"
        case "float":
            return f"a number{in_unit(field.unit)}{_span(field)}"


def _span(field: FieldSpec) -> str:
    match field.lower, field.upper:
        case None, None:
            return ""
        case lower, None:
            return f" of {lower:g} or more"
        case None, upper:
            return f" of {upper:g} or less"
        case lower, upper:
            return f" from {lower:g} to {upper:g}"


def _number(field: FieldSpec, value: object) -> float:
    if isinstance(value, str):
        number = read_quantity(value, field.unit)
    elif isinstance(value, bool) or not isinstance(value, (int, float)):
        raise TypeError(f"{shorten(value)} is not {expected(field)}")
    else:
        number = float(value) if abs(value) < 1e300 else math.inf
    if not math.isfinite(number):
        raise ValueError(f"{value} is not a finite number; give {expected(field)}")
    number, meant = _clip(field, number), number
    if not math.isclose(number, meant, rel_tol=_ROUNDING, abs_tol=_ROUNDING):
        shown = f"{value}" if isinstance(value, str) else f"{meant:g} {field.unit}".strip()
        raise ValueError(f"{shown} is out of range; give {expected(field)}")
    return number


def _clip(field: FieldSpec, number: float) -> float:
    low = -math.inf if field.lower is None else field.lower
    high = math.inf if field.upper is None else field.upper
    return min(max(number, low), high)


def _whole(field: FieldSpec, value: object) -> int:
    number = _number(field, value)
    if not number.is_integer():
        raise ValueError(f"{value} is not {expected(field)}")
    return value if type(value) is int else int(number)


def _truth(field: FieldSpec, value: object) -> bool:
    truth = _WORDS.get(value.strip().lower()) if isinstance(value, str) else value
    if not isinstance(truth, bool):
        raise TypeError(f"{shorten(value)} is not {expected(field)}")
    return truth


def _text(field: FieldSpec, value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{shorten(value)} is not {expected(field)}")
    return value


def _choice(field: FieldSpec, value: object) -> str:
    if not isinstance(value, str) or value not in field.choices:
        raise ValueError(f"{shorten(value)} is not {expected(field)}")
    return value


_READERS: dict[ParameterType, Callable[[FieldSpec, object], Any]] = {
    "float": _number,
    "int": _whole,
    "bool": _truth,
    "str": _text,
    "choice": _choice,
}
