"""Choosing one of a few words."""

from __future__ import annotations

from collections.abc import Iterable

from rich.text import Text
from textual.widgets import Select


class Choice(Select[str]):
    """A compact list that drops down. Its options are plain words, never markup."""

    def __init__(
        self,
        words: Iterable[tuple[str, str]],
        *,
        chosen: str | None = None,
        prompt: str = "choose",
        id: str | None = None,  # noqa: A002 # Textual's name for it
        classes: str | None = None,
    ) -> None:
        """Offer pairs of what is shown and what it means; with `chosen` one is chosen, and always will be."""
        value = Select.NULL if chosen is None else chosen
        options = [(Text(shown), meant) for shown, meant in words]
        blank = chosen is None
        self._first = chosen or ""
        super().__init__(
            options, value=value, allow_blank=blank, prompt=prompt, compact=True, id=id, classes=classes
        )

    @property
    def chosen(self) -> str:
        """The choice, also before it is on the screen; empty: none."""
        return self.value if isinstance(self.value, str) else self._first

    def choose(self, word: str) -> None:
        """Choose a word, or nothing where that is allowed; what is not offered changes nothing."""
        value = word or Select.NULL
        if value in self._legal_values:
            self.value = value

    def offer(self, words: Iterable[tuple[str, str]]) -> None:
        """Offer other words; nothing is chosen then."""
        self.set_options([(Text(shown), meant) for shown, meant in words])
