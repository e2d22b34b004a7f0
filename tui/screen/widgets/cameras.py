"""Live pictures of a workspace, fetched only while somebody can see them, and the cameras to choose from."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Awaitable, Callable
from functools import lru_cache, partial
from itertools import count

from rich.color import Color
from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual import work
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from robotree.tui.screen.palette import reduced
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen.cells import clip, fit, seen
from robotree.tui.seen.graphics import DIACRITICS, Graphics, kitty, kitty_forget, placeholders, sixel
from robotree.tui.seen.halfblocks import BLOCK, Colour, Run, decode
from robotree.tui.seen.status import span
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import CameraLens, Picture

RATE = 4.0
"""[Hz] Pictures in a second: 5 cost 40 % of a core in a large terminal, 4 look alive."""

FINER = 2
"""Pixels for each cell: half of them are thrown away, with the noise of the compression."""

SMALLEST, LARGEST = 96, 480
"""[px] Width that is asked for."""

OLD = 2.0
"""[s] of age from which on it stands over a picture: younger is live."""

AGAIN = 1.0
"""[s] before a view that did not answer is asked again."""

Fetch = Callable[..., Awaitable[Picture]]
"""Fetches a picture of about this `width` and `height` [px]."""


@lru_cache(maxsize=8192)
def _style(upper: Colour, lower: Colour) -> Style:
    return Style.from_color(_rich(upper), _rich(lower))


@lru_cache(maxsize=8192)
def _rich(colour: Colour) -> Color:
    return Color.from_rgb(*colour)


_numbers = count(os.getpid() % 0x3FFF << 8 | 1)
"""Of pictures in the terminal: other programs in it have others, as far as chance allows."""


def _few(rows: list[list[Run]]) -> list[list[Run]]:
    """Return a picture in the colours of a terminal that has 256."""
    return [[(count, reduced(upper), reduced(lower)) for count, upper, lower in row] for row in rows]


class PictureView(Part, Widget):
    """Draws the pictures that `fetch` brings, one after the other; None: nothing to look at."""

    DEFAULT_CSS = "PictureView { width: 1fr; height: 1fr; }"

    def __init__(self, *, id: str | None = None, rate: float = RATE) -> None:  # noqa: A002 # Textual's name for it
        """Show nothing yet; later so many pictures a second [Hz]."""
        super().__init__(id=id)
        self._rate = rate
        self._jpeg: bytes = b""
        self._came = 0.0
        """[s] on the app's clock, when the last picture came."""
        self._trouble = ""
        """Why no picture comes any more; empty: they come."""
        self._dated: bool = False
        """Its age stands over it: it is not live."""
        self._fetch: Fetch | None = None
        self._rows: list[list[Run]] = []
        self._message = "no view is selected"
        self._drawn_for = (0, 0)
        """Size in cells for which the rows were made."""
        self.frames = 0
        """Pictures shown so far."""
        self._number = next(_numbers)
        self._in_pixels: tuple[Graphics, Region] = ("cells", Region())
        """How the present picture is drawn, and into which cells."""
        self.lens: CameraLens | None = None
        """Where the camera of the present picture was; None: it does not say."""
        self.aspect = 1.0
        """Width of that picture over its height."""

    def on_mount(self) -> None:
        """Look at the age of the picture once a second."""
        self.set_interval(1.0, self.guarded(self._grow_old))

    def show(self, fetch: Fetch | None, message: str = "no view is selected") -> None:
        """Look through another view from now on; `message` stands there until its first picture comes."""
        self._fetch, self._rows, self._message = fetch, [], message
        self._jpeg, self._trouble, self._dated, self.lens = b"", "", False, None
        if self.app.calm:
            self._message = "no pictures: this line is slow (--calm)"
        self.refresh()
        if fetch is not None:
            self._keep_looking()

    @property
    def seen(self) -> bool:
        """Whether somebody can see this widget now."""
        shown = self.is_attached and self.screen.is_active and self.size.area > 0 and self.is_on_screen
        return shown and not self.app.calm

    @property
    def _age(self) -> float:
        """[s] since the last picture came."""
        return self.app.now() - self._came

    def _grow_old(self) -> None:
        """Draw the age of a picture that is not live; the view may only be silent, without an error."""
        dated = bool(self._rows) and (bool(self._trouble) or self._age >= OLD)
        if self.seen and (dated or self._dated):
            self.refresh()
        self._dated = dated

    @work(exclusive=True, exit_on_error=False)
    async def _keep_looking(self) -> None:
        while self._fetch is not None:
            began = time.monotonic()
            pause = 1 / self._rate
            if self.seen:
                try:
                    await self._look(self._fetch)
                except (VrError, OSError) as error:
                    self._message = self._trouble = str(error)
                    self._grow_old()
                    self.refresh()
                    pause = AGAIN
            await asyncio.sleep(max(pause - (time.monotonic() - began), 0.02))

    async def _look(self, fetch: Fetch) -> None:
        columns, rows = self.size.width, self.size.height
        width = min(max(FINER * columns, SMALLEST), LARGEST)
        picture = await fetch(width=width, height=max(width * 9 // 16, 1))
        self._came = self.app.now()
        if picture.jpeg == self._jpeg and not self._dated and self._drawn_for == (columns, rows):
            return  # nothing moves: nothing is drawn
        drawn = await asyncio.to_thread(decode, picture.jpeg, columns, rows)
        pixels = await self._pixels_of(picture.jpeg, drawn)
        if fetch is self._fetch:
            if self.app.console.color_system != "truecolor":
                drawn = _few(drawn)
            self._rows, self._jpeg, self._trouble, self._dated = drawn, picture.jpeg, "", False
            self.lens, self.aspect = picture.lens, picture.width / max(picture.height, 1)
            self._drawn_for = (columns, rows)
            self.frames += 1
            self._put_pixels(pixels)

    # -- in pixels ---------------------------------------------------------------------------------

    async def _pixels_of(self, jpeg: bytes, drawn: list[list[Run]]) -> str:
        """Return what hands a picture over to the terminal in pixels; empty: it is drawn in cells."""
        able = self.app.pictures
        if able.graphics == "cells" or not drawn:
            return ""
        columns, rows = sum(count for count, _, _ in drawn[0]), len(drawn)
        if max(columns, rows) > len(DIACRITICS):
            return ""
        if able.graphics == "kitty":
            return await asyncio.to_thread(kitty, jpeg, self._number, columns, rows, tmux=able.tmux)
        width, height = able.cell
        return await asyncio.to_thread(sixel, jpeg, columns * width, rows * height, self.marks())

    def marks(self) -> list[tuple[float, float]]:
        """Return what is drawn into a picture in sixels, over which no cell can be: shares of its size."""
        return []

    def _put_pixels(self, pixels: str) -> None:
        """Draw what has come: cells that differ, and the picture into them."""
        before, field = self._in_pixels, self.field
        self._in_pixels = (self.app.pictures.graphics, field) if pixels else ("cells", field)
        if not pixels or before != self._in_pixels:
            self.refresh()  # else the cells are as they were
        if pixels:
            self.call_after_refresh(self._send, pixels)

    def _send(self, pixels: str) -> None:
        if not self.seen or self.app.driver is None:
            return
        if self.app.pictures.graphics == "sixel":
            corner = self.content_region.offset + self.field.offset
            pixels = f"\x1b7\x1b[{corner.y + 1};{corner.x + 1}H{pixels}\x1b8"
        self.app.driver.write(pixels)

    def on_unmount(self) -> None:
        """Have the terminal forget the picture."""
        able = self.app.pictures
        if self._in_pixels[0] == "kitty" and self.app.driver is not None:
            self.app.driver.write(kitty_forget(self._number, tmux=able.tmux))

    def _cells(self, row: int) -> list[Segment]:
        """Return a row of the picture: half cells, or what stands for its pixels."""
        graphics, columns = self._in_pixels[0], self.field.width
        if graphics == "kitty":
            style = Style.from_color(Color.parse(f"#{self._number:06x}"))  # by which kitty knows it
            return [Segment(cell, style) for cell in placeholders(row, columns)]
        if graphics == "sixel":
            return [Segment(" " * columns, self.rich_style)]
        return [Segment(BLOCK * count, _style(upper, lower)) for count, upper, lower in self._rows[row]]

    @property
    def field(self) -> Region:
        """The cells that the picture fills, in the widget's own; empty: there is none."""
        if not self._rows:
            return Region()
        columns = sum(count for count, _, _ in self._rows[0])
        left, top = (self.size.width - columns) // 2, (self.size.height - len(self._rows)) // 2
        return Region(max(left, 0), max(top, 0), columns, len(self._rows))

    def render_line(self, y: int) -> Strip:
        """Draw one line of cells."""
        width = self.size.width
        background = self.rich_style
        if not self._rows:
            middle = y == self.size.height // 2
            message = clip(self._message, width).center(width)[:width] if middle else " " * width
            return Strip([Segment(message, background)])
        if self._dated and y == 0:
            why = self._trouble or "its view does not answer"
            caption = clip(f" {span(self._age)} old: {why}", width)
            return Strip([Segment(fit(caption, width), background + tint(self.app, "warning"))])
        row = y - max((self.size.height - len(self._rows)) // 2, 0)
        if not 0 <= row < len(self._rows):
            return Strip.blank(width, background)
        cells = self._cells(row)
        drawn = sum(count for count, _, _ in self._rows[row])
        left = max((width - drawn) // 2, 0)
        strip = Strip([Segment(" " * left, background), *cells], left + drawn)
        return strip.adjust_cell_length(width, background)


QUALITY = 80
"""JPEG quality: above, a terminal shows no difference."""


class Cameras(CachedText):
    """Names the camera and points a picture at it."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Know no camera yet."""
        super().__init__(id=id)
        self.all: list[tuple[str, str]] = []
        """View and camera."""
        self.at = 0
        self.grounds: dict[str, str] = {}
        """By view: the name of the frame in which its cameras are."""
        self._picture: PictureView | None = None
        self._known: tuple[str, ...] | None = None

    def attach(self, picture: PictureView) -> None:
        """Point this picture from now on."""
        self._picture = picture
        self.draw()

    def draw(self) -> None:
        """Name the camera; ask the views for their cameras when other views are there."""
        views = tuple(sorted(self.app.store.views))
        if self._picture is not None and (views != self._known):
            self._known = views
            self._ask(views)
        self.show(self.label)

    @property
    def label(self) -> Text:
        """View and camera that one looks through, and how many there are."""
        muted = tint(self.app, "muted")
        if not self.all:
            return Text("no view is listed", muted)
        view, camera = self.all[self.at]
        gone = "" if view in self.app.store.views else "   not listed any more"
        return Text.assemble(
            (view, "bold"),
            (" / ", muted),
            camera,
            (f"   {self.at + 1} of {len(self.all)}", muted),
            (gone, tint(self.app, "warning")),
        )

    def turn(self, by: int = 1) -> None:
        """Look through the next camera."""
        if self.all:
            self.choose((self.at + by) % len(self.all))

    def choose(self, at: int) -> None:
        """Look through this camera; one that is not listed any more is left for good."""
        wanted = self.all[at]
        self.all = [one for one in self.all if one == wanted or one[0] in self.app.store.views]
        self.at = self.all.index(wanted)
        self._point()
        self.draw()

    @work(exclusive=True, exit_on_error=False)
    async def _ask(self, views: tuple[str, ...]) -> None:
        found: list[tuple[str, str]] = []
        for view in views:
            try:
                described = await self.app.realm_client.describe_view(view)
            except VrError as error:
                self.app.tell(str(error), "warning")
                continue
            found += [(view, camera) for camera in described.cameras or ("",)]
            self.grounds[view] = described.frame
        before = self.all[self.at] if self.all else None  # a person may have turned meanwhile
        if before and before not in found:
            found.append(before)  # its last picture stays, with its age, until a person turns to another one
        self.all = found
        self.at = found.index(before) if before else 0
        if before is None:
            self._point()
        self.draw()

    def _point(self) -> None:
        if self._picture is None:
            return
        if not self.all:
            self._picture.show(None, "no view is listed")
            return
        view, camera = self.all[self.at]
        self._picture.show(self.fetch(view, camera), f"looking through {camera or view} …")

    def fetch(self, view: str, camera: str) -> Fetch:
        """Return what fetches the pictures of a camera."""
        return partial(self.app.realm_client.look, view, camera=camera, quality=QUALITY)

    @property
    def ground(self) -> str:
        """Name of the frame in which the camera is that one looks through; empty: nobody knows."""
        return self.grounds.get(self.all[self.at][0], "") if self.all else ""


class PictureBox(Part, Vertical):
    """A picture with its camera's name in the frame, beside the selected robot."""

    def __init__(self, *, id: str | None = None, rate: float) -> None:  # noqa: A002 # Textual's name for it
        """Show so many pictures a second [Hz]."""
        super().__init__(id=id)
        self._rate = rate

    def compose(self) -> ComposeResult:
        """The name is in the frame."""
        yield Cameras(id="camera")
        yield PictureView(rate=self._rate)

    def on_mount(self) -> None:
        """Point the picture."""
        self.query_one(Cameras).display = False
        self.query_one(Cameras).attach(self.query_one(PictureView))

    def draw(self) -> None:
        """Name the camera; without a view there is no picture."""
        cameras = self.query_one(Cameras)
        cameras.draw()
        self.set_class(self.app.calm or not cameras.all, "-nothing")
        entitle(self, seen(cameras.label.plain))

    def turn(self) -> None:
        """Look through the next camera."""
        self.query_one(Cameras).turn()
        self.draw()
