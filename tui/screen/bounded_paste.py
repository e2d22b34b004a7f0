"""A paste that has a largest size.

A terminal says where a paste begins and where it ends. Textual gathers what comes between (8.2.8,
`XTermParser.parse`), so one whose end never comes, from a broken terminal or of a file that somebody pipes
into one, would fill the memory. What is beyond `LONGEST` is left out here, and what comes behind the end are
keys again.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Final

from textual._xterm_parser import XTermParser
from textual.message import Message

LONGEST: Final = 100_000
"""[characters] of one paste that are kept: no field takes as many."""
BEGIN, END = "\x1b[200~", "\x1b[201~"
"""What a terminal sends around a paste (xterm, bracketed paste mode)."""

log = logging.getLogger(__name__)


class BoundedPaste(XTermParser):
    """Textual's reader of what a terminal sends; see the module."""

    _room: int | None = None
    """Characters that the paste may still have; None: nothing is being pasted."""
    _last = ""
    """What was read last: outside of a paste the begin of `BEGIN` may be in it; inside, that of `END`."""

    def feed(self, data: str) -> Iterable[Message]:
        """Read on; `data` is empty at the end."""
        kept = self._bounded(data)
        return super().feed(kept) if kept or not data else ()

    def _bounded(self, data: str) -> str:
        kept = ""
        while data:
            if self._room is None:
                seen = self._last + data
                at = seen.find(BEGIN)
                cut = len(data) if at < 0 else at + len(BEGIN) - len(self._last)
                self._last = seen[1 - len(BEGIN) :] if at < 0 else ""
                self._room = None if at < 0 else LONGEST
                kept, data = kept + data[:cut], data[cut:]
                continue
            inside, end, data = (self._last + data).partition(END)
            begun = 0 if end else next((n for n in range(len(END) - 1, 0, -1) if inside.endswith(END[:n])), 0)
            self._last = inside[len(inside) - begun :]
            inside = inside[: len(inside) - begun]
            if len(inside) > self._room > 0:
                log.warning("a paste has more than %d characters: the rest is left out", LONGEST)
            kept += inside[: self._room] + end
            self._room = None if end else max(self._room - len(inside), 0)
        return kept
