"""Things that the agents of one process share: its name, and one timer for repeated work."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Callable

from robotree.vr.base.permissions import Isolation
from robotree.vr.base.presence import Undo
from robotree.vr.base.transport import Transport
from robotree.vr.lookup.directory import Directory

ROUND = 1.0
"""[s] between two calls of the same action."""
PARTS = 10
"""Parts into which a round is divided: actions of many robots are spread over it."""


class Rounds:
    """Calls many actions again and again, each once in `ROUND`. Lives on the event loop."""

    def __init__(self) -> None:
        """Begin with none."""
        self._loop = asyncio.get_running_loop()
        self._parts: list[dict[Callable[[], None], None]] = [{} for _ in range(PARTS)]
        self._waiting = False

    def add(self, action: Callable[[], None]) -> Undo:
        """Call an action in each round; it must not raise."""
        part = min(self._parts, key=len)
        part[action] = None
        if not self._waiting:
            self._wait(0)

        def undo() -> None:
            part.pop(action, None)

        return undo

    def _wait(self, after: int) -> None:
        """Wait for the next part in which there is anything, or for nothing."""
        steps = next((n for n in range(1, PARTS + 1) if self._parts[(after + n) % PARTS]), 0)
        self._waiting = steps > 0
        if self._waiting:
            self._loop.call_later(steps * ROUND / PARTS, self._turn, (after + steps) % PARTS)

    def _turn(self, number: int) -> None:
        self._wait(number)
        for action in list(self._parts[number]):
            action()


class Shared:
    """All that the agents of one process share beside transport, threads and the lookup services' leases."""

    def __init__(self, host: str = "", isolation: Isolation = "none") -> None:
        """Make it, on the event loop.

        Args:
            host: name of the process, for people; empty: it is that of one robot only.
            isolation: of the robots in this process.
        """
        self.host = host
        self.isolation: Isolation = isolation
        self.rounds = Rounds()
        self._directory: Directory | None = None
        self._viewers = 0
        self._opening = asyncio.Lock()

    @contextlib.asynccontextmanager
    async def directory(self, transport: Transport) -> AsyncGenerator[Directory]:
        """See who is listed, as long as the context lasts: one view for all robots of the process."""
        async with self._opening:
            if self._directory is None:
                self._directory = Directory(transport)
                await self._directory.start()
            self._viewers += 1
            directory = self._directory
        try:
            yield directory
        finally:
            self._viewers -= 1
            if not self._viewers and self._directory is directory:
                self._directory = None
                await directory.close()
