"""What happened last, in a line below: it goes by itself, everything stays in the log."""

from __future__ import annotations

from rich.text import Text

from robotree.tui.screen.widgets.marks import weigh
from robotree.tui.screen.widgets.still import Still
from robotree.tui.seen.store import Store

STAYS = 8.0
"""[s] that a happening stays in the line; errors stay twice as long."""


class FlashLine(Still):
    """Shows what happened last, the newest first, as much as fits; an error that does not has more lines."""

    def draw(self, store: Store, now: float) -> None:
        """Draw the line, or clear it."""
        line, long = Text(" "), False
        for happening in reversed(store.happenings):
            bad = happening.weight == "error"
            if now - happening.at > STAYS * (1 + bad) or line.cell_len > self.size.width:
                break
            newest = line.cell_len == 1
            line.append_text(weigh(self.app, happening.weight, happening.text.replace("\n", " ")))
            if newest and bad and line.cell_len > self.size.width:
                long = True  # its end may name who did not stop
                break
            line.append("   ")
        self.set_class(long, "-long")
        self.show(line)
