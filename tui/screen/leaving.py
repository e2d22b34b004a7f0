"""Screens that can be left once: the second of two hasty keys must not take away the page beneath."""

from __future__ import annotations

from textual.await_complete import AwaitComplete
from textual.screen import Screen, ScreenResultType


class Leaving(Screen[ScreenResultType]):
    """A screen that goes only when it is in front. Styles follow the first screen class: name this one last.

    Textual's `dismiss` takes away whatever is on top. A page on its way out, because its work is done,
    may still receive the operator's Escape; that must not reach the next page.
    """

    def dismiss(self, result: ScreenResultType | None = None) -> AwaitComplete:
        """Leave, if still in front. See `Screen.dismiss`."""
        return super().dismiss(result) if self.is_current else AwaitComplete()
