"""Readings as a panel draws them: position in figures, forces as bars from the middle."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import degrees

from rich.text import Text

from robotree.tui.screen.teleoperable import FORCES, TORQUES
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.still import Still
from robotree.tui.seen import wording

FULL_FORCE = 35.0
"""[N] at the end of a force bar: the bound that the arm's controller keeps."""

FULL_TORQUE = 3.5
"""[N m] at the end of a torque bar."""

HALF = 12
"""Cells on each side of the middle of a bar, at most."""
NAMES, SHORT_NAMES = 12, 7
"""Cells for a name and a gap: `peak_force`, or `twist` where there is little room."""

ROOMY = 40
"""Cells from which on there is room for long names."""

BESIDE = 11
"""Cells for middle, figure and unit."""

FIGURES = {"x": "+8.4f", "y": "+8.4f", "z": "+8.4f", "twist": "+8.4f", "width": "8.4f"}
"""Well known readings and their formats. They are shown in the unit that the robot says, as the forms do."""

TURNS = {"twist": (degrees(1.0), "+8.2f", "°")}
"""Those that are commanded in steps of another unit in tele-operation: factor, format, that unit."""

BARS = {**dict.fromkeys(FORCES, (FULL_FORCE, "N")), **dict.fromkeys(TORQUES, (FULL_TORQUE, "Nm"))}
"""Readings that are drawn as bars: value at the end, unit."""

_RANK = {name: position for position, name in enumerate([*FIGURES, *BARS])}


def rank(name: str) -> tuple[int, str]:
    """Return where a reading stands: the well known ones first, the others by name."""
    return _RANK.get(name, len(_RANK)), name


_JOINT = re.compile(r"j\d+")


def is_of_robot(name: str) -> bool:
    """Whether a reading is one that robots tell of themselves."""
    return name in _RANK or _JOINT.fullmatch(name) is not None


def figure(value: float, shown: str) -> str:
    """Write a number in a format; what rounds to zero has no sign that would come and go."""
    text = f"{value:{shown}}"
    return text if float(text) else f"{0.0:{shown}}"


_EIGHTHS = " ▏▎▍▌▋▊▉█"
WARN, ALARM = 0.5, 0.8
"""Shares of a full bar from which on it is drawn as a warning, as an alarm."""


def bar(value: float, full: float, half: int = HALF) -> tuple[str, str]:
    """Return the two halves of a bar around its middle.

    Args:
        value: what is drawn.
        full: value at the end of the bar; more is drawn as this.
        half: cells on each side.

    Returns:
        The left half, filled from the right for negative values, and the right half; each `half` cells.
    """
    share = min(abs(value) / full, 1.0) * half
    whole = int(share)
    part = round((share - whole) * 8)
    if value >= 0:
        filled = ("█" * whole + (_EIGHTHS[part] if whole < half else "")).rstrip()
        return " " * half, filled.ljust(half)
    # There are no blocks that are filled from the right in eighths: half a cell is as fine as it gets.
    filled = ("▐" if part >= 4 and whole < half else "") + "█" * whole
    return filled.rjust(half), " " * half


class Gauges(Still):
    """Draws the readings of a robot; anything it has, the well known ones in their own way."""

    def __init__(self, *, id: str | None = None, in_degrees: bool = False) -> None:  # noqa: A002 # Textual's name for it
        """Show nothing yet; `in_degrees`: angles are commanded in degrees here, not in radians."""
        super().__init__(id=id)
        self._steps = TURNS if in_degrees else {}

    def draw(self, readings: Mapping[str, float], units: Mapping[str, str], *, stale: bool) -> None:
        """Draw these readings, with the units that the robot says; `stale`: they are old."""
        muted = tint(self.app, "muted")
        if not readings:
            self.show(Text("no readings yet", muted))
            return
        text = Text()
        if stale:
            text.append("readings are old\n", tint(self.app, "warning"))
        rest = dict(readings)
        for name, shown in FIGURES.items():
            if name in rest:
                told = (1.0, shown, units.get(name, ""))
                factor, shown_here, unit = self._steps.get(name, told)
                self._figure(text, name, figure(factor * rest.pop(name), shown_here), unit)
        for name, (full, unit) in BARS.items():
            if name in rest:
                self._bar(text, name, rest.pop(name), full, unit)
        for name, value in sorted(rest.items()):
            self._figure(text, name, f"{wording.number(value, 4):>8}", units.get(name, ""))
        text.rstrip()
        self.show(text)

    @property
    def _half(self) -> int:
        """Cells on each side of the middle: as many as there is room for."""
        return min(max((self.size.width - self._names - BESIDE) // 2, 2), HALF)

    @property
    def _names(self) -> int:
        """Cells for a name."""
        return NAMES if self.size.width >= ROOMY else SHORT_NAMES

    def _figure(self, text: Text, name: str, figure: str, unit: str) -> None:
        muted = tint(self.app, "muted")
        text.append(f"{name:<{self._names}}", muted)
        text.append(figure, "bold")
        text.append(f" {unit}".rstrip() + "\n", muted)

    def _bar(self, text: Text, name: str, value: float, full: float, unit: str) -> None:
        muted = tint(self.app, "muted")
        share = abs(value) / full
        colour = "error" if share >= ALARM else "warning" if share >= WARN else "primary"
        left, right = bar(value, full, self._half)
        style = tint(self.app, colour)
        text.append(f"{name:<{self._names}}", muted)
        text.append(left, style)
        text.append("│", muted)
        text.append(right, style)
        text.append(f" {figure(value, '+6.1f')} {unit}\n", style if share >= WARN else "")
