"""The chronicle of a realm: which agents came, left, died, hung and were back, as one process saw it."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable

from robotree.vr.base.address import Address
from robotree.vr.base.places import Places
from robotree.vr.base.presence import Presence, Undo
from robotree.vr.base.requests import Level, LoggedLine, Remembered

KEPT = 2000
"""Lines."""
EVERYBODY = "*/*/*"
APART = 3.0
"""[s] between two notes of the same: what several processes saw differs by less."""

_FROM_AFAR = re.compile(r"\S+ \(\w+, site [^,)]+\) ")
"""How a note about an agent of another site begins: only its own machine knows its process."""

_AT = re.compile(r"\S+ \(\w+, site ([^,)]+)[,)]")
"""How a note about an agent begins, where the realm has several sites."""


def site_told(line: LoggedLine) -> str:
    """Return the site at which a note of a chronicle says that its agent is; empty: it does not say."""
    found = None if line.command else _AT.match(line.text)
    return found[1] if found else ""


def merged(lines: Iterable[Remembered]) -> list[Remembered]:
    """Return lines in the order of time; what several chronicles have counts once.

    What the chronicles of an agent's own site say of it counts more than what those of other sites saw.
    """
    ordered = sorted(lines, key=lambda one: one.line.unix)
    at_home = dict[str, list[float]]()
    for one in ordered:
        if not _FROM_AFAR.match(one.line.text):
            at_home.setdefault(one.line.key, []).append(one.line.unix)
    kept: list[Remembered] = []
    latest: dict[tuple[str, str], float] = {}
    for one in ordered:
        line = one.line
        if line.key and not line.command:  # of a chronicle
            if _FROM_AFAR.match(line.text) and _near(line.unix, at_home.get(line.key, ())):
                continue
            before = latest.get((line.key, line.text))
            latest[line.key, line.text] = line.unix
            if before is not None and line.unix - before < APART:
                continue
        kept.append(one)
    return kept


def _near(unix: float, others: Iterable[float]) -> bool:
    return any(abs(unix - other) < APART for other in others)


class Chronicle:
    """Remembers who came and went."""

    def __init__(self, presence: Presence, unix: Callable[[], float]) -> None:
        """Begin empty.

        Args:
            presence: of the process that keeps the chronicle.
            unix: returns the time [s] since 1970.
        """
        self._presence, self._unix = presence, unix
        self._sites = Places(presence)
        self._lines: deque[Remembered] = deque(maxlen=KEPT)
        self._number = 0
        self._places: dict[str, str] = {}
        """The process of each agent, by its key: `process 4711`; where the realm has several sites,
        `site lab, process 4711`; of an agent of another site `site hall`. Known only while that runs."""
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
        elif (place := self._places.get(key, "")).startswith("site ") and "," not in place:  # of another site
            self._end(key, "info", "is not seen any more")  # what became of it is told there
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
        if other := self._sites.site_of(key):
            return f"site {other}"
        own, where = self._sites.own, next((one.where for one in self._presence.held(key)), "")
        return f"site {own}, {where}" if own and where else where

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
