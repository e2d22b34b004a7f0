"""What a proxy can ask of a controller, in the words and units of the agents' side.

A motion is a wish without a sender: no key, no epoch, no time. `guard` judges it, `translate` puts it on the
wire. Lengths are in metres along the axes of the cell's frame W, angles in radians about its vertical, speeds
in metres per second.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class GoTo:
    """Move the tool to a point, pointing down."""

    x: float
    y: float
    z: float
    twist: float
    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip:
    """Bring the fingers to a distance from each other; an object in between stops them earlier."""

    width: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Move a mobile base by x, y from where it stands, without turning."""

    x: float
    y: float
    speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """Stay, compliantly, and drop any other goal."""


Motion = GoTo | Grip | Move | Hold
