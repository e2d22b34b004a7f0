"""The latest events: one line on every page, three on the main page; all of them stay in the log."""

from __future__ import annotations

import time

from rich.text import Text

from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint, weigh
from robotree.tui.seen.store import LogEntry, Store

STAYS = 8.0
"""[s] that a entry stays in the line; errors stay twice as long."""

LINES = 3
"""Lines of the main page that always show what happened last."""


def _recent(store: Store, now: float) -> list[LogEntry]:
    """Return what has just happened, the newest first."""
    found: list[LogEntry] = []
    for entry in reversed(store.entries):
        if now - entry.at > STAYS * (1 + (entry.weight == "error")):
            break
        found.append(entry)
    return found


def more(count: int, key: str) -> str:
    """Say how much else has just happened, and which key shows it."""
    return f"+{count} · {key}" if count > 0 else ""


class FlashLine(CachedText):
    """Shows what happened last; an error that does not fit has more lines."""

    def draw(self, store: Store, now: float, *, logs: bool = True) -> None:
        """Draw the line, or clear it; `logs`: also what robots log and what is for operators."""
        recent, line, long = _recent(store, now), Text(" "), False
        if not logs:
            recent = [entry for entry in recent if entry.line is None and not entry.operators][:1]
        if recent:
            newest = recent[0]
            line.append_text(weigh(self.app, newest.weight, newest.text))
            rest = more(len(recent) - 1, self.app.keymap.spelled("log"))
            room = self.size.width - len(rest) - 2
            long = newest.weight == "error" and line.cell_len > self.size.width
            if not long and rest:
                line.truncate(max(room, 0), overflow="ellipsis")
            line.append(f"  {rest}" if rest else "", tint(self.app, "muted"))
        self.set_class(long, "-long")
        self.show(line)


class LastLines(CachedText):
    """Shows what happened last, the newest at the bottom; an error that does not fit has the lines above."""

    def draw(self, store: Store, now: float, wall: float) -> None:
        """Draw the lines.

        Args:
            store: what happened.
            now: [s] on the store's clock.
            wall: [s] since 1970, at the same moment.
        """
        width, muted = max(self.size.width - 2, 1), tint(self.app, "muted")
        lines: list[Text] = []
        for entry in reversed(store.entries):
            clock = time.strftime("%H:%M:%S", time.localtime(wall - (now - entry.at)))
            line = Text.assemble((f"{clock} ", muted), weigh(self.app, entry.weight, entry.text))
            if not lines and entry.weight == "error":
                parts = list(line.wrap(self.app.console, width))[:LINES]
            else:
                line.truncate(width, overflow="ellipsis")
                parts = [line]
            if len(lines) + len(parts) > LINES:
                break
            lines = [*parts, *lines]
        log = self.app.keymap.spelled("log")
        entitle(self, f"log  {log}", more(len(_recent(store, now)) - LINES, log))
        self.show(Text("\n").join(lines))
