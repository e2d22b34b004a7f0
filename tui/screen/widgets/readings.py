"""Readings in lines, one group each: drawn the same way in the details, panels, tele-operation and views."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from rich.cells import cell_len
from rich.style import Style
from rich.text import Text

from robotree.tui.screen.hanging import TIE, broken
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen import instruments
from robotree.tui.seen.cells import clip, fit, seen
from robotree.tui.seen.instruments import Figure, Group
from robotree.tui.seen.status import span
from robotree.tui.seen.store import Store
from robotree.vr.base import readable

FULL = {
    **dict.fromkeys(instruments.FORCE, 35.0),
    **dict.fromkeys(instruments.TORQUE, 3.5),
}
"""Value at the end of a bar, by reading: [N] the bound that the arm's controller keeps, [N m]."""
FULL_FORCE = FULL["fx"]

WARN, ALARM = 0.5, 0.8
"""Shares of a full bar from which on it is drawn as a warning, as an alarm."""

WIDEST = 1000
"""Cells of a line before its widget has a size."""
LABEL = 8
"""Cells for the name of a line, and a gap."""
LONGEST = 24
"""Cells of a label, at most."""
SPARK = 8
"""Cells of the line of past forces."""
BESIDE = 14
"""Cells for the middle of a bar, the figure and its unit."""
LEAST = 8
"""Cells of words in a line, at least."""


@dataclass(frozen=True, slots=True)
class ShownReadings:
    """The drawn readings of a robot or a view."""

    readings: Mapping[str, float]
    units: Mapping[str, str]
    old: str = ""
    """How old they are; empty: they are live."""
    past: tuple[float, ...] = ()
    """[N] The sizes of past forces, the oldest first."""

    @classmethod
    def of(cls, store: Store, name: str, now: float) -> ShownReadings:
        """Return what the store knows of a robot at this moment [s]."""
        readings, age = store.readings(name), store.age(name, now)
        old = ""
        if store.old(name, now) and age is not None:
            old = f"{span(max(age, readings.get('age', 0.0)))} old"
        past = tuple(force for _, force in store.forces) if store.attended == name else ()
        return cls(readings, store.units(name), old, past)


class Lines(CachedText):
    """Draws lines with a label each; what is longer than a line goes on below its beginning."""

    def extent(self, text: Text) -> list[int]:
        """Return how many lines there are, if all of them fit into the width (`CachedText.extent`)."""
        lengths = super().extent(text)
        return [len(lengths)] if max(lengths) <= self.size.width else lengths

    def line(self, text: Text, label: str, words: Text) -> None:
        """Append a line, unless it says nothing."""
        if not words:
            return
        lead = clip(label, LONGEST) if cell_len(seen(label)) >= LABEL else fit(label, LABEL - 1)
        room = (self.size.width or WIDEST) - max(cell_len(lead) + 1, LABEL)
        for number, part in enumerate(broken(words, max(room, LEAST), self.app.console)):
            text.append("\n" if text else "")
            text.append(" " * LABEL if number else f"{lead} ", tint(self.app, "muted"))
            text.append_text(part)

    def append_readings(
        self, text: Text, shown: ShownReadings, *, folded: bool = True, bars: bool = False
    ) -> None:
        """Append the groups of the readings.

        Args:
            text: to which they are appended.
            shown: the readings.
            folded: the joints share a line.
            bars: forces and torques also have a bar for each axis.
        """
        if shown.old and shown.readings:
            self.line(text, "", Text(shown.old, tint(self.app, "warning")))
        for group in instruments.groups(shown.readings, shown.units, folded=folded):
            words = Text()
            axes = (
                [name for name in (figure.name for figure in group.figures) if name in FULL] if bars else []
            )
            figures = tuple(figure for figure in group.figures if figure.name not in axes)
            if group.label == "force":
                self._force(words, shown, Group(group.label, figures))
            else:
                self._figures(words, figures, "" if not shown.old else tint(self.app, "muted"))
            self.line(text, group.label, words)
            for name in axes:
                self.line(text, name, self._bar(name, shown))

    def _figures(self, words: Text, figures: tuple[Figure, ...], style: str | Style) -> None:
        muted = tint(self.app, "muted")
        for figure in figures:
            if words:
                words.append(" ")
            if figure.name:
                words.append(f"{seen(figure.name)}{TIE}", muted)
            words.append(figure.text.replace(" ", TIE), style)
            if figure.unit:
                words.append(f"{TIE}{seen(figure.unit).replace(' ', TIE)} ", muted)
        words.rstrip()

    def _force(self, words: Text, shown: ShownReadings, group: Group) -> None:
        """Draw the size of the force: what it was, as a line of bars; what it is; the largest one."""
        muted = tint(self.app, "muted")
        size = instruments.size(shown.readings)
        figures = group.figures
        if size is not None:
            total, *rest = figures
            parts = [one for one in rest if one.name != instruments.PEAK]
            peaks = [one.text for one in rest if one.name == instruments.PEAK]
            peaks = peaks or ([readable.figure(max(shown.past), "N")[0]] if shown.past else [])
            style = muted if shown.old else self._alarm(size, FULL_FORCE)
            if shown.past:
                words.append(instruments.bars(shown.past[-SPARK:], 0.0, FULL_FORCE).rjust(SPARK), style)
                words.append(" ")
            words.append(total.text, style)
            words.append(f"{TIE}{total.unit}  ", muted)
            words.append("".join(f"peak{TIE}{peak}   " for peak in peaks))
            figures = tuple(parts)
        self._figures(words, figures, muted if shown.old or size is not None else "")
        words.rstrip()

    def _alarm(self, value: float, full: float) -> Style:
        share = abs(value) / full
        return tint(self.app, "error" if share >= ALARM else "warning" if share >= WARN else "primary")

    def _bar(self, name: str, shown: ShownReadings) -> Text:
        """Return the bar of one axis, with its figure."""
        value, full = shown.readings[name], FULL[name]
        style = tint(self.app, "muted") if shown.old else self._alarm(value, full)
        half = min(max((self.size.width - LABEL - BESIDE) // 2, 2), instruments.HALF)
        left, right = instruments.bar(value, full, half)
        figure, unit = readable.figure(value, instruments.unit_of(name, shown.units))
        strong = "bold" if abs(value) < WARN * full and not shown.old else style
        return Text.assemble(
            (left, style), ("│", tint(self.app, "muted")), (right, style), (f" {figure:>6} {unit}", strong)
        )


class Readings(Lines):
    """The readings of a robot or a view, with a bar for each axis of its force."""

    def draw(self, shown: ShownReadings) -> None:
        """Draw these readings."""
        text = Text()
        if shown.readings:
            self.append_readings(text, shown, bars=True)
        else:
            text.append("no readings yet", tint(self.app, "muted"))
        self.show(text)
