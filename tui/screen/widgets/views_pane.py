"""The views: which there are, what their instruments read, and the picture of the chosen camera."""

from __future__ import annotations

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import OptionList
from textual.widgets.option_list import Option

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import PictureView
from robotree.tui.screen.widgets.readings import Readings, ShownReadings
from robotree.vr.base.errors import VrError

INSTRUMENTS = 0.5
"""[s] between two looks at the instruments."""


class ViewsPane(Part, Horizontal):
    """Cameras on the left, the picture on the right."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Know no view yet."""
        super().__init__(id=id)
        self._options: list[tuple[str, str]] = []

    def compose(self) -> ComposeResult:
        """List, instruments, picture."""
        with Vertical(classes="side"):
            yield OptionList(id="cameras", markup=False)
            yield Readings(id="instruments")
        with Vertical(classes="picture-side"):
            yield Cameras()
            yield PictureView()

    def on_mount(self) -> None:
        """Point the picture and read the instruments regularly."""
        self.query_one("#cameras").border_title = "cameras"
        self.query_one("#instruments").border_title = "instruments"
        self.query_one(Cameras).attach(self.query_one(PictureView))
        self.set_interval(INSTRUMENTS, self.guarded(self._tick))

    def draw(self) -> None:
        """Draw the list of cameras."""
        cameras = self.query_one(Cameras)
        cameras.draw()
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

    def _tick(self) -> None:
        if self.query_one(PictureView).seen and self.query_one(Cameras).all:
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
