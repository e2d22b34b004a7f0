"""A panel as its author has laid it out: words, figures, bars, plots, pictures, buttons and forms."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from functools import partial

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import VerticalScroll
from textual.message import Message
from textual.strip import Strip
from textual.widgets import Button, Label

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen import instruments
from robotree.tui.seen.cells import seen
from robotree.vr.base.description import RobotDescription
from robotree.vr.bundle.panel import (
    BarPart,
    ButtonPart,
    FormPart,
    Panel,
    PicturePart,
    PlotPart,
    ReadingPart,
    TextPart,
)

CELLS = 24
"""Of a bar, and of a plot."""
QUALITY = 60
"""Of a picture (JPEG)."""
MARK = "✛"


class LaidOut(Part, VerticalScroll):
    """Draws a panel; asks the page to have its commands carried out."""

    class Pressed(Message):
        """A button was pressed."""

        def __init__(self, part: ButtonPart) -> None:
            """Carry what it stands for."""
            super().__init__()
            self.part = part

    def __init__(self, panel: Panel, robot: RobotDescription, readings: Mapping[str, float]) -> None:
        """Lay out a panel of a robot, with what that reads now."""
        super().__init__(classes="form", can_focus=False)
        self.panel, self.robot = panel, robot
        self._readings = dict(readings)
        self._past: dict[int, deque[tuple[float, float]]] = {}
        """When, and what, by the number of a plot's part."""

    def compose(self) -> ComposeResult:
        """One widget for each part."""
        for number, part in enumerate(self.panel.parts):
            match part:
                case TextPart(text=text):
                    yield Label(seen(text), classes="form-doc", markup=False)
                case ButtonPart():
                    label = Text(f"▶ {seen(part.label or part.command)}")
                    yield Button(label, id=f"part-{number}", variant="primary", compact=True)
                case FormPart(command=name) if (spec := self.robot.command(name)) is not None:
                    yield CommandForm(self.robot.name, spec, self._readings)
                case PicturePart():
                    yield MarkedPicture(part, id=f"part-{number}")
                case _:
                    yield CachedText(id=f"part-{number}")

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        number = (event.button.id or "").removeprefix("part-")
        part = self.panel.parts[int(number)] if number.isdecimal() else None
        if isinstance(part, ButtonPart):
            event.stop()
            self.post_message(self.Pressed(part))

    def draw(self, readings: Mapping[str, float], units: Mapping[str, str]) -> None:
        """Show the readings of this moment."""
        if len(self.children) < len(self.panel.parts):
            return  # they are still being made
        now = self.app.now()
        for number, part in enumerate(self.panel.parts):
            match part:
                case ReadingPart() | BarPart() | PlotPart():
                    self._draw_reading(number, part, readings, units, now)
                case PicturePart(mark=mark) if mark:
                    places = [readings.get(one, math.nan) for one in mark]
                    self.query_one(f"#part-{number}", MarkedPicture).mark(places[0], places[1])
                case _:
                    pass

    def _draw_reading(
        self,
        number: int,
        part: ReadingPart | BarPart | PlotPart,
        readings: Mapping[str, float],
        units: Mapping[str, str],
        now: float,
    ) -> None:
        value = readings.get(part.reading, math.nan)
        label = seen(part.label or part.reading)
        line = Text(f"{label:<14.14} ", tint(self.app, "muted"), no_wrap=True)
        match part:
            case BarPart(low=low, high=high):
                share = 0.0 if math.isnan(value) else min(max((value - low) / (high - low), 0.0), 1.0)
                full = round(share * CELLS)
                line.append("█" * full + "░" * (CELLS - full), tint(self.app, "primary"))
            case PlotPart(seconds=seconds):
                past = self._past.setdefault(number, deque(maxlen=4000))
                if not math.isnan(value):
                    past.append((now, value))
                while past and past[0][0] < now - seconds:
                    past.popleft()
                line.append(curve([*past], now, seconds), tint(self.app, "primary"))
            case ReadingPart():
                pass
        figure = "-" if math.isnan(value) else f"{value:.4g}"
        line.append(f" {figure} {seen(units.get(part.reading, ''))}", "bold")
        self.query_one(f"#part-{number}", CachedText).show(line)


def curve(past: list[tuple[float, float]], now: float, seconds: float) -> str:
    """Return the course of a reading as one line of characters, the oldest first."""
    columns: list[list[float]] = [[] for _ in range(CELLS)]
    for when, value in past:
        at = int((when - now + seconds) / seconds * CELLS)
        columns[min(max(at, 0), CELLS - 1)].append(value)
    return instruments.bars([sum(each) / len(each) if each else math.nan for each in columns])


class MarkedPicture(PictureView):
    """The picture of a camera, with a mark where two readings say."""

    DEFAULT_CSS = "MarkedPicture { width: 1fr; height: 12; }"

    def __init__(self, part: PicturePart, *, id: str) -> None:  # noqa: A002 # Textual's name for it
        """Look through a camera."""
        super().__init__(id=id)
        self._part = part
        self._at = (math.nan, math.nan)

    def on_mount(self) -> None:
        """Begin to look."""
        part, look = self._part, self.app.realm_client.look
        self.show(partial(look, part.view, camera=part.camera, quality=QUALITY), "looking …")

    def mark(self, across: float, down: float) -> None:
        """Put the mark there: shares of the width and of the height; NaN: there is none."""
        if (across, down) != self._at and not (math.isnan(across) and math.isnan(self._at[0])):
            self._at = across, down
            self.refresh()

    def render_line(self, y: int) -> Strip:
        """Draw one line, with the mark if it is there."""
        strip, (across, down) = super().render_line(y), self._at
        width, height = self.size
        if not (0.0 <= across <= 1.0 and 0.0 <= down <= 1.0) or not width or not height:
            return strip
        if y != min(int(down * height), height - 1):
            return strip
        x = min(int(across * width), width - 1)
        cell = Strip([Segment(MARK, Style(bold=True) + tint(self.app, "error"))])
        return Strip.join([strip.crop(0, x), cell, strip.crop(x + 1)])
