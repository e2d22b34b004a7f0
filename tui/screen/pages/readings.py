"""Readings over time: which are watched on the left, their plots on the right.

What is ticked is remembered from then on, also while another page is in front; readings of robots that nobody
has ticked are not kept. Of a plot only lines that differ are drawn again.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import degrees
from typing import NamedTuple, cast

from rich.cells import cell_len
from rich.segment import Segment
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.row_list import Row, RowList
from robotree.tui.seen import instruments, plotting
from robotree.tui.seen.cells import seen
from robotree.tui.seen.plotting import Canvas, Curve, Frame
from robotree.tui.seen.series import Reading, Series, named
from robotree.tui.seen.streams import STREAM, numbers_of
from robotree.tui.seen.watched import Alarm
from robotree.vr.base.readable import IN_DEGREES, apart, entered, figure, finest

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


PLOTS = 4
"""Plots at a time."""
RATE = 5.0
"""[Hz] of the plots."""
SLOW = 1.0
"""[Hz] of the plots on a slow line."""
WINDOWS = (5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0)
"""[s] that can be shown."""
AGE = "age"
"""The reading that comes last: how old the others are."""
SPARK = 10
"""Cells of a sparkline."""


class ReadingsPage(Page):
    """The readings that a person watches, and those of the selected robot."""

    KEYS_OF = "readings"

    def __init__(self) -> None:
        """Show the last half minute."""
        super().__init__()
        self.window = 30.0
        self.end: float | None = None
        """[s] on the store's clock, at the right edge; None: now."""
        self.is_against = False

    def parts(self) -> ComposeResult:
        """List and plots."""
        with Horizontal(classes="columns"):
            with Vertical(id="readings-side"):
                yield RowList(id="readings-list", compact=True)
                yield CachedText(id="readings-alarms")
            with Vertical(id="plots"):
                yield CachedText(id="plots-note")
                for _ in range(PLOTS):
                    yield Plot()

    def on_mount(self) -> None:
        """Begin to draw."""
        self.query_one(RowList).focus()
        self.set_interval(1 / (SLOW if self.app.calm else RATE), self.guarded(self._plot))

    def title_of_page(self) -> str:
        """Say what is shown."""
        shown = f"readings  {self.window:.0f} s"
        if self.end is not None:
            shown += f", frozen {self.app.now() - self.end:.0f} s ago"
        return shown

    # -- what is chosen ----------------------------------------------------------------------------

    @property
    def chosen(self) -> Reading | None:
        """The reading under the cursor."""
        return cast("Reading | None", self.query_one(RowList).chosen)

    def _wanted(self) -> tuple[Reading, ...]:
        """Return the readings that are listed: those that are ticked, then those of the selected robot."""
        store, selected = self.app.store, self.app.selection.name
        ticked = tuple(store.watched.ticked.series)
        own = ((store.source_of(selected, name), name) for name in store.readings(selected))
        ordered = sorted(own, key=lambda one: (one[1] == AGE, one))
        described = store.described(selected)
        sent = ((selected, name) for name in (numbers_of(described) if described else ()))
        return (*ticked, *(one for one in (*ordered, *sent) if one[0] and one not in ticked))

    # -- keys --------------------------------------------------------------------------------------

    @on(RowList.OptionSelected)
    def action_tick(self) -> None:
        """Watch the reading under the cursor, or end that."""
        reading = self.chosen
        if reading is None:
            self.app.tell(
                "no reading is here: select a robot that has some, in the list of robots", "warning"
            )
            return
        self.app.watching.tick(reading)
        self.draw()
        self._plot()

    def action_freeze(self) -> None:
        """Stand still, or go on."""
        self.end = self.app.now() if self.end is None else None
        self._plot()

    def action_scroll(self, way: int) -> None:
        """Look back by half of what is shown, or forward; at the present the plots go on."""
        now = self.app.now()
        end = (now if self.end is None else self.end) + way * self.window / 2
        began = [one.began for one in self.app.store.watched.ticked.series.values() if one.began is not None]
        self.end = max(end, min(began, default=now)) if end < now else None
        self._plot()

    def action_zoom(self, way: int) -> None:
        """Show a longer time, or a shorter one."""
        at = min(range(len(WINDOWS)), key=lambda number: abs(WINDOWS[number] - self.window))
        self.window = WINDOWS[min(max(at + way, 0), len(WINDOWS) - 1)]
        self._plot()

    def action_against(self) -> None:
        """Draw two readings against each other, or over time."""
        if not self.is_against and len(self.app.store.watched.ticked.series) < 2:
            self.app.tell("tick two readings first: one is drawn against the other", "warning")
            return
        self.is_against = not self.is_against
        self._plot()

    def action_alarm(self) -> None:
        """Begin to type the threshold."""
        if (reading := self.chosen) is None:
            self.app.tell("no reading is here", "warning")
        elif reading[1].startswith(STREAM):
            self.app.tell(
                "an alarm judges readings of a robot; a stream is heard only while it is ticked", "warning"
            )
        else:
            self.open_line("verb", f"alarm above {named(reading)} ")

    def action_acknowledge(self) -> None:
        """Acknowledge the alarm of the reading, or all."""
        reading, open_ones = self.chosen, {one.name for one in self.app.store.watched.open()}
        if reading is not None and named(reading) in open_ones:
            self.app.do("alarm ack", **{"ROBOT.READING": named(reading)})
        elif open_ones:
            self.app.do("alarm ack")
        else:
            self.app.tell("no alarm waits to be acknowledged")

    # -- drawing -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw the list; the plots have a clock of their own."""
        super().draw()
        if not self.is_mounted:
            return
        choices = self.query_one(RowList)
        choices.fill(Row(reading, self._row(reading)) for reading in self._wanted())
        entitle(choices, "ticked, and of " + (seen(self.app.selection.name) or "no robot"))
        alarms = [one for one in self.app.store.watched.alarms.values() if one.state != "calm"]
        text = Text("\n").join(
            Text(self._alarm_words(one), tint(self.app, "error" if one.open else "warning")) for one in alarms
        )
        shown = self.query_one("#readings-alarms", CachedText)
        shown.display = bool(alarms)
        shown.show(text)

    def _alarm_words(self, alarm: Alarm) -> str:
        """Write an alarm in one short line: the list of alarms (`alarms`) says more."""
        return f"{alarm.state} {seen(alarm.name)} {alarm.sign} {entered(alarm.limit, alarm.unit)}"

    def _row(self, reading: Reading) -> Text:
        store, muted = self.app.store, tint(self.app, "muted")
        series = store.watched.ticked.series.get(reading)
        state = store.state(reading[0])
        value = state.readings.get(reading[1]) if state else None
        value = series.latest if value is None and series is not None else value
        unit = self._unit(reading)
        alarm = store.watched.alarms.get(named(reading))
        limit = entered(alarm.limit, alarm.unit) if alarm else ""
        text = "-" if value is None else " ".join(figure(value, unit)).strip()
        if alarm is not None and value is not None:
            text, _ = apart(value, alarm.limit, unit)
        line = Text.assemble(
            ("■ " if series is not None else "□ ", tint(self.app, "accent") if series is not None else muted),
            f"{seen(named(reading))}  ",
            (text, "bold"),
        )
        if series is not None:
            line.append(f"  {series.sparkline(SPARK)}", tint(self.app, "accent"))
        if alarm is not None:
            style = "error" if alarm.open else "warning" if alarm.active else "muted"
            line.append(f"  {alarm.sign} {limit}" + (f" {alarm.state}" if alarm.state != "calm" else ""),
                        tint(self.app, style))  # fmt: skip
        return line

    def _unit(self, reading: Reading) -> str:
        robot = self.app.store.described(reading[0])
        if robot and reading[1].startswith(STREAM):
            return numbers_of(robot).get(reading[1], "")
        return instruments.unit_of(reading[1], robot.units if robot else {})

    def _plot(self) -> None:
        """Draw the plots of the ticked readings, with that under the cursor among them."""
        if not self.is_active or not self.is_mounted:
            return
        ticked = self.app.store.watched.ticked.series
        readings, now = list(ticked), self.app.now()
        end = now if self.end is None else self.end
        wall = self.app.wall() - (now - end)
        plots = list(self.query(Plot))
        first = self._first(readings)
        shown = readings[first : first + PLOTS]
        note = self.query_one("#plots-note", CachedText)
        note.display = not shown
        if not shown:
            key = self.app.keymap.spelled("readings.tick")
            note.show(Text(f"\n  Nothing is ticked yet. {key} ticks a reading; it is drawn from then on.",
                           tint(self.app, "muted")))  # fmt: skip
        pair = self._pair(readings)
        if self.is_against and pair:
            for number, plot in enumerate(plots):
                plot.display = number == 0
            one, other = (Shown(each, ticked[each], self._unit(each)) for each in pair)
            plots[0].draw_against(one, other, end, self.window)
            return
        for number, plot in enumerate(plots):
            plot.display = number < len(shown)
            if number < len(shown):
                reading = shown[number]
                alarm = self.app.store.watched.alarms.get(named(reading))
                limits = (alarm.limit,) if alarm else ()
                drawn = Shown(reading, ticked[reading], self._unit(reading))
                plot.draw(drawn, end, self.window, limits=limits, wall=wall)

    def _first(self, readings: list[Reading]) -> int:
        at = readings.index(self.chosen) if self.chosen in readings else 0
        return max(min(at - PLOTS + 1, len(readings) - PLOTS), 0)

    def _pair(self, readings: list[Reading]) -> tuple[Reading, Reading] | None:
        """Return the two that are drawn against each other: that under the cursor, and the one before it."""
        if len(readings) < 2:
            return None
        at = max(readings.index(self.chosen), 1) if self.chosen in readings else 1
        return readings[at - 1], readings[at]
