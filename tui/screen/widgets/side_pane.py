"""Beside the form of a command that runs: the branch of the tree that works, and the workspace."""

from __future__ import annotations

from collections.abc import Iterator

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Vertical

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.marks import status_mark, tint
from robotree.tui.screen.widgets.picture import PictureView
from robotree.tui.seen.rows import rails
from robotree.tui.seen.store import Store


class Branch(CachedText):
    """Draws the branch of one robot, a line for each slot."""

    def draw(self, store: Store, name: str, now: float) -> None:
        """Draw the robot of this name and those beneath it."""
        text = Text(no_wrap=True, overflow="ellipsis")
        lines = list(_lines(store, name))
        leads = rails([depth for depth, *_ in lines])
        for lead, (_, slot, robot, needed) in zip(leads, lines, strict=True):
            text.append(lead, tint(self.app, "muted"))
            text.append(f"{slot}: " if slot else "", tint(self.app, "muted"))
            if robot:
                text.append(f"{robot}  ", "bold")
                text.append_text(status_mark(self.app, store.status(robot, now), store.doing(robot, now)))
            else:
                text.append("empty", tint(self.app, "warning" if needed else "muted"))
            text.append("\n")
        text.rstrip()
        self.show(text)


def _lines(
    store: Store, name: str, slot: str = "", above: tuple[str, ...] = ()
) -> Iterator[tuple[int, str, str, bool]]:
    """Yield depth, slot and robot of each line, and whether it is needed; an empty slot has no robot."""
    yield len(above), slot, name, True
    robot = store.described(name)
    if robot is None or name in above:
        return
    for one in robot.slots:
        if one.child:
            yield from _lines(store, one.child.name, one.name, (*above, name))
        elif not one.watched:  # who is only watched has a place of its own
            yield len(above) + 1, one.name, "", not one.optional


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
