"""The refusals of this process, in the log: one line a second for each kind, however often it happens.

A program that tries again and again must not fill the log, nor cost the time to write it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Final, Literal

from robotree.vr.base.system import THIS_SYSTEM, System

EVERY: Final = 1.0
"""[s] at least between two lines of one kind."""

RefusalKind = Literal["user", "identity", "nonsense", "silent", "crowd", "keys", "deaf", "descriptors"]
"""Of a refusal: another user; not the process that it says it is; no frames of ours; no hello; too many
connections; too many keys; reads nothing; no free descriptor here."""


class Refusals:
    """Writes them down. From any thread."""

    def __init__(
        self, log: logging.Logger, clock: Callable[[], float] | None = None, system: System = THIS_SYSTEM
    ) -> None:
        """Begin with none.

        Args:
            log: takes the lines.
            clock: [s]; None: the system's.
            system: whose threads refuse.
        """
        self._log, self._clock = log, clock or system.now
        self._lock = system.lock()
        self._next: dict[RefusalKind, float] = {}
        """[s] when the next line of a kind may be written."""
        self._more: dict[RefusalKind, tuple[int, str]] = {}
        """How many there were since the last line of a kind, and the text of the last one."""

    def note(self, kind: RefusalKind, text: str) -> None:
        """Write a refusal down, now or together with others of its kind.

        Args:
            kind: of refusal.
            text: for people: who was refused, why, and what to do.
        """
        now = self._clock()
        with self._lock:
            written = now >= self._next.get(kind, now) and kind not in self._more
            if written:
                self._next[kind] = now + EVERY
            else:
                self._more[kind] = (self._more.get(kind, (0, ""))[0] + 1, text)
        if written:
            self._log.warning("%s", text)

    def write(self) -> None:
        """Write down what waits and is due; to be called again and again."""
        if not self._more:
            return
        now = self._clock()
        with self._lock:
            kinds: list[RefusalKind] = [kind for kind in self._more if now >= self._next[kind]]
            due = [self._more.pop(kind) for kind in kinds]
            for kind in kinds:
                self._next[kind] = now + EVERY
        for count, text in due:
            self._log.warning("%s%s", text, f" (and {count - 1} more of this kind)" if count > 1 else "")
