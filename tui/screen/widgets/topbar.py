"""The line on top: where one is and who is there; below it, in red, what one must not overlook."""

from __future__ import annotations

import math

from rich.cells import cell_len
from rich.text import Text

from robotree.tui.line.action import spell
from robotree.tui.line.actions import BY_VERB
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.marks import STATUSES, block, tint, tint_on_panel
from robotree.tui.seen.cells import clip, seen
from robotree.tui.seen.status import CALM, COUNTED, Status
from robotree.tui.seen.store import Store
from robotree.tui.words import say

COUNT_AGAIN = 1.0
"""[s] between two counts of the robots: each looks at all of them."""
GAP = 3
"""Cells between what stands on the left and on the right, at least."""


NAMES = 12
"""Cells for the names of robots in a banner, before anything else is said there."""


class TopBar(CachedText):
    """Name of the program, realm, page; on the right the counts, and how to stop."""

    _counts: tuple[float, list[tuple[Status, int]]] = (-math.inf, [])
    """When the robots were counted last [s], and how many have each status."""

    def draw(self, store: Store, heading: str, page: str) -> None:
        """Draw the line."""
        muted, strong = tint(self.app, "muted"), tint(self.app, "primary", bold=True)
        left = Text.assemble((" robotree ", strong), " ", heading, ("  ", muted), page)
        stop = Text.assemble((f" {spell(BY_VERB['stop'].key)} {say(self.app.STOP_WORD)} ", block(self.app)))
        if waiting := len(store.permits):
            asks = f" {waiting} permit{' waits' if waiting == 1 else 's wait'}: "
            asks += f"{self.app.keymap.spelled('permits')}  "
            stop = Text.assemble((asks, tint_on_panel(self.app, "warning", bold=True)), stop)
        if alarms := len(store.watched.open()):
            rings = f" ▲ {alarms} alarm{'' if alarms == 1 else 's'}: {self.app.keymap.spelled('readings')}  "
            stop = Text.assemble((rings, tint_on_panel(self.app, "error", bold=True)), stop)
        robots, others = self._robots(store), self._others(store)
        width = max(self.size.width or self.app.size.width, 1)  # the first time it has no size yet
        if left.cell_len >= width - stop.cell_len:  # the page says more than the name of the program
            left = Text.assemble(" ", heading, ("  ", muted), page)
        room = width - left.cell_len - stop.cell_len - GAP
        wanted = (Text.assemble(robots, (" · ", muted), others), robots, Text())
        right = next(text for text in wanted if text.cell_len <= room or not text)
        if right:
            right.append("  ")
        left.truncate(max(width - stop.cell_len - 1, 0), overflow="ellipsis")  # how to stop stays to be read
        gap = max(width - left.cell_len - right.cell_len - stop.cell_len, 1)
        self.show(Text.assemble(left, " " * gap, right, stop, no_wrap=True, overflow="ellipsis"))

    def _robots(self, store: Store) -> Text:
        """Return how many robots have each status, the worst first: `3 hang · 988 free`."""
        now, (counted, _) = self.app.now(), self._counts
        if now - counted >= COUNT_AGAIN or not self._counts[1]:
            self._counts = now, store.count(now)
        muted, text = tint(self.app, "muted"), Text()
        for status, count in self._counts[1]:
            words = f"{count} {say(status if count == 1 else COUNTED.get(status, status))}"
            text.append(" · " if text else "", muted)
            text.append(words, tint_on_panel(self.app, STATUSES[status][1]) if status not in CALM else "")
        return text or Text(say("0 robots"), tint(self.app, "warning"))

    def _others(self, store: Store) -> Text:
        """Return how many views, hosts and lookup services there are."""
        muted, text = tint(self.app, "muted"), Text()
        for count, noun in (
            (len(store.views), "view"),
            (len(store.hosts), "host"),
            (len(store.services), "lookup"),
        ):
            text.append(" · " if text else "", muted)
            text.append(f"{count}", "" if count else tint(self.app, "warning"))
            text.append(f" {say(noun if count == 1 else f'{noun}s')}", muted)
        return text


class Banner(CachedText):
    """A warning that must not be overlooked; hidden when there is none."""

    def draw(self, store: Store) -> None:
        """Draw the banner, or take it away: first who may still move, then who has stopped."""
        lines: list[Text] = []
        ground = block(self.app) if self.app.no_color else ""  # with colours the style sheet gives it
        stop = store.stop
        if stop and stop.open:
            unconfirmed = ", ".join(f"{seen(name)} ({seen(why)})" for name, why in stop.open.items())
            lines.append(Text(f" ■ NOT CONFIRMED: {unconfirmed} ", block(self.app)))
        if drills := store.drills:
            lines.append(Text(f" ▲ DRILL: {'; '.join(f'{seen(n)} {seen(t)}' for n, t in drills.items())} "))
        if unchecked := sorted(name for name, one in store.descriptions.items() if one.unchecked):
            names = ", ".join(map(seen, unchecked))
            lines.append(Text(f" ✗ CODE OF ANYBODY: {names} (--insecure-any-signer) ", block(self.app)))
        if store.stopped:
            stopped = f"■ {say('PROTECTIVE STOP')}: "
            took = f"  after {stop.longest:.2f} s" if stop and stop.confirmed else ""
            resumes = say("{key} resumes", key=self.app.keymap.spelled("resume"))
            tail = f" — {resumes}" if self.app.keyboard.has(BY_VERB["resume"]) else ""
            room = (self.size.width or self.app.size.width - 2) - cell_len(stopped) - cell_len(tail)
            if room - cell_len(took) >= NAMES:  # how to resume is read however little room there is
                tail, room = took + tail, room - cell_len(took)
            names = clip(", ".join(seen(name) for name in store.stopped), max(room, 1))
            lines.append(Text(f"{stopped}{names}{tail}", ground))
        if store.orphaned:
            stale = say("STALE: no lookup service is left; the lists may be old, known robots still obey")
            lines.append(Text(f"✗ {stale}", ground))
        self.display = bool(lines)
        for line in lines:
            line.truncate(max(self.size.width or self.app.size.width - 2, 1), overflow="ellipsis")
        self.show(Text("\n", no_wrap=True).join(lines))
