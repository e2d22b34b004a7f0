"""The readings of a child as it publishes them, for one running command."""

from __future__ import annotations

import itertools
from collections.abc import Callable

from robotree.vr.author.readings import Record
from robotree.vr.base.requests import State

_numbers = itertools.count(1)


class NoReadingYet(BaseException):
    """Nothing has been published yet; no `Exception`, so that a condition of a page does not catch it."""


class Feed:
    """What the child in one slot publishes. Its methods may be called in any thread."""

    number: int = 0
    """Of the latest news, counted over all feeds of the process; 0: there was none."""
    over: bool = False
    """Whether the child has left the slot."""
    latest: Record | None = None
    """The latest readings; None: there were none."""
    state: State | None = None
    """The latest state, of which they are a part; None: there was none."""

    def __init__(self, wake: Callable[[], None]) -> None:
        """Take how to tell the command that there is news."""
        self._wake = wake
        self.close: Callable[[], None] = _nothing
        """Has nothing more taken."""

    def take(self, state: State) -> None:
        """Take what was published."""
        self.state, self.latest = state, Record(state.readings)
        self.number = next(_numbers)
        self._wake()

    def has_news(self, after: int) -> bool:
        """Whether there is news that is newer than the one numbered `after`."""
        return self.number > after

    def end(self) -> None:
        """The child has left the slot."""
        self.over, self.number = True, next(_numbers)
        self._wake()


def _nothing() -> None:
    """Nothing is taken yet."""
