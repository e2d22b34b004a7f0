"""The program of a panel's process: an app of Textual without a terminal, which sends what it would draw.

The limits of the kernel are those of robots apart (`vr/isolation/confine.py`): it reads no files but those of
Python and its libraries, writes none, starts nothing, and has one socket.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import inspect
import itertools
import os
import socket
import sys
import tempfile
from collections.abc import Mapping
from typing import Any, ClassVar

from rich.color import Color, ColorType
from rich.style import Style
from textual import events, widgets
from textual.app import App, ComposeResult
from textual.binding import BindingType
from textual.geometry import Size
from textual.strip import Strip

from robotree.tui.panels import frames
from robotree.tui.panels.author import Refused, RobotPanel
from robotree.vr.base.errors import VrError
from robotree.vr.bundle import loader
from robotree.vr.isolation.confine import confine, end_with_parent
from robotree.vr.isolation.pipe import HEAD

BEAT = 0.5
"""[s] between two signs of life."""
_ATTRIBUTES = (
    ("bold", frames.BOLD),
    ("dim", frames.DIM),
    ("italic", frames.ITALIC),
    ("underline", frames.UNDERLINE),
    ("reverse", frames.REVERSE),
    ("strike", frames.STRIKE),
)


class PanelApp(App[None]):
    """Shows one panel over the whole of its region."""

    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = []

    def __init__(self, begin: frames.BeginPanel, send: Any, lacks: list[str]) -> None:
        """Make the panel.

        Args:
            begin: what the screen has said.
            send: sends a frame to the screen.
            lacks: what the kernel does not limit.

        Raises:
            VrError: the source is no panel; says why.
        """
        super().__init__()
        self.theme = "textual-dark" if begin.dark else "textual-light"
        self._send, self._lacks = send, lacks
        self._numbers = itertools.count(1)
        self._open: dict[int, asyncio.Future[Any]] = {}
        self._drawn: dict[int, list[frames.Span]] = {}
        self.panel = panel_class(begin)(begin.robot, self)

    def compose(self) -> ComposeResult:
        """Show the panel, and nothing else."""
        yield self.panel

    def on_mount(self) -> None:
        """Tell the screen that the panel is there, and that it lives."""
        self._send(frames.PanelUp(str(type(self.panel).TITLE)[:200], self._lacks))
        self.set_interval(BEAT, lambda: self._send(frames.PanelAlive()))

    def post_display_hook(self) -> None:
        """Send the lines that look otherwise than before."""
        if not self.screen_stack:
            return
        lines = self.screen._compositor.render_strips()  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] # no public way
        changed = {
            row: spans for row, spans in enumerate(map(_spans, lines)) if self._drawn.get(row) != spans
        }
        if changed:
            self._drawn |= changed
            self._send(frames.DrawnLines(changed))

    async def carry_out(self, command: str, arguments: Mapping[str, Any]) -> Any:
        """Ask for a command of the robot, and wait for its result."""
        number, done = self._waits()
        self._send(frames.AskCommand(number, command, dict(arguments)))
        return await done

    async def look(self, view: str, camera: str, width: int, height: int) -> bytes:
        """Ask for a picture, and wait for it."""
        number, done = self._waits()
        self._send(frames.AskPicture(number, view, camera, width, height))
        return bytes(await done)

    def _waits(self) -> tuple[int, asyncio.Future[Any]]:
        number, done = next(self._numbers), asyncio.get_running_loop().create_future()
        self._open[number] = done
        return number, done

    def take(self, frame: frames.ToPanel) -> None:
        """Take what the screen says."""
        match frame:
            case frames.SeeReadings(values=values, units=units, status=status):
                self.panel.readings, self.panel.units, self.panel.status = values, units, status
                self.panel.call_later(self.panel.see)
            case frames.PressKey(key=key, character=character):
                self._put(events.Key(key, character))
            case frames.UseMouse():
                self._put(_mouse(frame))
            case frames.ChangeSize(width=width, height=height):
                self._change_size(Size(width, height))
            case (
                frames.CallDone(number=number, value=value, refusal=refusal)
                | frames.PictureSeen(number=number, jpeg=value, refusal=refusal)
            ):
                done = self._open.pop(number, None)
                if done is not None and not done.done():
                    done.set_exception(Refused(reason=refusal)) if refusal else done.set_result(value)
            case _:
                pass

    def _change_size(self, size: Size) -> None:
        self._drawn = {}
        if self._driver is not None:
            self._driver._size = size  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] # as Textual's pilot
        self.post_message(events.Resize(size, size))

    def _put(self, event: events.Event) -> None:
        if self._driver is not None:
            self._driver.process_message(event)


def _mouse(frame: frames.UseMouse) -> events.MouseEvent:
    sorts: dict[str, type[events.MouseEvent]] = {
        "down": events.MouseDown,
        "up": events.MouseUp,
        "scroll_up": events.MouseScrollUp,
        "scroll_down": events.MouseScrollDown,
    }
    place = (frame.x, frame.y)
    return sorts[frame.what](None, *place, 0, 0, frame.button, False, False, False, *place)  # Textual's


def panel_class(begin: frames.BeginPanel) -> type[RobotPanel]:
    """Return the class of a panel.

    Raises:
        VrError: the source cannot be loaded, or has not one such class.
    """
    digest = hashlib.sha256(begin.source.encode()).hexdigest()
    module = loader.load_module(begin.source, begin.path, digest, files=begin.files)
    found = [
        one
        for one in vars(module).values()
        if inspect.isclass(one) and issubclass(one, RobotPanel) and one.__module__ == module.__name__
    ]
    if len(found) != 1:
        raise VrError(detail=f"it has {len(found)} classes that derive from RobotPanel, and one is needed")
    return found[0]


def _spans(line: Strip) -> list[frames.Span]:
    return [
        (segment.text, *_colours(segment.style)) for segment in line if segment.text and not segment.control
    ]


def _colours(style: Style | None) -> tuple[int, int, int]:
    if style is None:
        return frames.NO_COLOUR, frames.NO_COLOUR, 0
    attributes = sum(bit for name, bit in _ATTRIBUTES if getattr(style, name))
    return _number(style.color), _number(style.bgcolor, behind=True), attributes


def _number(colour: Color | None, *, behind: bool = False) -> int:
    if colour is None or colour.type is ColorType.DEFAULT:
        return frames.NO_COLOUR
    red, green, blue = colour.get_truecolor(foreground=not behind)
    return red << 16 | green << 8 | blue


def main(descriptor: int, parent: int) -> None:
    """Be the panel for which the screen asks through this socket, until one of them ends."""
    end_with_parent(parent)
    with contextlib.suppress(OSError):
        os.nice(5)  # a panel that computes takes nothing from the screen
    names = ("Button", "Input", "Label", "Static", "ProgressBar", "Sparkline", "Digits", "Select", "Switch")
    for name in names:
        getattr(widgets, name)  # before there are limits: quicker than with them
    room = sys.argv[2] if len(sys.argv) > 2 else ""  # the program, its descriptor, the folder
    tempfile.tempdir = room or None
    lacks = confine([room] if room else [])
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_live(socket.socket(fileno=descriptor), lacks))
    os._exit(0)


async def _live(own: socket.socket, lacks: list[str]) -> None:
    reader, writer = await asyncio.open_connection(sock=own, limit=2**24)

    def send(frame: frames.PanelFrame) -> None:
        writer.write(frames.packed(frame))

    begin = await _next(reader)
    if not isinstance(begin, frames.BeginPanel):
        return
    try:
        app = PanelApp(begin, send, lacks)
    except Exception as error:  # noqa: BLE001 # the screen is told
        await _fail(writer, error)
        return
    running = asyncio.ensure_future(app.run_async(headless=True, size=(begin.width, begin.height)))
    hearing = asyncio.ensure_future(_hear(reader, app))
    done, _ = await asyncio.wait([running, hearing], return_when=asyncio.FIRST_COMPLETED)
    if running in done:
        fault = app._exception or running.exception()  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] # no public way
        await _fail(writer, fault or VrError(detail="it has ended by itself"))


async def _fail(writer: asyncio.StreamWriter, error: BaseException) -> None:
    said = str(error) if isinstance(error, VrError) else f"{type(error).__name__}: {error}"
    writer.write(frames.packed(frames.PanelFailed(" ".join(said.split())[:400])))
    with contextlib.suppress(OSError):
        await writer.drain()
        writer.close()
        await writer.wait_closed()


async def _hear(reader: asyncio.StreamReader, app: PanelApp) -> None:
    while (frame := await _next(reader)) is not None:
        app.take(frame)


async def _next(reader: asyncio.StreamReader) -> frames.ToPanel | None:
    try:
        (size,) = HEAD.unpack(await reader.readexactly(HEAD.size))
        return frames.to_panel.decode(await reader.readexactly(size))
    except (asyncio.IncompleteReadError, OSError):
        return None


if __name__ == "__main__":
    main(int(sys.argv[1]), os.getppid())
