"""Numbers from the wire against limits. Pure."""

from __future__ import annotations

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
