"""Happenings that were not passed to the rules yet."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from robotree.vr.scripts.happening import Happening

LONGEST = 500
"""Messages that may wait: more is a flood."""


class ScriptInbox:
    """Takes happenings from any thread; one command takes them out."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """Begin empty.

        Args:
            wake: has the command look that takes them out.
        """
        self._waiting: deque[Happening | int] = deque()
        self._wake = wake

    def put(self, happening: Happening | int) -> None:
        """Take in what happens, or the number of an act that has ended."""
        self._waiting.append(happening)
        self._wake()

    def put_back(self, number: int) -> None:
        """Take in the number of an act that has ended, to be taken out next."""
        self._waiting.appendleft(number)

    def offer(self, happening: Happening) -> bool:
        """Take in what somebody else says; return False if too much waits already."""
        if len(self._waiting) >= LONGEST:
            return False
        self.put(happening)
        return True

    def take(self) -> Happening | int | None:
        """Return the oldest one; None: nothing waits."""
        return self._waiting.popleft() if self._waiting else None
