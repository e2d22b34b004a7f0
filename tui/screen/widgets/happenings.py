"""The log: everything that happened, the newest at the bottom."""

from __future__ import annotations

import time

from rich.text import Text
from textual.widgets import RichLog

from robotree.tui.screen.fence import Fenced
from robotree.tui.screen.widgets.marks import tint, weigh
from robotree.tui.seen.store import Store


class HappeningLog(Fenced, RichLog):
    """Appends what is new since it was drawn last."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Make an empty log, without markup."""
        super().__init__(id=id, markup=False, highlight=False, wrap=True, max_lines=500)
        self._last: object = None

    def draw(self, store: Store, now: float, wall: float) -> None:
        """Append what is new.

        Args:
            store: what happened.
            now: [s] on the store's clock.
            wall: [s] since 1970, at the same moment.
        """
        happenings = list(store.happenings)
        start = next((i + 1 for i in range(len(happenings) - 1, -1, -1) if happenings[i] is self._last), 0)
        for happening in happenings[start:]:
            clock = time.strftime("%H:%M:%S", time.localtime(wall - (now - happening.at)))
            line = weigh(self.app, happening.weight, happening.text)
            self.write(Text.assemble((f"{clock}  ", tint(self.app, "muted")), line))
        if happenings:
            self._last = happenings[-1]
