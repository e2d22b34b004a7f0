"""Texts that others wrote, as they may be shown to people and to assistants: on one line, and cut. Pure."""

from __future__ import annotations

import unicodedata
from typing import Final

LONGEST: Final = 300
"""[characters] of one text of a robot or of an assistant."""


def bounded(text: str, most: int = LONGEST) -> str:
    """Return a text on one line, without what cannot be seen and without marks, cut to a length.

    Args:
        text: of anybody.
        most: [characters]
    """
    if text.isascii() and text.isprintable():
        kept = text[: most * 4]
    else:
        kept = "".join(_shown(letter) for letter in text[: most * 4])
    kept = " ".join(kept.split())
    return kept if len(kept) <= most else f"{kept[: most - 1]}…"


def _shown(letter: str) -> str:
    """Return a character as it may be shown: none that is invisible, steers the terminal, or is a mark."""
    if letter in "«»":
        return "'"
    if letter in "\n\r\t":
        return " "
    return "" if unicodedata.category(letter) in {"Cc", "Cf", "Co", "Cs", "Cn", "Zl", "Zp"} else letter
