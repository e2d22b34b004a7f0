"""What happened: the log, and its latest events, one line on every page, three on the main page.

The log has its newest line at the bottom, where it stays unless somebody scrolls up.
"""

from __future__ import annotations

import time
from collections.abc import Mapping

from rich.text import Text
from textual.events import Resize
from textual.message import Message
from textual.widgets import RichLog

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint, weigh
from robotree.tui.seen import matching
from robotree.tui.seen.cells import seen
from robotree.tui.seen.store import LogEntry, Store, Weight

CLOCK = "%H:%M:%S"
DATED = f"%Y-%m-%d {CLOCK}"
"""For what happened on another day."""

SIGN = 2
"""Cells of the sign before the text of an entry."""

LEVELS: Mapping[Weight, int] = {"good": 0, "plain": 0, "warning": 1, "error": 2}
"""How important an entry is."""


class LogPane(Part, RichLog):
    """Appends what is new since it was drawn last.

    It scrolls to the newest line when lines were written, and when it is shown or has another size: a log
    that is hidden has none. What a person did until then is asked at that moment, not before.
    """

    class Resized(Message):
        """It has another width: its lines must be written anew."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Make an empty log, without markup."""
        super().__init__(id=id, markup=False, highlight=False, wrap=True, max_lines=500)
        self._last: object = None
        self._asked: tuple[str, Weight, int] = ("", "good", 0)
        """The filter, the level and the width that it was drawn with."""
        self._reads_older = False
        """A person has scrolled up: nothing may pull away what is read."""

    def release_anchor(self) -> None:
        """A person scrolls, by key, wheel or bar (`Widget.release_anchor`)."""
        super().release_anchor()
        self._reads_older = True

    def action_scroll_end(self) -> None:
        """Follow the newest line from now on, also one that comes while the log still scrolls there."""
        super().action_scroll_end()
        self._reads_older = False

    def action_scroll_down(self) -> None:
        """Scroll down; below the newest line there is nothing, also while the log still scrolls there."""
        if self._reads_older:
            super().action_scroll_down()

    def action_page_down(self) -> None:
        """Scroll down by a page (`action_scroll_down`)."""
        if self._reads_older:
            super().action_page_down()

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        """Follow the newest line again when a person has scrolled down to it."""
        super().watch_scroll_y(old_value, new_value)
        if new_value > old_value and new_value >= self.max_scroll_y:
            self._reads_older = False

    def on_show(self) -> None:
        """Begin at the newest line, or where a person has left off."""
        self.call_after_refresh(self._follow)

    def on_resize(self, event: Resize) -> None:
        """Stay there in another size."""
        del event
        self.call_after_refresh(self._follow)
        self.post_message(self.Resized())

    def _follow(self, end: float | None = None) -> None:
        """Scroll to the newest line, unless a person has asked for an older one by now.

        Called after a refresh: then the size is known, and what a person asked for before has been done.

        Args:
            end: where the newest line was before others came; a person who is there follows.
        """
        if end is not None and self.scroll_target_y >= end:
            self._reads_older = False
        if not self._reads_older:
            self.scroll_end(animate=False, immediate=True, x_axis=False)

    def draw(
        self, store: Store, now: float, wall: float, *, letters: str = "", level: Weight = "good"
    ) -> None:
        """Append what is new; begin anew when something else is asked for.

        Args:
            store: what happened.
            now: [s] on the store's clock.
            wall: [s] since 1970, at the same moment.
            letters: of a filter (`matching`): `name:` is the robot, `state:` the weight.
            level: what is less important is left out.
        """
        room = self.scrollable_content_region.width
        end: float | None = self.max_scroll_y
        if (letters, level, room) != self._asked:
            self._asked, self._last = (letters, level, room), None
            end = None  # the lines are written anew: their old end says nothing
            self.clear()
        if not room:
            return  # it is hidden; RichLog would ask the terminal for the width
        entries = list(store.entries)
        start = next((i + 1 for i in range(len(entries) - 1, -1, -1) if entries[i] is self._last), 0)
        wanted = matching.terms(letters)
        for entry in entries[start:]:
            said = {"name": entry.robot, "state": entry.weight, "text": entry.text}
            if LEVELS[entry.weight] < LEVELS[level] or not matching.matches(wanted, said):
                continue
            self.write(self._line(entry, wall - (now - entry.at), wall, room), width=room, scroll_end=False)
        if entries and entries[-1] is not self._last:
            self._last = entries[-1]
            self.call_after_refresh(self._follow, end)

    def _line(self, entry: LogEntry, at: float, wall: float, room: int) -> Text:
        """Return an entry with its time; what does not fit stands below its text, not below the time.

        Args:
            entry: what happened.
            at: [s] since 1970, when it happened.
            wall: [s] since 1970, now.
            room: [cells]
        """
        then = time.localtime(at)
        clock = f"{time.strftime(CLOCK if then[:3] == time.localtime(wall)[:3] else DATED, then)} "
        text, indent = weigh(self.app, entry.weight, seen(entry.text)), len(clock) + SIGN
        if text.cell_len > room - len(clock) and room > 2 * indent:
            first, *rest = text.wrap(self.app.console, room - indent)
            text = Text("\n").join([first, *(Text.assemble(" " * indent, one) for one in rest)])
        return Text.assemble((clock, tint(self.app, "muted")), text)


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
