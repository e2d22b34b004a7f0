"""The replies to one request, as they come in: an iterator that knows when to give up."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Self

from robotree.vr.errors import NoAnswer, TransportClosed, Unreachable, VrError


class Replies:
    """Filled by a transport on its event loop, emptied by whoever asked. May be abandoned at any time."""

    def __init__(self, key: str, timeout: float) -> None:
        """Start the clock: `timeout` seconds [s] from now on for the whole exchange with `key`."""
        self.key = key
        self._seconds = timeout
        self._loop = asyncio.get_running_loop()
        self._deadline = self._loop.time() + timeout
        self._bodies: deque[bytes] = deque()
        self._answered = False
        self._ended = False
        self._error: VrError | None = None
        self._news: asyncio.Future[None] | None = None

    def feed(self, body: bytes) -> None:
        """Add a reply."""
        if not self._ended:
            self._answered = True
            self._bodies.append(body)
            self._tell()

    def end(self) -> None:
        """There will be no more; if there was none at all, nobody was there."""
        if not self._ended and not self._answered:
            self._error = Unreachable(key=self.key)
        self._finish()

    def time_out(self) -> None:
        """The time is over, and the other side neither ended nor died."""
        if not self._ended:
            self._error = NoAnswer(key=self.key, seconds=self._seconds)
        self._finish()

    def shut(self) -> None:
        """This side has closed its transport."""
        if not self._ended:
            self._error = TransportClosed(key=self.key)
        self._finish()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> bytes:
        while not self._bodies and not self._ended:
            await self._wait()
        if self._bodies:
            return self._bodies.popleft()
        error, self._error = self._error, None
        if error is not None:
            raise error
        raise StopAsyncIteration

    async def _wait(self) -> None:
        self._news = self._loop.create_future()
        try:
            async with asyncio.timeout_at(self._deadline):
                await self._news
        except TimeoutError:
            self.time_out()
        finally:
            self._news = None

    def _finish(self) -> None:
        self._ended = True
        self._tell()

    def _tell(self) -> None:
        if self._news is not None and not self._news.done():
            self._news.set_result(None)
