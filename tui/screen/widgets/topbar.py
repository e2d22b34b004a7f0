"""The line on top: where one is and who is there; below it, in red, what one must not overlook."""

from __future__ import annotations

from rich.cells import cell_len
from rich.text import Text

from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.keys import spell
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.marks import block, tint
from robotree.tui.seen.cells import clip, seen
from robotree.tui.seen.store import Store

STOPPED = "■ PROTECTIVE STOP: "


class TopBar(CachedText):
    """Name of the program, realm, page; on the right the counts, and how to stop."""

    def draw(self, store: Store, realm: str, page: str) -> None:
        """Draw the line."""
        muted, strong = tint(self.app, "muted"), tint(self.app, "primary", bold=True)
        left = Text.assemble((" robotree ", strong), (" realm ", muted), realm, ("  ", muted), page)
        counts = [
            (len(store.known), "robot"),
            (len(store.views), "view"),
            (len(store.hosts), "host"),
            (len(store.services), "lookup"),
        ]
        stop = Text.assemble((f" {spell(BY_VERB['stop'].key)} STOP ", block(self.app)))
        right = Text()
        for count, noun in counts:
            right.append(" · " if right else "", muted)
            right.append(f"{count}", "" if count else tint(self.app, "warning"))
            right.append(f" {noun}{'' if count == 1 else 's'}", muted)
        right.append("  ")
        width = max(self.size.width, 1)
        if left.cell_len + right.cell_len + stop.cell_len >= width:
            right = Text()
        left.truncate(max(width - stop.cell_len - 1, 0), overflow="ellipsis")  # how to stop stays to be read
        gap = max(width - left.cell_len - right.cell_len - stop.cell_len, 1)
        self.show(Text.assemble(left, " " * gap, right, stop, no_wrap=True, overflow="ellipsis"))


class Banner(CachedText):
    """What one must not overlook; not there when there is nothing."""

    def draw(self, store: Store) -> None:
        """Draw the banner, or take it away: first who may still move, then who has stopped."""
        lines: list[Text] = []
        ground = block(self.app) if self.app.no_color else ""  # with colours the style sheet gives it
        stop = store.stop
        if stop and stop.open:
            told = ", ".join(f"{seen(name)} ({seen(why)})" for name, why in stop.open.items())
            lines.append(Text(f" ■ NOT CONFIRMED: {told} ", block(self.app)))
        if store.stopped:
            took = f"  after {stop.longest:.2f} s" if stop and stop.confirmed else ""
            tail = f"{took} — {self.app.keymap.spelled('resume')} resumes"
            room = (self.size.width or self.app.size.width - 2) - cell_len(STOPPED) - cell_len(tail)
            names = clip(", ".join(seen(name) for name in store.stopped), max(room, 1))
            lines.append(Text(f"{STOPPED}{names}{tail}", ground))
        if store.orphaned:
            stale = "✗ STALE: no lookup service is left; the lists may be old, known robots still obey"
            lines.append(Text(stale, ground))
        self.display = bool(lines)
        for line in lines:
            line.truncate(max(self.size.width or self.app.size.width - 2, 1), overflow="ellipsis")
        self.show(Text("\n", no_wrap=True).join(lines))
