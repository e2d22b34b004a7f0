"""From a network's threads to the event loop: many items, one wake-up."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")
_log = logging.getLogger(__name__)


class Inbox(Generic[T]):
    """Takes items in any thread, hands them on the event loop to one handler, in their order."""

    def __init__(self, handler: Callable[[T], None], limit: int | None = None) -> None:
        """Hand items to `handler`; of more than `limit` that wait, the oldest are lost."""
        self._handler: Callable[[T], None] | None = handler
        self._loop = asyncio.get_running_loop()
        self._items: deque[T] = deque(maxlen=limit)
        self._called = False

    def put(self, item: T) -> None:
        """Take an item. From any thread, at any time, even when the loop is long over; never blocks."""
        self._items.append(item)
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is left to tell
                self._loop.call_soon_threadsafe(self.drain)

    def drain(self) -> None:
        """Hand on what is there. On the loop only."""
        self._called = False  # before the last look, so that an item which comes now calls again
        while self._items and self._handler is not None:
            try:
                self._handler(self._items.popleft())
            except Exception:  # noqa: BLE001 # one handler's fault is not the others'
                _log.exception("a handler raised")

    def close(self) -> None:
        """Hand on nothing any more."""
        self._handler = None
        self._items.clear()
