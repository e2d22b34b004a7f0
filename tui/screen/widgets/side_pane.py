"""Beside the form of a command that runs: the branch of the tree that works, and the workspace."""

from __future__ import annotations

from textual.app import ComposeResult
from textual.containers import Vertical

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.branch import Branch
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.picture import PictureView


class SidePane(Part, Vertical):
    """Branch above, picture below. It asks for pictures only where it can be seen."""

    def compose(self) -> ComposeResult:
        """Branch, name of the camera, picture."""
        yield Branch(classes="branch")
        yield Cameras()
        yield PictureView()

    def on_mount(self) -> None:
        """Point the picture."""
        self.query_one(Cameras).attach(self.query_one(PictureView))

    def draw(self, name: str) -> None:
        """Draw the branch of a robot."""
        self.query_one(Branch).draw(self.app.store, name, self.app.now())
        self.query_one(Cameras).draw()
