"""The list of free robots. Only cells that differ are drawn again: see the cost of tables in Textual."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.widgets import DataTable

from robotree.tui.screen.fence import Fenced
from robotree.tui.screen.widgets.marks import mood_mark, tint
from robotree.tui.seen.store import Row

COLUMNS = {"NAME": 18, "KIND": 16, "STATE": 16, "HOST": 10}
"""Width of the columns [cells]."""
ABOUT = "ABOUT"
"""The last column takes what is left, and is left out when that is too little."""
GAP = 2
"""Cells of padding around each column."""
LEAST = 16
"""Cells below which the last column is left out."""


class RobotTable(Fenced, DataTable[Text]):
    """Rows by name; the cursor stays on its robot while others come and go."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("enter", "select_cursor", "Panel")]

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Make an empty table."""
        super().__init__(cursor_type="row", id=id, cursor_foreground_priority="renderable")
        self._shown: dict[str, Row] = {}
        self._room = 0
        self._letters = ""
        self._chosen = ""
        """The robot that a person put the cursor on: it comes back there when a filter that hid it goes."""
        self._placed = ""
        """The robot that the cursor was put on by us."""

    def on_mount(self) -> None:
        """Set up the columns."""
        for label, width in COLUMNS.items():
            self.add_column(Text(label), key=label, width=width)

    def on_resize(self) -> None:
        """Give the last column what the others leave."""
        left = self.size.width - sum(width + GAP for width in COLUMNS.values()) - GAP
        room = left if left >= LEAST else 0
        if room == self._room:
            return
        rows, self._room = list(self._shown.values()), room
        if ABOUT in self.columns:
            self.remove_column(ABOUT)
        if room:
            self.add_column(Text(ABOUT), key=ABOUT, width=room)
        self._refill(rows, [self.selected])

    @property
    def selected(self) -> str:
        """Name of the robot under the cursor; empty: none."""
        names = list(self._shown)
        return names[self.cursor_row] if 0 <= self.cursor_row < len(names) else ""

    def draw(self, rows: Sequence[Row], letters: str = "") -> None:
        """Draw these rows, in this order; `letters` are those that they were filtered by."""
        filtered_anew, self._letters = letters != self._letters, letters
        if self.selected != self._placed:
            self._chosen = self._placed = self.selected
        if [row.name for row in rows] == list(self._shown):
            for row in rows:
                self._redraw(self._shown[row.name], row)
            return
        self._refill(rows, [self._chosen, self.selected] if filtered_anew else [self.selected])
        self._placed = self.selected
        if not filtered_anew:
            self._chosen = self.selected

    def _refill(self, rows: Sequence[Row], keep: Sequence[str]) -> None:
        """Show other rows; the cursor goes to the first of these robots that is among them."""
        self.clear()
        self._shown = {}
        for row in rows:
            self._shown[row.name] = row
            self.add_row(*self._cells(row), key=row.name)
        names = list(self._shown)
        wanted = next((name for name in keep if name in names), None)
        if wanted is not None:
            self.move_cursor(row=names.index(wanted), animate=False)

    def _redraw(self, before: Row, after: Row) -> None:
        if before == after:
            return
        self._shown[after.name] = after
        labels = [*COLUMNS, *([ABOUT] if self._room else [])]
        for label, old, new in zip(labels, self._cells(before), self._cells(after), strict=True):
            if old != new or before.fresh != after.fresh:
                self.update_cell(after.name, label, new, update_width=False)

    def _cells(self, row: Row) -> list[Text]:
        muted = tint(self.app, "muted")
        state = mood_mark(self.app, row.mood, row.doing)
        if row.stale:
            state.append(" stale", tint(self.app, "warning"))
        cells = [
            Text(row.name, tint(self.app, "accent", bold=True) if row.fresh else "bold"),
            Text(row.kind),
            state,
            Text(row.host or "-", muted),
        ]
        return [*cells, Text(row.about, muted)] if self._room else cells
