"""The views: which there are, what their instruments read, and the pictures: one, or all side by side."""

from __future__ import annotations

from typing import cast

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Grid, Horizontal, Vertical
from textual.timer import Timer
from textual.widgets import OptionList
from textual.widgets.option_list import Option

from robotree.tui.line.going import pose_command
from robotree.tui.screen.part import Part
from robotree.tui.screen.place import Place
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import RATE
from robotree.tui.screen.widgets.pointed_picture import PointedPicture
from robotree.tui.screen.widgets.readings import Readings, ShownReadings
from robotree.tui.seen.frames import frame_of
from robotree.tui.seen.plan import skeleton
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import ViewDescribed

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
