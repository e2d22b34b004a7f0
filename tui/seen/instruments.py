"""Readings as an operator reads them: grouped, decimals fixed by unit, every angle in degrees. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, isfinite

from robotree.vr.base.readable import figure

POSE = ("x", "y", "z", "twist")
SPEED = ("vx", "vy", "vz")
FORCE = ("fx", "fy", "fz")
TORQUE = ("tx", "ty", "tz")
GRIP = ("width", "grip_force")
PEAK = "peak_force"

SI: Mapping[str, str] = {
    **dict.fromkeys(("x", "y", "z", "width"), "m"), "twist": "rad", **dict.fromkeys(SPEED, "m/s"),
    **dict.fromkeys((*FORCE, "grip_force", PEAK), "N"), **dict.fromkeys(TORQUE, "N m"), "age": "s",
}  # fmt: skip
"""Units of the well known readings, where a robot declares none: they are SI (`vr.requests.State`)."""

HOLDS = 0.5
"""[N] between the fingers from which on they hold something."""

MATTERS = 1.0
"""[s] of age from which on it is shown: younger is live."""

_JOINT = re.compile(r"j[0-9]+")


@dataclass(frozen=True, slots=True)
class Figure:
    """One reading, written."""

    name: str
    """Before the number; empty: the group's label is enough."""
    text: str
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Group:
    """Readings that are read together, in one line."""

    label: str
    figures: tuple[Figure, ...]


def size(readings: Mapping[str, float]) -> float | None:
    """Return the size of the force among the readings [N]; None: it is not there."""
    parts = [readings[name] for name in FORCE if name in readings]
    return hypot(*parts) if parts else None


def unit_of(name: str, units: Mapping[str, str]) -> str:
    """Return the unit of a reading: as the robot declares it, else the SI unit of a well known one."""
    return units.get(name, "") or SI.get(name, "rad" if _JOINT.fullmatch(name) else "")


def groups(
    readings: Mapping[str, float], units: Mapping[str, str], *, old: bool = False, folded: bool = True
) -> list[Group]:
    """Group the readings of a robot.

    Args:
        readings: by name.
        units: of those that have one.
        old: they are not live: their age is shown however small it is.
        folded: the joints share a group; else each has its own.

    Returns:
        The groups that have something: pose, speed, force, torque, grip, joints, others, health.
    """
    rest = dict(readings)
    units = {name: unit_of(name, units) for name in rest}
    found: list[Group] = []

    def take(label: str, names: Iterable[str], *, named: bool = True) -> None:
        parts = [name for name in names if name in rest]
        if parts:
            found.append(Group(label, _figures({name: rest.pop(name) for name in parts}, units, named=named)))

    take("pose", POSE)
    take("speed", SPEED)
    force = size(rest)
    take("force", (*FORCE, PEAK))
    if force is not None:
        found[-1] = Group(
            "force",
            (
                Figure("", *figure(force, next(units[one] for one in FORCE if one in units))),
                *found[-1].figures,
            ),
        )
    take("torque", TORQUE)
    if "width" in rest:
        width, hold = rest.pop("width"), rest.pop("grip_force", None)
        shown = (
            (f"{round(1000 * width)}", "mm")
            if units.get("width") == "m"
            else figure(width, units.get("width", ""))
        )
        held = () if hold is None else _hold(hold)
        found.append(Group("grip", (Figure("", *shown), *held)))
    joints = sorted((name for name in rest if _JOINT.fullmatch(name)), key=lambda name: int(name[1:]))
    if folded:
        take("joints", joints, named=False)
    for name in joints if not folded else ():
        take(name, [name], named=False)
    age = rest.pop("age", None)
    for name in sorted(rest):
        take(name, [name], named=False)
    if age is not None and (old or age >= MATTERS):
        found.append(Group("age", (Figure("", *figure(age, "s")),)))
    return found


def _hold(force: float) -> tuple[Figure, ...]:
    if abs(force) < HOLDS:
        return (Figure("", "holds nothing"),)
    return (Figure("holds with", *figure(force, "N")),)


def _figures(readings: Mapping[str, float], units: Mapping[str, str], *, named: bool) -> tuple[Figure, ...]:
    """Write readings one after the other; a unit stands behind the last one that has it."""
    written = [
        (name if named else "", *figure(value, units.get(name, ""))) for name, value in readings.items()
    ]
    units_after = [*(unit for _, _, unit in written[1:]), ""]
    return tuple(
        Figure(name, text, unit if unit != after else "")
        for (name, text, unit), after in zip(written, units_after, strict=True)
    )


HALF = 12
"""Cells on each side of the middle of a bar, at most."""
_EIGHTHS = " ▏▎▍▌▋▊▉█"


def bar(value: float, full: float, half: int = HALF) -> tuple[str, str]:
    """Return the two halves of a bar around its middle.

    Args:
        value: what is drawn; nothing is when it is not finite.
        full: value at the end of the bar; more is drawn as this.
        half: cells on each side.

    Returns:
        The left half, filled from the right for negative values, and the right half; each `half` cells.
    """
    share = min(abs(value) / full, 1.0) * half if isfinite(value) else 0.0
    whole = int(share)
    part = round((share - whole) * 8)
    if not value < 0:
        filled = ("█" * whole + (_EIGHTHS[part] if whole < half else "")).rstrip()
        return " " * half, filled.ljust(half)
    # There are no blocks that are filled from the right in eighths: half a cell is as fine as it gets.
    filled = ("▐" if part >= 4 and whole < half else "") + "█" * whole
    return filled.rjust(half), " " * half


BARS = "▁▂▃▄▅▆▇█"


def bars(values: Sequence[float], low: float | None = None, high: float | None = None) -> str:
    """Draw values as bars, a cell each.

    Args:
        values: from the oldest to the newest; of one that is NaN nothing is drawn.
        low: of an empty bar; None: the least of the values.
        high: of a full bar; None: the greatest of them; where all are the same, bars are half full.
    """
    known = [value for value in values if isfinite(value)]
    low = min(known, default=0.0) if low is None else low
    high = max(known, default=0.0) if high is None else high
    drawn, top = "", len(BARS) - 1
    for value in values:
        share = (value - low) / (high - low) if high > low else 0.5
        drawn += BARS[min(max(round(top * share), 0), top)] if isfinite(value) else " "
    return drawn
