"""What the agents of a process share: its name, a timer for repeated work, and one view of who is listed."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import AsyncGenerator, Awaitable, Callable, Coroutine
from typing import Any

from robotree.vr.base.errors import TransportClosed
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.presence import Undo
from robotree.vr.base.transport import Transport
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.union import Change

_log = logging.getLogger(__name__)

ROUND = 1.0
"""[s] between two calls of the same action."""
PARTS = 10
"""Parts into which a round is divided: actions of many robots are spread over it."""


def loop_now() -> float:
    """Return the time [s] on the clock of the event loop."""
    return asyncio.get_running_loop().time()


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


class Beside:
    """Work that goes on beside everything else, until it ends or is cancelled. Lives on the event loop."""

    def __init__(self) -> None:
        """Begin with none."""
        self.tasks: dict[asyncio.Future[Any], None] = {}

    def begin(self, work: Coroutine[Any, Any, object]) -> None:
        """Have something done."""
        task = asyncio.ensure_future(work)
        self.tasks[task] = None
        task.add_done_callback(self.tasks.pop)

    def cancel(self) -> None:
        """Have nothing of it done any more."""
        for task in tuple(self.tasks):
            task.cancel()


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


class DirectoryTask:
    """Looks at who is listed, again and again: after a change, when it is woken, or after a pause."""

    def __init__(
        self,
        shared: Shared,
        transport: Transport,
        look: Callable[[Directory], Awaitable[float | None]],
        *,
        concerns: Callable[[Change], bool] = lambda _: True,
        failed: str,
    ) -> None:
        """Look at nothing yet.

        Args:
            shared: has the view of who is listed.
            transport: by which it is asked for.
            look: is called for each look; returns after how many seconds to look again, None: after a change.
            concerns: whether to look after a change.
            failed: sentence for the log of the process if a look raises.
        """
        self._shared, self._transport, self._look = shared, transport, look
        self._concerns, self._failed = concerns, failed
        self._task: asyncio.Task[None] | None = None
        self._wake = asyncio.Event()

    def begin(self) -> None:
        """Look from now on; twice is once."""
        if self._task is None:
            self._task = asyncio.ensure_future(self._follow())

    async def close(self) -> None:
        """Look no more."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])

    def wake(self) -> None:
        """Look again."""
        self._wake.set()

    def _changed(self, change: Change) -> None:
        if self._concerns(change):
            self.wake()

    async def _follow(self) -> None:
        try:
            async with self._shared.directory(self._transport) as directory:
                unwatch = directory.on_change(self._changed)
                try:
                    while True:
                        self._wake.clear()
                        pause = await self._look(directory)
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(pause):
                                await self._wake.wait()
                finally:
                    unwatch()
        except TransportClosed:
            return
        except Exception:  # noqa: BLE001 # the outermost handler of this task
            _log.exception("%s", self._failed)
