"""Numbers from the wire against limits. Pure."""

from __future__ import annotations

from math import isinf, isnan

from robotree.sim.errors import BadArgument

SINGLE = 2.0**-23
"""Relative distance of neighbouring single-precision numbers (IEEE 754): what the wire can be off."""


def require(name: str, value: float, lower: float, upper: float, unit: str) -> None:
    """Refuse an argument outside its limits; both are allowed, also as the wire's nearest floats to them.

    Raises:
        BadArgument: it is outside.
    """
    slack = SINGLE * max(abs(lower), abs(upper))
    if not lower - slack <= value <= upper + slack:
        raise BadArgument(name, value, f"{lower:g} to {upper:g} {unit}")


def or_now(name: str, value: float, now: float) -> float:
    """An argument, or what is now where it was not given (NaN).

    Raises:
        BadArgument: it is infinite.
    """
    if isinf(value):
        raise BadArgument(name, value, "finite")
    return now if isnan(value) else value
