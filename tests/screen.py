"""What tests of the full screen need, over a realm in memory and over real processes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from textual._context import visible_screen_stack
from textual.app import App


def shows(text: str, words: Iterable[str]) -> bool:
    """Whether all words are on a screen; it is read once, for reading costs more than looking."""
    return all(word in text for word in words)


def text_of(app: App[Any]) -> str:
    """Return what is on the screen, without colours."""
    visible_screen_stack.set(app._background_screens)  # what a dialog leaves free is the page behind it
    strips = app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)
