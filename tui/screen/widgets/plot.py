"""A plot of readings over time, or of one against another; only lines that differ are drawn again."""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import degrees
from typing import NamedTuple

from rich.cells import cell_len
from rich.segment import Segment
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen import plotting
from robotree.tui.seen.cells import seen
from robotree.tui.seen.plotting import Canvas, Curve, Frame
from robotree.tui.seen.series import Reading, Series, named
from robotree.vr.base.readable import IN_DEGREES, figure, finest

AXIS = 9
"""Cells for the numbers beside a plot."""
STEPS = 4
"""Of the last digit that a unit shows, in the least range of an axis: its three numbers differ."""
COLOURS = ("muted", "accent", "error")
"""Variables of the theme: of nothing, of the curve, of a threshold."""

Cells = list[tuple[str, str]]
"""A line: texts, each with a variable of the theme."""


class Shown(NamedTuple):
    """A reading that is drawn."""

    reading: Reading
    series: Series
    unit: str


class Plot(Part, Widget):
    """Shows one reading, or two against each other, as a page asks for it."""

    DEFAULT_CSS = "Plot { height: 1fr; width: 1fr; min-height: 3; }"

    def __init__(self) -> None:
        """Show nothing yet."""
        super().__init__()
        self._lines: list[Cells] = []
        self._range: tuple[float, float] | None = None
        self._reading: object = None
        self._asked: tuple[object, ...] = ()
        """With what it was drawn last: nothing is computed for the same again."""

    def draw(
        self, shown: Shown, end: float, window: float, *, limits: Sequence[float] = (), wall: float = 0.0
    ) -> None:
        """Draw a reading over the time before `end` [s].

        Args:
            shown: the reading.
            end: [s] on the store's clock, at the right edge.
            window: [s] that is shown.
            limits: thresholds.
            wall: [s] since 1970 at `end`.
        """
        reading, series, unit = shown
        width, height = self._room()
        end = plotting.aligned(end, window, 2 * width)
        asked = (reading, series.count, end, window, tuple(limits), width, height, self.app.theme)
        if asked == self._asked:
            return
        if reading != self._reading:
            self._reading, self._range = reading, None
        self._asked = asked
        curve = Curve(*series.between(end - window, end))
        self._range = plotting.steady(
            self._range, plotting.range_of(curve.values, *limits, least=STEPS * finest(unit))
        )
        low, high = self._range
        canvas = Canvas(width, height)
        if curve.values:
            plotting.over_time(canvas, curve, Frame(end - window, end, low, high), limits)
        clock = " … ".join(time.strftime("%H:%M:%S", time.localtime(at)) for at in (wall - window, wall))
        self._show(self._head(reading, curve.values, unit, clock), canvas, (low, high), unit)

    def draw_against(self, across: Shown, up: Shown, end: float, window: float) -> None:
        """Draw one reading (up) against another (across) in the time before `end` [s]."""
        width, height = self._room()
        asked = (across[0], up[0], across[1].count, up[1].count, end, window, width, height, self.app.theme)
        if asked == self._asked:
            return
        self._asked, self._reading, self._range = asked, None, None
        xs, ys = plotting.together(
            Curve(*across[1].between(end - window, end)), Curve(*up[1].between(end - window, end))
        )
        left, right = plotting.range_of(xs, least=STEPS * finest(across[2]))
        low, high = plotting.range_of(ys, least=STEPS * finest(up[2]))
        canvas = Canvas(width, height)
        if xs:
            plotting.against(canvas, xs, ys, Frame(left, right, low, high))
        shown = [_shown(value, across[2]) for value in (left, right)]
        head: Cells = [
            (f" {seen(named(up[0]))}", "foreground"),
            (f" against {seen(named(across[0]))}, from {shown[0]} to {shown[1]}", "muted"),
        ]
        self._show(head, canvas, (low, high), up[2])

    # -- lines -------------------------------------------------------------------------------------

    def _room(self) -> tuple[int, int]:
        return max(self.size.width - AXIS - 1, 1), max(self.size.height - 1, 1)

    def _head(self, reading: Reading, values: Sequence[float], unit: str, clock: str) -> Cells:
        head: Cells = [(f" {seen(named(reading))}  ", "foreground")]
        if values:
            head.append((f"{_shown(values[-1], unit)}", "accent"))
            least, most = _shown(min(values), unit), _shown(max(values), unit)
            head.append((f"  {least} to {most}", "muted"))
        else:
            head.append(("nothing in this time", "muted"))
        used = sum(cell_len(text) for text, _ in head)
        if (gap := self.size.width - used - len(clock) - 1) > 1:
            head.append((" " * gap + clock, "muted"))
        return head

    def _show(self, head: Cells, canvas: Canvas, ends: tuple[float, float], unit: str) -> None:
        """Take new lines, and have those drawn again that differ."""
        low, high = ends
        drawn = canvas.lines()
        labels = {0: high, len(drawn) - 1: low}
        if len(drawn) >= 5:
            labels[len(drawn) // 2] = high - (high - low) * (len(drawn) // 2) / (len(drawn) - 1)
        axes = {number: figure(value, unit)[0] for number, value in labels.items()}
        if len(set(axes.values())) < len(axes):  # the digits of the unit cannot tell them apart
            scale = degrees(1.0) if unit in IN_DEGREES else 1.0
            axes = {at: plotting.label(scale * value, scale * (high - low)) for at, value in labels.items()}
        lines: list[Cells] = [head]
        for number, runs in enumerate(drawn):
            axis = axes.get(number, "")
            line: Cells = [(f"{axis[: AXIS - 1]:>{AXIS - 1}}│", "muted")]
            line += [(text, COLOURS[min(whose, 2)]) for text, whose in runs]
            lines.append(line)
        before, self._lines = self._lines, lines
        if len(before) != len(lines):
            self.refresh()
            return
        width = self.size.width
        dirty = [Region(0, at, width, 1) for at, line in enumerate(lines) if line != before[at]]
        if dirty:
            self.refresh(*dirty)

    def render_line(self, y: int) -> Strip:
        """Draw one line of cells."""
        base, width = self.rich_style, self.size.width
        if y >= len(self._lines):
            return Strip.blank(width, base)
        segments = [
            Segment(text, base if colour == "foreground" else base + tint(self.app, colour))
            for text, colour in self._lines[y]
        ]
        return Strip(segments).adjust_cell_length(width, base)


def _shown(value: float, unit: str) -> str:
    return " ".join(figure(value, unit)).strip()
