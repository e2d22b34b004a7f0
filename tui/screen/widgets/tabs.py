"""The names of the panes with their keys; the one in front stands out."""

from __future__ import annotations

from collections.abc import Mapping

from rich.text import Text
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.message import Message

from robotree.tui.screen.fence import Fenced
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.still import Still


class TabName(Still):
    """One name; a click goes there."""

    class Chosen(Message):
        """The name was clicked."""

        def __init__(self, pane: str) -> None:
            """Carry the pane's name."""
            super().__init__()
            self.pane = pane

    def __init__(self, pane: str, key: str) -> None:
        """Name a pane and its key."""
        super().__init__(classes="tab")
        self._pane, self._key = pane, key

    def draw(self, front: str) -> None:
        """Draw the name; `front` is the pane in front."""
        muted, strong = tint(self.app, "muted"), tint(self.app, "primary", bold=True)
        chosen = self._pane == front
        mark, word = ("▌", strong) if chosen else (" ", "")
        self.show(Text.assemble((mark, strong), (self._pane.capitalize(), word), (f" {self._key}", muted)))

    def on_click(self) -> None:
        """Go there."""
        self.post_message(self.Chosen(self._pane))


class TabLine(Fenced, Horizontal):
    """One line of names."""

    def __init__(self, panes: Mapping[str, str]) -> None:
        """Name the panes with their keys."""
        super().__init__(classes="tabs")
        self._panes = panes

    def compose(self) -> ComposeResult:
        """A name each."""
        for pane, key in self._panes.items():
            yield TabName(pane, key)

    def draw(self, front: str) -> None:
        """Draw the names."""
        for name in self.query(TabName):
            name.draw(front)
