"""Text in a fixed number of terminal cells: clipped with `…`, padded, and harmless. Pure.

Names, kinds and hosts come from afar: they may be wide (two cells a character), combine, or steer a terminal.
"""

from __future__ import annotations

import re
from functools import lru_cache

from rich.cells import cell_len, set_cell_size

from robotree.tui.terminal import STEERING

CLIPPED = "…"
JOINER = "\u200d"
"""Makes one sign of two (emoji): at an end it would swallow what stands beside."""
_ENDS = re.compile(r"[^\S ]")
"""Line ends, tabulators and spaces of other widths."""


@lru_cache(maxsize=8192)
def seen(text: str) -> str:
    """Return a text in one line, without what steers a terminal instead of being seen."""
    return STEERING.sub("", " ".join(text.split())).strip(JOINER)


@lru_cache(maxsize=8192)
def spaced(text: str) -> str:
    """Return a text as `seen` does, with each of its spaces: between columns, or before a line of code."""
    return STEERING.sub("", _ENDS.sub(" ", text)).strip(JOINER)


@lru_cache(maxsize=8192)
def clip(text: str, room: int) -> str:
    """Return a text that takes at most `room` cells; what was cut ends with `…`."""
    shown = seen(text)
    if cell_len(shown) <= room:
        return shown
    return set_cell_size(shown, room - 1).rstrip(f" {JOINER}") + CLIPPED if room > 0 else ""


@lru_cache(maxsize=8192)
def fit(text: str, room: int) -> str:
    """Return a text that takes exactly `room` cells."""
    return set_cell_size(clip(text, room), max(room, 0))
