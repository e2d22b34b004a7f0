"""The log: everything that happened, the newest at the bottom, where it stays unless somebody scrolls up."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rich.text import Text
from textual.events import Resize
from textual.message import Message
from textual.widgets import RichLog

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.marks import tint, weigh
from robotree.tui.seen import matching
from robotree.tui.seen.cells import seen
from robotree.tui.seen.store import Store, Weight

CLOCK = "%Y-%m-%d %H:%M:%S"

LEVELS: Mapping[Weight, int] = {"good": 0, "plain": 0, "warning": 1, "error": 2}
"""How important a entry is."""


class LogPane(Part, RichLog):
    """Appends what is new since it was drawn last.

    Textual scrolls to the end when a line is written, as far as that is for the size of that moment; a log
    that is hidden has none. So it is done again whenever there is another one.
    """

    class Resized(Message):
        """It has another width: its lines must be written anew."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Make an empty log, without markup."""
        super().__init__(id=id, markup=False, highlight=False, wrap=True, max_lines=500)
        self._last: object = None
        self._asked: tuple[str, Weight, int] = ("", "good", 0)
        """The filter, the level and the width that it was drawn with."""
        self._scrolled_up = False
        """A person reads what is older: nothing may pull that away."""

    def release_anchor(self) -> None:
        """A person scrolls, by key, wheel or bar (`Widget.release_anchor`)."""
        super().release_anchor()
        self._scrolled_up = True

    def action_scroll_end(self) -> None:
        """Follow the newest line from now on, also one that comes while the log still scrolls there."""
        super().action_scroll_end()
        self._scrolled_up = False

    def watch_scroll_y(self, old_value: float, new_value: float) -> None:
        """Follow the newest line again when a person has come back to it."""
        super().watch_scroll_y(old_value, new_value)
        if new_value >= self.max_scroll_y:
            self._scrolled_up = False

    def on_show(self) -> None:
        """Begin at the newest line, or where a person has left off."""
        self._follow()

    def on_resize(self, event: Resize) -> None:
        """Stay there in another size."""
        del event
        self._follow()
        self.post_message(self.Resized())

    def _follow(self) -> None:
        if not self._scrolled_up:
            self.scroll_end(animate=False, x_axis=False)

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
        if (letters, level, room) != self._asked:
            self._asked, self._last = (letters, level, room), None
            self.clear()
        if not room:
            return  # it is hidden; RichLog would ask the terminal for the width
        entries = list(store.entries)
        start = next((i + 1 for i in range(len(entries) - 1, -1, -1) if entries[i] is self._last), 0)
        wanted = matching.terms(letters)
        for one in entries[start:]:
            said = {"name": one.robot, "state": one.weight, "text": one.text}
            if LEVELS[one.weight] < LEVELS[level] or not matching.matches(wanted, said):
                continue
            clock = time.strftime(CLOCK, time.localtime(wall - (now - one.at)))
            line = Text.assemble(
                (f"{clock}  ", tint(self.app, "muted")), weigh(self.app, one.weight, seen(one.text))
            )
            self.write(line, width=room, scroll_end=not self._scrolled_up)
        if entries:
            self._last = entries[-1]
