"""Units and ranges of numbers, and how text such as `10 cm` becomes a number in the unit asked for.

A number without a unit is meant in the declared one. Usual units are converted by a table; `pint` knows all
others, and is imported only when a text names one of them. What a caller wrote is matched by a narrow grammar
first, so that nothing that looks like a formula ever reaches a parser.
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

    def __post_init__(self) -> None:
        """Refuse a unit that nobody knows, and name the nearest one."""
        symbol: Any = self.symbol
        if not isinstance(symbol, str):
            raise TypeError(f"Unit({self.symbol!r}): a unit is a text, such as Unit('m')")
        if self.symbol not in _USUAL:
            _expect_known(self.symbol)

    def __repr__(self) -> str:
        return f"Unit({self.symbol!r})"


class Range(msgspec.Struct, frozen=True):
    """Says in an annotation which numbers are taken, bounds included: `Range(-0.7, 0.7)`."""

    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        """Refuse a range that nothing lies in, and bounds that are no numbers."""
        for bound in cast("list[object]", [self.lower, self.upper]):
            if isinstance(bound, bool) or not isinstance(bound, int | float | None):
                raise TypeError(f"Range({self.lower!r}, {self.upper!r}): its bounds are numbers, or None")
        if self.lower is not None and self.upper is not None and not self.lower <= self.upper:
            msg = f"a range from {self.lower} to {self.upper} is empty"
            raise ValueError(msg)


_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")
_FACTOR = r"[^\W\d_]+[°%]?(?:(?:\*\*|\^)-?\d)?|[°%]"
_UNIT = re.compile(rf"(?:{_FACTOR})(?:\s*[*/·]\s*(?:{_FACTOR})){{0,3}}")
_LONGEST = 80
_USUAL = {
    "", "m", "cm", "mm", "km", "in", "m/s", "mm/s", "m/s**2", "m/s^2", "rad", "deg", "°", "rad/s", "deg/s",
    "°/s", "s", "ms", "min", "h", "N", "N*m", "N m", "kg", "g", "l", "Hz", "V", "A", "W", "K", "°C", "Pa",
    "bar", "%", "count",
}  # fmt: skip
"""Known without `pint`, which takes 0.4 s to load."""
SCALES: dict[str, tuple[str, float, float]] = {
    "m": ("length", 1, 1), "cm": ("length", 1, 100), "mm": ("length", 1, 1000), "km": ("length", 1000, 1),
    "in": ("length", 127, 5000), "s": ("time", 1, 1), "ms": ("time", 1, 1000), "min": ("time", 60, 1),
    "h": ("time", 3600, 1), "rad": ("angle", 1, 1), "deg": ("angle", math.pi, 180),
    "°": ("angle", math.pi, 180),
    "m/s": ("speed", 1, 1), "cm/s": ("speed", 1, 100), "mm/s": ("speed", 1, 1000), "km/h": ("speed", 5, 18),
}  # fmt: skip
"""Converted without `pint`: the first call with `10 cm` would wait until it is loaded, on a busy machine for
longer than its caller does. What each measures, and its parts of the SI unit: numerator and denominator."""
_WORDS = {
    **dict.fromkeys(("metre", "metres", "meter", "meters"), "m"),
    **dict.fromkeys(("centimetres", "centimeters"), "cm"),
    **dict.fromkeys(("millimetres", "millimeters"), "mm"),
    **dict.fromkeys(("second", "seconds", "sec"), "s"),
    **dict.fromkeys(("minute", "minutes"), "min"),
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("degree", "degrees"), "deg"),
    **dict.fromkeys(("newton", "newtons"), "N"),
    **dict.fromkeys(("Nm", "newtonmetres"), "N*m"),
    **dict.fromkeys(("inch", "inches"), "in"),
    **dict.fromkeys(("kilogram", "kilograms", "kgs"), "kg"),
    **dict.fromkeys(("gram", "grams"), "g"),
    **dict.fromkeys(("percent",), "%"),
}
"""Words that people write, and the symbols that are meant: to name the nearest unit."""


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


def takes_long(text: str, unit: str) -> bool:
    """Whether `read_quantity` has to load `pint` first (0.4 s), for the text names a unit that is not usual.

    Args:
        text: as it came.
        unit: symbol of the declared unit; empty: a plain number.
    """
    if _registry.cache_info().currsize:
        return False
    found = _QUANTITY.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    return found is not None and found[2].strip() not in {"", unit} and not _scaled(found[2].strip(), unit)


def convert(number: float, given: str, wanted: str) -> float:
    """Return a number in another unit.

    Raises:
        ValueError: one of the units is not known, or they measure different things.
    """
    return number if given == wanted else _convert(number, given, wanted)


def seconds(given: float | str) -> float:
    """Return a time [s] that an author gives as a number in seconds or as a text with a unit: `"500 ms"`.

    Raises:
        ValueError: it is none, or below zero.
    """
    value: Any = given
    number = read_quantity(value, "s") if isinstance(value, str) else float(value)
    if not 0.0 <= number < math.inf:
        raise ValueError(f"{shorten(given)} is no time: write for example 0.5, or '500 ms'")
    return number


def in_unit(unit: str) -> str:
    """Return ` in UNIT`, or nothing for a plain number."""
    return f" in {unit}" if unit else ""


def shorten(value: object) -> str:
    """Return what somebody wrote, quoted and not longer than a line."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _expect_known(symbol: str) -> None:
    """Refuse a unit that nobody knows.

    Raises:
        ValueError: names the nearest one.
    """
    import pint

    readable = _UNIT.fullmatch(symbol.removeprefix("1/"))
    try:
        if readable and symbol != "Nm":  # pint reads it as a number of metres
            _registry().parse_units(symbol)
            return
    except (pint.PintError, AttributeError, TypeError, ValueError, ArithmeticError):
        pass
    import difflib

    known = {**{one: one for one in _USUAL}, **_WORDS}
    near = difflib.get_close_matches(symbol, known, n=1, cutoff=0.5)
    nearest = f"; the nearest is {known[near[0]]!r}" if near else "; write for example 'm', 'rad', 's' or 'N'"
    raise ValueError(f"the unit {symbol!r} is not known{nearest}")


def _scaled(given: str, wanted: str) -> bool:
    """Whether both units are usual ones of the same dimension."""
    return given in SCALES and wanted in SCALES and SCALES[given][0] == SCALES[wanted][0]


def _convert(number: float, given: str, wanted: str) -> float:
    if _scaled(given, wanted):
        (_, times, by), (_, per, of) = SCALES[given], SCALES[wanted]
        return number * (times * of) / (by * per)
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
