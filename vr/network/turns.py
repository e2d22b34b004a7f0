"""From a network's threads to the event loop: what is urgent first, everything else a few at a time.

The loop takes what it is given in order. A flood of requests would therefore stand before the next lease
renewal, however far ahead that one came over the wire (`bench/urgent.py`).
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections import deque
from collections.abc import Callable

SHARE = 32
"""Things that are not urgent done in one go; then the loop's own tasks have a turn."""

_log = logging.getLogger(__name__)


class Turns:
    """Takes things to do in any thread, and does them on the event loop."""

    def __init__(self) -> None:
        """Begin with nothing to do, on the running loop."""
        self._loop = asyncio.get_running_loop()
        self._urgent: deque[Callable[[], object]] = deque()
        self._others: deque[Callable[[], object]] = deque()
        self._called = False

    def put(self, action: Callable[[], object], *, urgent: bool = False) -> bool:
        """Have something done; things of one urgency in their order. From any thread, never blocks.

        Returns:
            Whether it will be done; False: the loop is closed.
        """
        (self._urgent if urgent else self._others).append(action)
        if self._called:
            return True
        self._called = True
        try:
            self._loop.call_soon_threadsafe(self._take_turn)
        except RuntimeError:
            self._called = False
            return False
        return True

    def _take_turn(self) -> None:
        self._called = False  # before the last look, so that what comes now calls again
        for _ in range(SHARE):
            while self._urgent:
                self._do(self._urgent.popleft())
            if not self._others:
                return
            self._do(self._others.popleft())
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):
                self._loop.call_soon(self._take_turn)

    def _do(self, action: Callable[[], object]) -> None:
        try:
            action()
        except Exception:  # noqa: BLE001 # one thing's fault is not the others'
            _log.exception("what the network brought failed")
