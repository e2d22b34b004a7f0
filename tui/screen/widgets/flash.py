"""One line for what happened last: it goes by itself, everything stays in the log."""

from __future__ import annotations

from rich.text import Text

from robotree.tui.screen.widgets.marks import weigh
from robotree.tui.screen.widgets.still import Still
from robotree.tui.seen.store import Store

STAYS = 8.0
"""[s] that a happening stays in the line; errors stay twice as long."""


class FlashLine(Still):
    """Shows what happened last, the newest first, as much as fits."""

    def draw(self, store: Store, now: float) -> None:
        """Draw the line, or clear it."""
        line = Text(" ", no_wrap=True, overflow="ellipsis")
        for happening in reversed(store.happenings):
            stays = STAYS * (2 if happening.weight == "error" else 1)
            if now - happening.at > stays or line.cell_len > self.size.width:
                break
            line.append_text(weigh(self.app, happening.weight, happening.text.replace("\n", " ")))
            line.append("   ")
        self.show(line)
