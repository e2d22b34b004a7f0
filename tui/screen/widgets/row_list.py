"""A list of rows that change by themselves: drawn again where they differ; what is chosen stays chosen."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from rich.text import Text
from textual.widgets import OptionList
from textual.widgets.option_list import Option


class Row(NamedTuple):
    """One line, or several, of a list."""

    key: object
    """What it stands for; None: it is a heading, and cannot be chosen."""
    text: Text


class RowList(OptionList):
    """See the module."""

    class OptionSelected(OptionList.OptionSelected):
        """A row was chosen; the rows may be others when it is dealt with."""

        def __init__(self, rows: RowList, option: Option, index: int) -> None:
            """Keep what the row stands for."""
            super().__init__(rows, option, index)
            self.key = rows.rows[index].key

    def __init__(self, *, id: str | None = None, compact: bool = False) -> None:  # noqa: A002 # Textual's name
        """Begin without rows; they will be no markup."""
        super().__init__(id=id, markup=False, compact=compact)
        self.rows: list[Row] = []

    @property
    def chosen(self) -> object:
        """What the row under the cursor stands for; None: there is none."""
        return None if self.highlighted is None else self.rows[self.highlighted].key

    def fill(self, rows: Iterable[Row]) -> None:
        """Show these rows. If the chosen one is not among them, the one in its place is chosen."""
        before, chosen, at = self.rows, self.chosen, self.highlighted or 0
        self.rows = list(rows)
        keys = [row.key for row in self.rows]
        if keys == [row.key for row in before]:
            for place, (row, old) in enumerate(zip(self.rows, before, strict=True)):
                if row.text != old.text:
                    self.replace_option_prompt_at_index(place, row.text)
            return
        self.clear_options()
        self.add_options([Option(row.text, disabled=row.key is None) for row in self.rows])
        can = [place for place, key in enumerate(keys) if key is not None]
        beside = next((place for place in can if place >= at), can[-1] if can else None)
        self.highlighted = keys.index(chosen) if chosen is not None and chosen in keys else beside
