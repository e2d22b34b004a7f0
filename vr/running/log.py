"""The log of one robot: the output of its code, and how its commands ended.

A log keeps the last `KEPT` lines, and takes `BURST` lines at once and `RATE` a second after that; of what
comes quicker it says how many lines were dropped.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from robotree.vr.base.requests import Level, LoggedLine

KEPT = 500
"""Lines of each robot."""
LONGEST = 500
"""Characters of a line."""
BURST, RATE = 200, 50.0
"""Lines at once, and lines a second."""


class Log:
    """See the module. Its methods may be called from any thread."""

    def __init__(self, now: Callable[[], float], unix: Callable[[], float]) -> None:
        """Begin empty.

        Args:
            now: returns the time [s] on a monotonic clock.
            unix: returns the time [s] since 1970.
        """
        self.on_line: Callable[[], None] = lambda: None
        """Called at the first new line since somebody has asked for lines. In any thread: must be quick."""
        self._news = False
        """Whether there are lines that nobody has asked for."""
        self._now, self._unix = now, unix
        self._lines: deque[LoggedLine] = deque(maxlen=KEPT)
        self._lock = threading.Lock()
        self._number = 0
        self._room, self._at = float(BURST), now()
        self._dropped = 0
        self.begun: dict[str, str] = {}
        """Lines that have no end yet, by command and level."""

    def write(self, key: str, level: Level, text: str) -> None:
        """Take a piece of text; what has no line break yet waits for it.

        Args:
            key: of the command that says it; empty: none does.
            level: how important it is.
            text: of any length.
        """
        place = f"{key}|{level}"
        *whole, rest = (self.begun.pop(place, "") + text).split("\n")
        if len(rest) > LONGEST:
            whole, rest = [*whole, rest], ""
        if rest:
            self.begun[place] = rest
        for line in whole:
            self.say(level, line)

    def end(self, key: str) -> None:
        """A command has ended: log its last output, which has no line break."""
        for place in [one for one in self.begun if one.rpartition("|")[0] == key]:
            level: Any = place.rpartition("|")[2]
            self.say(level, self.begun.pop(place))

    def say(self, level: Level, text: str, command: str = "") -> None:
        """Take a line; `command`: has ended so."""
        with self._lock:
            now = self._now()
            self._room = min(BURST, self._room + (now - self._at) * RATE)
            self._at = now
            if self._room < 1.0:
                self._dropped += 1
                return
            self._room -= 1.0
            if self._dropped:
                self._note_dropped()
            self._append(level, text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…", command)
            first, self._news = not self._news, True
        if first:
            self.on_line()

    def since(self, number: int) -> list[LoggedLine]:
        """Return the lines after the one of a number, the oldest first."""
        with self._lock:
            self._news = False
            if self._dropped:
                self._note_dropped()
            return [line for line in self._lines if line.number > number]

    def _note_dropped(self) -> None:
        """Say how many lines were dropped."""
        count, self._dropped = self._dropped, 0
        self._append("warning", f"{count} lines were dropped: it takes {RATE:g} a second")

    def _append(self, level: Level, text: str, command: str = "") -> None:
        self._number += 1
        self._lines.append(LoggedLine(self._number, self._unix(), level, text, command))
