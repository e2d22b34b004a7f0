"""The named places of a realm, each in a file of its own beside what the realm keeps: `places/NAME.json`.

A place is a point of the workspace with a name that people give: `@shelf`. Every process of the machine reads
them when it needs them; only the owner of the realm can write into the folder.

Coordinates mean nothing without their frame. It is named as the robots name theirs (`frame_of`): robots of
one controller share one, and a place is refused to a robot of another frame instead of leading it somewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from robotree.files.named import NamedFiles
from robotree.tui.errors import ValueRefused
from robotree.vr.base.readable import IN_DEGREES, figure

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.policy import PolicyGate

FOLDER = "places"
LARGEST = 16 * 1024
"""[B] of one file."""
COORDINATES = {"x": "m", "y": "m", "z": "m", "twist": "rad", "heading": "rad"}
"""What a place may say, and in which unit."""


class NamedPlace(msgspec.Struct, frozen=True, kw_only=True):
    """A point of a workspace, with a name."""

    name: str
    frame: str
    """Name of the frame of its coordinates; see `frame_of`."""
    at: dict[str, float]
    """Its coordinates, those of `COORDINATES` that are known, x and y always: [m] and [rad]."""
    by: str = ""
    """Who named it."""

    @property
    def words(self) -> str:
        """Its coordinates, for people."""
        return coordinates_in_words(self.at)


def coordinates_in_words(at: Mapping[str, float]) -> str:
    """Return coordinates for people, angles in degrees: `x 0.350 m  y 0.100 m  twist 90.0°`."""
    return "  ".join(
        f"{name} {coordinate_in_words(name, at[name])}{coordinate_gap(name)}{coordinate_unit(name)}"
        for name in COORDINATES
        if name in at
    )


def coordinate_in_words(name: str, value: float) -> str:
    """Return a coordinate [m, rad] for people without its unit: angles in degrees."""
    return figure(value, COORDINATES[name])[0]


def coordinate_unit(name: str) -> str:
    """Return the unit in which people read and type a coordinate."""
    return IN_DEGREES.get(COORDINATES[name], COORDINATES[name])


def coordinate_gap(name: str) -> str:
    """Return what stands between a coordinate and its unit."""
    return "" if COORDINATES[name] in IN_DEGREES else " "


class PlaceFiles(NamedFiles[NamedPlace]):
    """The places of one realm. `ValueRefused`: there is none of a name, or it cannot be read or kept."""

    def __init__(self, folder: Path | None) -> None:
        """Take the folder in which the realm keeps its things; None: it keeps nothing, and has no places."""
        super().__init__(
            folder,
            FOLDER,
            NamedPlace,
            LARGEST,
            check=checked,
            unknown=_unknown,
            unusable=lambda _, reason: ValueRefused("PLACE", reason),
            refusal=ValueRefused,
        )


def _unknown(name: str, known: list[str]) -> ValueRefused:
    names = ", ".join(f"@{each}" for each in known) or "none"
    return ValueRefused("PLACE", f"there is no place @{name}; known: {names}")


def checked(place: NamedPlace) -> NamedPlace:
    """Return a place that can be one.

    Raises:
        ValueRefused: a coordinate is missing, unknown, or no number; names it.
    """
    from math import isfinite

    from robotree.vr.base.address import check_name

    check_name(place.name)
    _refuse(
        place, [name for name in place.at if name not in COORDINATES], "has a coordinate {}, which is none"
    )
    _refuse(place, [name for name in ("x", "y") if name not in place.at], "has no {}")
    _refuse(place, [name for name, value in place.at.items() if not isfinite(value)], "has no number for {}")
    return place


def _refuse(place: NamedPlace, wrong: Iterable[str], words: str) -> None:
    for name in wrong:
        raise ValueRefused("PLACE", f"@{place.name} {words.format(name)}; known are {', '.join(COORDINATES)}")


def places_beside(gate: PolicyGate) -> PlaceFiles:
    """Return the places of the realm of a policy."""
    from robotree.vr.network.policy_file import PolicyFile

    return PlaceFiles(gate.kept if isinstance(gate, PolicyFile) else None)
