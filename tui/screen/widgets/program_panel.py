"""The region of a panel that is a program: shows what its process draws, and gives it keys and clicks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.segment import Segment
from rich.style import Style
from textual.events import Key, MouseDown, MouseEvent, MouseScrollDown, MouseScrollUp, MouseUp, Resize
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from robotree.tui.panels import frames
from robotree.tui.panels.outside import PanelProcess
from robotree.tui.screen.part import Part
from robotree.tui.terminal import STEERING
from robotree.vr.base.description import RobotDescription
from robotree.vr.supervision.panels import ProgramSource

LIMIT = 120.0
"""[s] that a command of a panel may take."""
SMALLEST = 8
"""[cells] width and height below which nothing is drawn."""
_OURS = ("escape", "ctrl+", "f1", "f2", "f3", "f4", "f5", "f6", "f7", "f8", "f9", "f10", "f11", "f12")
"""How keys begin that are the screen's, whatever has the focus."""


class ProgramPanel(Part, Widget):
    """See the module."""

    DEFAULT_CSS = "ProgramPanel { width: 1fr; height: 1fr; }"
    can_focus = True

    class Ended(Message):
        """There is no panel any more."""

        def __init__(self, panel: ProgramPanel, reason: str) -> None:
            """Say why, as a clause."""
            super().__init__()
            self.panel, self.reason = panel, reason

    def __init__(self, program: ProgramSource, robot: RobotDescription) -> None:
        """Show a panel of a robot, from the first moment at which there is room for it."""
        super().__init__(classes="form own-panel")
        self._program, self._robot = program, robot
        self._process: PanelProcess | None = None
        self._lines: dict[int, Strip] = {}
        self._told: frames.SeeReadings | None = None
        self.up = False
        """Whether the panel is there."""

    # -- its life ----------------------------------------------------------------------------------

    def on_resize(self, event: Resize) -> None:
        """Start the process, or tell it how much room there is."""
        width, height = event.size
        if width < SMALLEST or height < 1:
            return
        if self._process is not None:
            self._process.send(frames.ChangeSize(width, height))
            return
        program = self._program
        begin = frames.BeginPanel(
            source=program.source,
            path=program.path,
            files=dict(program.files),
            robot=self._robot,
            width=width,
            height=height,
            dark=self.app.current_theme.dark,
        )
        self._process = PanelProcess(begin, program.permissions, self)

    def on_unmount(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.close()

    def be_up(self, frame: frames.PanelUp) -> None:
        """Take note that the panel is there."""
        self.up = True
        if frame.title:
            self.border_title = Segment(_plain(frame.title)).text
        for lack in frame.lacks:
            self.app.tell(f"the panel of {self._robot.name}: {lack}", "warning")
        if self._told is not None and self._process is not None:
            self._process.send(self._told)

    def be_over(self, reason: str) -> None:
        """Take note that there is no panel any more."""
        self.post_message(self.Ended(self, reason))

    async def carry_out(self, command: str, arguments: Mapping[str, Any]) -> Any:
        """Carry out a command for the panel."""
        return await self.app.realm_client.call(self._robot.name, command, arguments, deadline=LIMIT)

    async def look(self, view: str, camera: str, width: int, height: int) -> bytes:
        """Fetch a picture for the panel."""
        picture = await self.app.realm_client.look(view, camera=camera, width=width, height=height)
        return picture.jpeg

    # -- what it shows -----------------------------------------------------------------------------

    def draw(self, readings: Mapping[str, float], units: Mapping[str, str], status: str) -> None:
        """Tell the panel what the robot reads."""
        told = frames.SeeReadings(dict(readings), dict(units), status)
        if told != self._told:
            self._told = told
            if self._process is not None and self.up:
                self._process.send(told)

    def draw_lines(self, lines: Mapping[int, list[frames.Span]]) -> None:
        """Show lines that look otherwise now, within the region."""
        width, height = self.size
        for row, spans in lines.items():
            if row < height:
                self._lines[row] = _strip(spans, width)
        self.refresh()

    def render_line(self, y: int) -> Strip:
        """Draw one line as the panel has sent it, within the region."""
        strip = self._lines.get(y, Strip.blank(self.size.width))
        return strip.adjust_cell_length(self.size.width, self.rich_style)

    # -- what it hears -----------------------------------------------------------------------------

    def on_key(self, event: Key) -> None:
        """Give a key to the panel; those that leave it, and the stop, are not its own."""
        if self._process is None or not self.up or event.key.startswith(_OURS):
            return
        event.stop()
        event.prevent_default()
        self._process.send(frames.PressKey(event.key, event.character))

    def on_mouse_down(self, event: MouseDown) -> None:
        """Give a click to the panel."""
        self.focus()
        self._use("down", event)

    def on_mouse_up(self, event: MouseUp) -> None:
        """See `on_mouse_down`."""
        self._use("up", event)

    def on_mouse_scroll_up(self, event: MouseScrollUp) -> None:
        """See `on_mouse_down`."""
        self._use("scroll_up", event)

    def on_mouse_scroll_down(self, event: MouseScrollDown) -> None:
        """See `on_mouse_down`."""
        self._use("scroll_down", event)

    def _use(self, what: Any, event: MouseEvent) -> None:
        event.stop()
        if self._process is not None and self.up:
            place = event.get_content_offset_capture(self)
            self._process.send(frames.UseMouse(what, place.x, place.y, event.button))


def _plain(text: str) -> str:
    return STEERING.sub("", text)


def _strip(spans: list[frames.Span], width: int) -> Strip:
    """Return a line as it may be shown: nothing in it steers the terminal, and it ends with the region."""
    segments = [Segment(_plain(text), _style(colour, behind, bits)) for text, colour, behind, bits in spans]
    return Strip(segments).crop(0, width)


def _style(colour: int, behind: int, bits: int) -> Style:
    return Style(
        color=_hex(colour),
        bgcolor=_hex(behind),
        bold=bool(bits & frames.BOLD),
        dim=bool(bits & frames.DIM),
        italic=bool(bits & frames.ITALIC),
        underline=bool(bits & frames.UNDERLINE),
        reverse=bool(bits & frames.REVERSE),
        strike=bool(bits & frames.STRIKE),
    )


def _hex(number: int) -> str | None:
    return f"#{number:06x}" if 0 <= number <= 0xFFFFFF else None
