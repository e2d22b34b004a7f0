"""The chronicle of a realm: which agents came, left, died, hung and were back, as one process saw it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable

from robotree.vr.base.address import Address
from robotree.vr.base.presence import Presence, Undo
from robotree.vr.base.requests import Level, LoggedLine, Remembered

KEPT = 2000
"""Lines."""
EVERYBODY = "*/*/*"
APART = 3.0
"""[s] between two notes of the same: what several processes saw differs by less."""


def merged(lines: Iterable[Remembered]) -> list[Remembered]:
    """Return lines in the order of time; what several chronicles have counts once."""
    kept: list[Remembered] = []
    latest: dict[tuple[str, str], float] = {}
    for one in sorted(lines, key=lambda one: one.line.unix):
        line = one.line
        if line.key and not line.command:  # of a chronicle
            before = latest.get((line.key, line.text))
            latest[line.key, line.text] = line.unix
            if before is not None and line.unix - before < APART:
                continue
        kept.append(one)
    return kept


class Chronicle:
    """Remembers who came and went."""

    def __init__(self, presence: Presence, unix: Callable[[], float]) -> None:
        """Begin empty.

        Args:
            presence: of the process that keeps the chronicle.
            unix: returns the time [s] since 1970.
        """
        self._presence, self._unix = presence, unix
        self._lines: deque[Remembered] = deque(maxlen=KEPT)
        self._number = 0
        self._places: dict[str, str] = {}
        """The process of each agent, by its key: `process 4711`. It is known only while that runs."""
        self._hang: set[str] = set()
        """Keys of agents whose processes hang."""

    @property
    def lines(self) -> tuple[Remembered, ...]:
        """All lines that are kept, the oldest first."""
        return tuple(self._lines)

    def begin(self) -> Undo:
        """Take from now on what presence reports; returns how to end that."""
        self._places = {key: self._place(key) for key in self._presence.keys(EVERYBODY)}
        return self._presence.watch(EVERYBODY, self.seen)

    def seen(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        """Take that an agent is present now, or no more."""
        presence = self._presence
        if there:
            new = key not in self._places
            self._places[key] = self._place(key)
            if key in self._hang:
                self._hang.discard(key)
                self._tell(key, "info", "answers again")
            elif new:
                self._tell(key, "info", "has come")
        elif presence.left(key):
            self._end(key, "info", "has left")
        elif presence.hangs(key):
            self._hang.add(key)
            self._tell(key, "error", "hangs and does not answer")
        else:
            self._end(key, "error", "has died: its process has gone")

    def look(self) -> None:
        """Note which of the agents that hung have ended since: presence has reported their end before."""
        for key in sorted(self._hang):
            if not self._presence.lives(key):
                self.seen(key, there=False)

    def _place(self, key: str) -> str:
        return next((one.where for one in self._presence.held(key)), "")

    def _end(self, key: str, level: Level, words: str) -> None:
        self._tell(key, level, words)
        self._hang.discard(key)
        self._places.pop(key, None)

    def _tell(self, key: str, level: Level, words: str) -> None:
        address = Address.parse(key)
        if address is None:
            return
        self._number += 1
        about = ", ".join(filter(None, (address.role, self._places.get(key, ""))))
        text = f"{address.name} ({about}) {words}"
        self._lines.append(
            Remembered(address.name, LoggedLine(self._number, self._unix(), level, text, key=key))
        )
