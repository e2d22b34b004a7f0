"""What the agents of one process share: one table of who is present, and one timer for what is repeated."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from robotree.vr.errors import VrError
from robotree.vr.transport import PresenceHandler, Registration, Transport

ROUND = 1.0
"""[s] between two calls of the same action."""
PARTS = 10
"""Parts into which a round is divided: actions of many robots are spread over it."""

Undo = Callable[[], None]
"""Takes back what was declared. Twice is once."""


class Presence:
    """Who is present in the realm. Lives on the event loop; `there` may be asked in any thread."""

    def __init__(self, transport: Transport) -> None:
        """Prepare; nobody is present before `start`."""
        self._transport = transport
        self._there: set[str] = set()
        self._watchers: dict[str, dict[object, PresenceHandler]] = {}
        self._watching: asyncio.Future[Registration] | None = None

    async def start(self) -> None:
        """See who comes and goes from now on. Twice is once.

        Raises:
            TransportError: the transport does not work.
        """
        if self._watching is None:
            self._watching = asyncio.ensure_future(self._transport.watch("**", self._see))
        await asyncio.shield(self._watching)

    async def close(self) -> None:
        """Look no more. Twice is once."""
        watching, self._watching = self._watching, None
        if watching is not None:
            with contextlib.suppress(VrError):
                await (await watching).close()

    def there(self, key: str) -> bool:
        """Whether anything is present under a key."""
        return key in self._there

    def watch(self, key: str, handler: PresenceHandler) -> Undo:
        """See one key come and go: first if it is there already, then each change."""
        mark = object()
        self._watchers.setdefault(key, {})[mark] = handler
        if key in self._there:
            handler(key, True)

        def undo() -> None:
            watchers = self._watchers.get(key, {})
            if watchers.pop(mark, None) is not None and not watchers:
                del self._watchers[key]

        return undo

    def _see(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        (self._there.add if there else self._there.discard)(key)
        for handler in list(self._watchers.get(key, {}).values()):
            handler(key, there)


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
    """All that the agents of one process share beside threads and the lookup services' leases."""

    def __init__(self, transport: Transport, host: str = "") -> None:
        """Make it, on the event loop.

        Args:
            transport: of the process.
            host: name of the process, for people; empty: it is that of one robot only.
        """
        self.host = host
        self.presence = Presence(transport)
        self.rounds = Rounds()
