"""The named places of a realm, each in a file of its own beside what the realm keeps: `places/NAME.json`.

A place is a point of the workspace with a name that people give: `@shelf`. Every process of the machine reads
them when it needs them; only the owner of the realm can write into the folder.

Coordinates mean nothing without their frame. It is named as the robots name theirs (`frame_of`): robots of
one controller share one, and a place is refused to a robot of another frame instead of leading it somewhere.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from robotree.files import private_folder, read, replace
from robotree.tui.errors import ValueRefused
from robotree.tui.seen.angles import IN_DEGREES

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
    from math import degrees

    turns = COORDINATES[name] in IN_DEGREES
    # what rounds to nothing has no sign
    return f"{round(degrees(value), 1) + 0.0:.1f}" if turns else f"{round(value, 3) + 0.0:.3f}"


def coordinate_unit(name: str) -> str:
    """Return the unit in which people read and type a coordinate."""
    return IN_DEGREES.get(COORDINATES[name], COORDINATES[name])


def coordinate_gap(name: str) -> str:
    """Return what stands between a coordinate and its unit."""
    return "" if COORDINATES[name] in IN_DEGREES else " "


class PlaceFiles:
    """The places of one realm. May be used in any thread."""

    def __init__(self, folder: Path | None) -> None:
        """Take the folder in which the realm keeps its things; None: it keeps nothing, and has no places."""
        self._folder = None if folder is None else folder / FOLDER

    def names(self) -> list[str]:
        """Return the names of all places."""
        if self._folder is None:
            return []
        try:
            return sorted(path.stem for path in self._folder.iterdir() if path.suffix == ".json")
        except OSError:
            return []

    def all(self) -> Mapping[str, NamedPlace]:
        """Return all places that can be read, by name."""
        found: dict[str, NamedPlace] = {}
        for name in self.names():
            with contextlib.suppress(ValueRefused):
                found[name] = self.find(name)
        return found

    def find(self, name: str) -> NamedPlace:
        """Return one place.

        Raises:
            ValueRefused: there is none of this name, or its file cannot be read.
        """
        if self._folder is None or name not in self.names():
            known = ", ".join(f"@{each}" for each in self.names()) or "none"
            raise ValueRefused("PLACE", f"there is no place @{name}; known: {known}")
        path = self._folder / f"{name}.json"
        try:
            place = msgspec.json.decode(read(path, LARGEST), type=NamedPlace)
        except (OSError, msgspec.MsgspecError) as error:
            raise ValueRefused("PLACE", f"{path} cannot be read: {error}") from None
        return checked(msgspec.structs.replace(place, name=name))

    def write(self, place: NamedPlace) -> None:
        """Keep a place, instead of the one that had its name.

        Raises:
            ValueRefused: it cannot be one, or cannot be kept.
        """
        checked(place)
        if self._folder is None:
            raise ValueRefused("PLACE", "this realm keeps nothing, so it has no places")
        try:
            private_folder(self._folder)
            replace(self._folder / f"{place.name}.json", msgspec.json.encode(place))
        except OSError as error:
            raise ValueRefused("PLACE", f"{error.filename}: {error.strerror}") from None

    def delete(self, name: str) -> None:
        """Forget a place.

        Raises:
            ValueRefused: there is none of this name.
        """
        self.find(name)
        assert self._folder is not None  # noqa: S101 # else it was not found
        with contextlib.suppress(FileNotFoundError):
            (self._folder / f"{name}.json").unlink()


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
