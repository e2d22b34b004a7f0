"""What a network brings for one handler, on its way to the event loop: in order, one at each of its turns."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

from robotree.vr.network.turns import Turns

T = TypeVar("T")


class Inbox(Generic[T]):
    """Takes items in any thread, hands them on the event loop to one handler.

    However many wait, they take one place among the turns: others come between any two of them.
    """

    def __init__(self, turns: Turns, handler: Callable[[T], None], limit: int | None = None) -> None:
        """Hand items to `handler` at their turn; of more than `limit` that wait, the oldest are lost."""
        self._turns = turns
        self._handler: Callable[[T], None] | None = handler
        self._items: deque[T] = deque(maxlen=limit)
        self._in_line = False

    def put(self, item: T) -> None:
        """Take an item. From any thread, at any time, even when the loop is long over; never blocks."""
        self._items.append(item)
        self._line_up()

    def close(self) -> None:
        """Hand on nothing any more."""
        self._handler = None
        self._items.clear()

    def _line_up(self) -> None:
        if not self._in_line:
            self._in_line = True
            if not self._turns.put(self._take_turn):
                self._items.clear()  # the loop is closed: nobody is left to tell

    def _take_turn(self) -> None:
        self._in_line = False  # before the last look, so that an item which comes now lines up again
        handler = self._handler
        if handler is None or not self._items:
            return
        item = self._items.popleft()
        if self._items:
            self._line_up()
        handler(item)
