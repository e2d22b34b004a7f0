"""Units and ranges of numbers, and how text such as `10 cm` becomes a number in the unit asked for.

A number without a unit is meant in the declared one. `pint` knows all other units; it is imported only
when a text really names another one. What a caller wrote is matched by a narrow grammar first, so that
nothing that looks like a formula ever reaches a parser.
"""

from __future__ import annotations

import functools
import math
import re
from typing import Any, cast

import msgspec


class Unit(msgspec.Struct, frozen=True):
    """Says in an annotation in which unit a number is meant: `Annotated[float, Unit("m")]`."""

    symbol: str
    """As people write it: `m`, `rad`, `N`, `m/s`, `in`."""


class Range(msgspec.Struct, frozen=True):
    """Says in an annotation which numbers are taken, bounds included: `Range(-0.7, 0.7)`."""

    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        """Refuse a range that nothing lies in."""
        if self.lower is not None and self.upper is not None and not self.lower <= self.upper:
            msg = f"a range from {self.lower} to {self.upper} is empty"
            raise ValueError(msg)


_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")
_FACTOR = r"[^\W\d_]+[°%]?(?:(?:\*\*|\^)-?\d)?|[°%]"
_UNIT = re.compile(rf"(?:{_FACTOR})(?:\s*[*/·]\s*(?:{_FACTOR})){{0,3}}")
_LONGEST = 80


def read_quantity(text: str, unit: str) -> float:
    """Return the number that a text means, in `unit`.

    Args:
        text: a number, alone or followed by a unit of the same dimension.
        unit: symbol of the declared unit; empty: a plain number.

    Returns:
        The number in `unit`; it may be infinite if the text says so in digits (`1e999`).

    Raises:
        ValueError: why the text cannot be read, as the end of a sentence.
    """
    found = _QUANTITY.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    if found is None:
        raise ValueError(f"{shorten(text)} is not a number{in_unit(unit)}")
    number, given = float(found[1]), found[2].strip()
    if given in {"", unit}:
        return number
    if not unit:
        raise ValueError(f"{shorten(text)} has a unit; it takes a plain number")
    if not _UNIT.fullmatch(given):
        raise ValueError(f"{shorten(given)} cannot be read as a unit; give it in {unit}")
    return _convert(number, given, unit)


def in_unit(unit: str) -> str:
    """Return ` in UNIT`, or nothing for a plain number."""
    return f" in {unit}" if unit else ""


def shorten(value: object) -> str:
    """Return what somebody wrote, quoted and not longer than a line."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _convert(number: float, given: str, wanted: str) -> float:
    import pint

    registry = _registry()
    try:
        magnitude: Any = registry.Quantity(number, given).to(wanted).magnitude
    except pint.DimensionalityError:
        raise ValueError(f"{given} cannot be turned into {wanted}; give it in {wanted}") from None
    except (pint.PintError, AttributeError, TypeError, ValueError, ArithmeticError):
        raise ValueError(f"the unit {given!r} is not known; give it in {wanted}") from None
    return float(magnitude) if isinstance(magnitude, (int, float)) else math.nan


@functools.cache
def _registry() -> Any:
    import pint

    return cast("Any", pint.UnitRegistry())
