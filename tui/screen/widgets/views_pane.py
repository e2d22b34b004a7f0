"""The views: which there are, what their instruments read, and the pictures, in which one points."""

from __future__ import annotations

from itertools import pairwise
from typing import cast

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Grid, Horizontal, Vertical
from textual.events import Click
from textual.strip import Strip
from textual.timer import Timer
from textual.widgets import OptionList
from textual.widgets.option_list import Option

from robotree.tui.line.going import pose_command
from robotree.tui.screen.foresight import Foreseen
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.cameras import RATE, Cameras, PictureView
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.pointing import Pointing
from robotree.tui.screen.widgets.readings import Readings, ShownReadings
from robotree.tui.seen.frames import LEVEL, Point, frame_of, on_plane, seen_at
from robotree.tui.seen.plan import CURSOR, GOAL, REFUSED, STEP, skeleton
from robotree.tui.seen.selection import Place
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import ViewDescribed

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


MOST, WIDE = 6, 110
"""Cameras side by side at most, and columns from which on three stand in a row."""
SLOWEST = 0.5
"""[Hz] of a picture among many."""
AGAIN = 2.0
"""[s] before the robot is asked again: a stop, or somebody else, may have come or gone."""
REST = 0.25
"""[s] that the cursor rests before the robot is asked for its way."""
NARROWEST, LOWEST = 24, 6
"""Columns and lines below which a skeleton cannot be read."""
INSTRUMENTS = 0.5
"""[s] between two looks at the instruments."""


class ViewsPane(Part, Horizontal):
    """Cameras on the left, the picture on the right."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Know no view yet."""
        super().__init__(id=id)
        self._options: list[tuple[str, str]] = []
        self._rest: Timer | None = None
        self._asked = float("-inf")
        self._bare = False
        """The arm is shown as a skeleton, instead of a picture."""
        self.together = False
        """All cameras are shown side by side."""

    def compose(self) -> ComposeResult:
        """List, instruments, picture."""
        with Vertical(classes="side"):
            yield OptionList(id="cameras", markup=False)
            yield Readings(id="instruments")
        with Vertical(classes="picture-side"):
            yield Cameras()
            yield PointedPicture(id="pointed")
            yield CachedText(id="bones")
            yield Grid(id="side-by-side")

    def on_mount(self) -> None:
        """Point the picture and read the instruments regularly."""
        self.query_one("#cameras").border_title = "cameras"
        self.query_one("#instruments").border_title = "instruments"
        self.query_one(Cameras).attach(self.query_one("#pointed", PointedPicture))
        self.query_one("#side-by-side").display = False
        self._show_bones(shown=self.app.calm)
        self.set_interval(INSTRUMENTS, self.guarded(self._tick))

    def draw(self) -> None:
        """Draw the list of cameras."""
        cameras = self.query_one(Cameras)
        cameras.draw()
        self.query_one("#pointed", PointedPicture).ground = cameras.ground
        newest = self.app.foresight.newest
        if newest is not None and self.app.now() - self._asked > AGAIN:
            self._ask_robot()
        for picture in self.query(PointedPicture):
            picture.draw()
        if (
            self.together
            and [one.of for one in self.query_one("#side-by-side", Grid).query(PointedPicture)] != self._shown
        ):
            self._lay_out()
        if cameras.all != self._options:
            self._options = list(cameras.all)
            options = self.query_one("#cameras", OptionList)
            options.clear_options()
            options.add_options(Option(Text(f"{view} / {camera}")) for view, camera in self._options)
            if self._options:
                options.highlighted = cameras.at

    @on(OptionList.OptionHighlighted)
    def _choose(self) -> None:
        cameras, at = self.query_one(Cameras), self.query_one("#cameras", OptionList).highlighted
        wanted = None if at is None else self._options[at]
        if wanted in cameras.all and cameras.all.index(wanted) != cameras.at:
            cameras.choose(cameras.all.index(wanted))

    def turn(self) -> None:
        """Look through the next camera."""
        cameras, options = self.query_one(Cameras), self.query_one("#cameras", OptionList)
        cameras.turn()
        if cameras.all:
            options.highlighted = cameras.at

    # -- without pictures --------------------------------------------------------------------------

    def bare(self) -> None:
        """Show the arm as a skeleton, or pictures again."""
        if self.together:
            self.beside()
        self._show_bones(shown=not self._bare)

    def _show_bones(self, *, shown: bool) -> None:
        self._bare = shown
        self.query_one("#bones").display = shown
        self.query_one("#pointed").display = not shown

    def _draw_bones(self, description: ViewDescribed) -> None:
        """Draw where the joints of the arm are: of a few bytes, where a picture has thousands."""
        widget = self.query_one("#bones", CachedText)
        widget.border_title = "skeleton: from the left side, and from above [m]"
        columns, rows = widget.content_size
        if not description.skeleton or columns < NARROWEST or rows < LOWEST:
            widget.show(Text("its controller does not say where the joints are", tint(self.app, "muted")))
            return
        lines = skeleton(description.skeleton, columns, rows)
        text = Text("\n").join(
            Text.assemble(*((words, tint(self.app, tone) if tone else "") for tone, words in line))
            for line in lines
        )
        text.no_wrap = True
        widget.show(text)

    # -- all at once -------------------------------------------------------------------------------

    def beside(self) -> None:
        """Show all cameras side by side, or one."""
        self.together = not self.together
        self.query_one(".side").display = not self.together
        self.query_one(Cameras).display = not self.together
        self.query_one("#pointed").display = not (self.together or self._bare)
        self.query_one("#bones").display = self._bare and not self.together
        self.query_one("#side-by-side").display = self.together
        self._lay_out()

    @property
    def _shown(self) -> list[tuple[str, str]]:
        return self.query_one(Cameras).all[:MOST]

    @work(exclusive=True, exit_on_error=False, group="side by side")
    async def _lay_out(self) -> None:
        """Make a picture for each camera; they share the rate of one."""
        grid, cameras, shown = self.query_one("#side-by-side", Grid), self.query_one(Cameras), self._shown
        await grid.remove_children()
        if not self.together:
            self.query_one("#cameras").focus()
            return
        grid.styles.grid_size_columns = min(len(shown), 2 if self.size.width < WIDE else 3) or 1
        for view, camera in shown:
            picture = PointedPicture(rate=max(RATE / len(shown), SLOWEST))
            picture.of = view, camera
            picture.ground = cameras.grounds.get(view, "")
            picture.border_title = Text(f"{view} / {camera}")
            await grid.mount(picture)
            picture.show(cameras.fetch(view, camera), f"looking through {camera or view} …")
        grid.query(PointedPicture).focus()

    # -- pointing ----------------------------------------------------------------------------------

    @property
    def pointing(self) -> PointedPicture | None:
        """The picture in which somebody points; None: in none."""
        found = (one for one in self.query(PointedPicture) if one.display and one.point is not None)
        return next(iter(sorted(found, key=lambda one: not one.has_focus)), None)

    @on(PointedPicture.Pointed)
    def _pointed(self, event: PointedPicture.Pointed) -> None:
        for other in self.query(PointedPicture):
            if other is not event.where:
                other.forget()
        self.app.foresight.forget()
        if self._rest is not None:
            self._rest.stop()
        self._rest = self.set_timer(REST, self.guarded(self._ask_robot))

    def _ask_robot(self) -> None:
        picture = self.pointing
        robot = self.app.store.described(self._robot(picture)) if picture else None
        if picture is not None and robot is not None and picture.point is not None:
            self._asked = self.app.now()
            self.app.foresee(robot, picture.point, picture.ground)

    def _robot(self, picture: PointedPicture | None) -> str:
        """Return the robot that would go: the selected one, else the first that moves in the same frame."""
        store, selected = self.app.store, self.app.selection.name
        known = store.described(selected)
        if picture is None or (known is not None and frame_of(known) == picture.ground):
            return selected
        there = (name for name, robot in store.descriptions.items() if frame_of(robot) == picture.ground)
        return next((name for name in there if (pose_command(store.descriptions[name]))), selected)

    @on(PointedPicture.Chosen)
    def _chosen(self, event: PointedPicture.Chosen) -> None:
        picture = cast("PointedPicture", event.where)
        if picture.point is None:
            self.app.tell(picture.why_no_point, "warning")
        else:
            self.app.ask_for("go", Place(self._robot(picture)))

    @on(PointedPicture.Turned)
    def _turned(self, event: PointedPicture.Turned) -> None:
        store, ground = self.app.store, cast("PointedPicture", event.where).ground
        names = [name for name, robot in store.descriptions.items() if frame_of(robot) == ground]
        if names:
            self.app.turn(names, event.by)
            self._ask_robot()

    def _tick(self) -> None:
        bare = self._bare and self.is_on_screen and self.screen.is_active
        if (bare or self.query_one("#pointed", PointedPicture).seen) and self.query_one(Cameras).all:
            self._read()

    @work(exclusive=True, exit_on_error=False, group="instruments")
    async def _read(self) -> None:
        cameras = self.query_one(Cameras)
        view, _ = cameras.all[cameras.at]
        try:
            description = await self.app.realm_client.describe_view(view)
        except VrError as error:
            self.query_one(Readings).show(Text(str(error), tint(self.app, "error")))
            return
        if cameras.all[cameras.at][0] == view:  # else a person has turned to another one meanwhile
            self.query_one(Readings).draw(ShownReadings(description.readings, description.units))
            if self._bare:
                self._draw_bones(description)
