"""Which camera one looks through: all cameras of all views, one after the other."""

from __future__ import annotations

from functools import partial

from rich.text import Text
from textual import work
from textual.app import ComposeResult
from textual.containers import Vertical

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.picture import Fetch, PictureView
from robotree.tui.seen.cells import seen
from robotree.vr.base.errors import VrError

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
