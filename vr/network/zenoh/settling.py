"""Presence without flutter: a token that goes and returns within a moment has not gone.

When a link is made anew, tokens vanish and return within some 10 ms (measured with Zenoh 1.10.2), and nobody
should lose a robot for that.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterable

from robotree.vr.base.presence import PresenceHandler

SETTLE = 0.05
"""[s] for which a token must stay away until it counts as gone."""


class Settling:
    """Passes on arrivals at once and departures when they have settled. Lives on the event loop."""

    def __init__(self, handler: PresenceHandler, settle: float = SETTLE) -> None:
        """Tell `handler`; `settle` is the time [s] for which a departure is held back."""
        self._handler = handler
        self._settle = settle
        self._loop = asyncio.get_running_loop()
        self._there: set[str] = set()
        self._leaving: dict[str, asyncio.TimerHandle] = {}
        self._awaited: set[str] = set()
        self._complete: asyncio.Future[None] | None = None

    async def hear_of(self, keys: Iterable[str], limit: float) -> None:
        """Wait until something was heard of all these keys, or for `limit` [s]. Once at a time."""
        self._awaited = set(keys) - self._there
        if not self._awaited:
            return
        self._complete = self._loop.create_future()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(limit):
                await self._complete

    def change(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler itself
        """Take a report of the network."""
        self._awaited.discard(key)
        if not self._awaited and self._complete is not None and not self._complete.done():
            self._complete.set_result(None)
        leaving = self._leaving.pop(key, None)
        if leaving is not None:
            leaving.cancel()
        if not there and key in self._there:
            self._leaving[key] = self._loop.call_later(self._settle, self._gone, key)
        elif there and key not in self._there:
            self._there.add(key)
            self._handler(key, True)

    def _gone(self, key: str) -> None:
        self._leaving.pop(key, None)
        self._there.discard(key)
        self._handler(key, False)
