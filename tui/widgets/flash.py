"""One line for what happened last: it fades by itself, everything stays in the log."""

from __future__ import annotations

from rich.text import Text
from textual.widgets import Static

from robotree.tui.fence import Fenced
from robotree.tui.store import Store
from robotree.tui.widgets.marks import weigh

STAYS = 8.0
"""[s] that a happening stays in the line; errors stay twice as long."""


class FlashLine(Fenced, Static):
    """Shows the newest happening while it is new."""

    def draw(self, store: Store, now: float) -> None:
        """Draw the line, or clear it."""
        newest = store.happenings[-1] if store.happenings else None
        stays = STAYS * (2 if newest and newest.weight == "error" else 1)
        if newest is None or now - newest.at > stays:
            self.update("")
            return
        line = weigh(self.app, newest.weight, newest.text.replace("\n", " "))
        line.no_wrap, line.overflow = True, "ellipsis"
        self.update(Text.assemble(" ", line))
