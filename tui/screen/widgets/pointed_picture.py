"""A picture in which one points: a cursor, the point of the workspace under it, the way that leads there."""

from __future__ import annotations

from itertools import pairwise

from rich.segment import Segment
from rich.style import Style
from textual.events import Click
from textual.strip import Strip

from robotree.tui.screen.foresight import Foreseen
from robotree.tui.screen.widgets.cached_text import entitle
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import RATE, PictureView
from robotree.tui.screen.widgets.pointing import Pointing
from robotree.tui.seen.geometry import LEVEL, Point, on_plane, seen_at
from robotree.tui.seen.plan import CURSOR, GOAL, REFUSED, STEP

PARTS = 8
"""Signs that are drawn between two points of a way."""


class PointedPicture(PictureView, Pointing, can_focus=True):
    """Shows a camera; the point under the cursor is where the view meets a level plane of the workspace."""

    def __init__(self, *, id: str | None = None, rate: float = RATE) -> None:  # noqa: A002 # Textual's name for it
        """Show nothing yet."""
        super().__init__(id=id, rate=rate)
        self.of: tuple[str, str] = ("", "")
        """View and camera."""
        self.ground = ""
        """Name of the frame in which the camera is; empty: nobody knows."""
        self.level = 0.0
        """[m] of the plane that is pointed at, above the origin of that frame."""
        self._at: tuple[float, float] | None = None
        """How far across and down the picture the cursor is, 0 to 1; None: there is none."""
        self._signs: dict[tuple[int, int], tuple[str, str]] = {}

    # -- what is pointed at ------------------------------------------------------------------------

    @property
    def has_cursor(self) -> bool:
        """Whether somebody points here (`Pointing`)."""
        return self._at is not None

    @property
    def point(self) -> dict[str, float] | None:
        """The point under the cursor [m], in `ground`: x and y, and z where the plane is not the floor."""
        found = self._point
        if found is None:
            return None
        return {"x": found[0], "y": found[1]} | ({"z": found[2]} if self.level else {})

    @property
    def _point(self) -> Point | None:
        if self._at is None or self.lens is None:
            return None
        return on_plane(self.lens, *self._at, self.aspect, self.level)

    @property
    def why_no_point(self) -> str:
        """Why nothing can be pointed at here, as a sentence."""
        if self.lens is None:
            return "this camera does not say where it is, so a point in its picture is no place"
        return "nothing is there at this level: point lower, or choose a lower level with -"

    def forget(self) -> None:
        """Point at nothing."""
        self._at = None

    # -- keys --------------------------------------------------------------------------------------

    def action_cursor(self, across: int, down: int) -> None:
        """Move the cursor by so many cells; the first time it comes to the middle."""
        field = self.field
        if not field.area:
            return
        x, y = self._at or (0.5, 0.5)
        if self._at is not None:
            x, y = x + across / field.width, y + down / field.height
        self._point_at(min(max(x, 0.0), 1.0), min(max(y, 0.0), 1.0))

    def action_zoom(self, steps: int) -> None:
        """Raise the plane that is pointed at, or lower it; 0: the floor."""
        self.level = round(self.level + steps * LEVEL, 3) if steps else 0.0
        self.draw()
        self.post_message(self.Pointed(self))

    def on_click(self, event: Click) -> None:
        """Point to where it was clicked; a click on the cursor chooses."""
        field = self.field
        if not field.contains(event.x, event.y):
            return
        if (event.x, event.y) == self._cell(self._at):
            self.post_message(self.Chosen(self))
        else:
            self._point_at((event.x - field.x + 0.5) / field.width, (event.y - field.y + 0.5) / field.height)

    def _point_at(self, across: float, down: float) -> None:
        self._at = across, down
        self.draw()
        self.post_message(self.Pointed(self))

    def _cell(self, at: tuple[float, float] | None) -> tuple[int, int] | None:
        """Return the cell of a place of the picture; None: it is not in it."""
        field = self.field
        if at is None or not field.area:
            return None
        column, row = int(at[0] * field.width), int(at[1] * field.height)
        column, row = column - (at[0] == 1.0), row - (at[1] == 1.0)
        if not (0 <= column < field.width and 0 <= row < field.height and min(at) >= 0.0):
            return None
        return field.x + column, field.y + row

    # -- drawing -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw cursor and way where they are now; nothing, if they are where they were."""
        newest, signs = self.app.foresight.newest, dict[tuple[int, int], tuple[str, str]]()
        if newest is not None and newest.frame == self.ground and self.lens is not None:
            self._draw_way(newest, signs)
        cell = self._cell(self._at)
        if cell is not None:
            signs[cell] = CURSOR, "cursor"
        if signs != self._signs:
            self._signs = signs
            self.refresh()
        entitle(self, self.border_title_words, self._words)

    @property
    def border_title_words(self) -> str:
        """Name of the camera, where several are shown."""
        return " / ".join(filter(None, self.of))

    @property
    def _words(self) -> str:
        if self._at is None:
            return ""
        found, newest = self._point, self.app.foresight.newest
        if found is None:
            return self.why_no_point
        words = f"x {found[0]:.2f}  y {found[1]:.2f}" + (f"  level {self.level:.2f}" if self.level else "")
        known = newest is not None and newest.frame == self.ground
        return f"{words}  {newest.words}" if newest is not None and known else words

    def marks(self) -> list[tuple[float, float]]:
        """Return where the cursor is, for pictures in sixels."""
        return [] if self._at is None else [self._at]

    def _draw_way(self, newest: Foreseen, signs: dict[tuple[int, int], tuple[str, str]]) -> None:
        tone = "error" if newest.refusal else "accent"
        points = newest.points
        for one, other in pairwise(points):
            for part in range(PARTS):
                share = part / PARTS
                x, y, z = (a + share * (b - a) for a, b in zip(one, other, strict=True))
                self._put(signs, (x, y, z), STEP, tone)
        self._put(signs, newest.goal, REFUSED if newest.refusal else GOAL, tone)

    def _put(self, signs: dict[tuple[int, int], tuple[str, str]], point: Point, sign: str, tone: str) -> None:
        if self.lens is not None and (cell := self._cell(seen_at(self.lens, point, self.aspect))):
            signs[cell] = sign, tone

    def render_line(self, y: int) -> Strip:
        """Draw a line of the picture, and over it what is pointed at."""
        strip = super().render_line(y)
        for (column, row), (sign, tone) in sorted(self._signs.items()):
            if row == y:
                width = strip.cell_length
                over = Strip([Segment(sign, self._over(strip, column, tone))], 1)
                strip = Strip.join([strip.crop(0, column), over, strip.crop(column + 1, width)])
        return strip

    def _over(self, strip: Strip, column: int, tone: str) -> Style:
        """Return the style of a sign over a cell of the picture."""
        below = next(iter(strip.crop(column, column + 1)), None)
        ground = Style() if below is None or below.style is None else below.style
        if tone == "cursor":
            return Style(color="bright_white", bgcolor=ground.bgcolor, bold=True, reverse=True)
        return Style(color=tint(self.app, tone).color, bgcolor=ground.bgcolor, bold=True)
