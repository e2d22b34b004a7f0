"""Commands end with those who have called them: each caller stays present for as long as its call goes on.

A caller without a bond, an operator's program, names the key under which it is present in its call. When that
key goes, because its process was killed, stopped or cut off, its commands end. A parent needs no such key:
with its presence the bond ends, and with the bond its commands.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging

from robotree.vr.errors import VrError
from robotree.vr.requests import Raised, Returned
from robotree.vr.running.live import LiveRobot
from robotree.vr.transport import Registration, Transport

ARRIVAL = 0.5
"""[s] that the news of a caller's presence may come later than its call."""

GONE = "its caller has gone (`robotree call --detach` lets a command go on)"

_log = logging.getLogger(__name__)


class Callers:
    """The callers of one robot's commands. Lives on the event loop."""

    def __init__(self, live: LiveRobot, transport: Transport) -> None:
        """Begin without any.

        Args:
            live: the robot.
            transport: where callers are seen.
        """
        self._live, self._transport = live, transport
        self._loop = asyncio.get_running_loop()
        self._present: dict[str, dict[str, None]] = {}
        """The callers of each command under way, by its key."""
        self._watching: dict[str, asyncio.Task[None]] = {}

    def attend(self, presence: str, key: str) -> None:
        """End a command when the last of those who have called it has gone. From any thread.

        Args:
            presence: key of the caller's presence.
            key: of the call.
        """
        with contextlib.suppress(RuntimeError):  # the loop is closed: the robot ends itself
            self._loop.call_soon_threadsafe(self._attend, presence, key)

    def close(self) -> None:
        """Watch no caller any more."""
        for task in self._watching.values():
            task.cancel()

    # -- inside -----------------------------------------------------------------------------------

    def _attend(self, presence: str, key: str) -> None:
        if key not in self._present:
            if not self._live.listen(key, _End(self, key)):
                return  # it has ended already
            self._present[key] = {}
        self._present[key][presence] = None
        if presence not in self._watching:
            self._watching[presence] = self._loop.create_task(self._watch(presence))

    def ended(self, key: str) -> None:
        """A command has ended. From any thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._forget, key)

    def _forget(self, key: str) -> None:
        for presence in self._present.pop(key, ()):
            watching = self._watching.get(presence)
            if watching and not any(presence in callers for callers in self._present.values()):
                del self._watching[presence]
                watching.cancel()

    async def _watch(self, presence: str) -> None:
        came, gone = asyncio.Event(), asyncio.Event()
        watching: Registration | None = None
        try:
            watching = await self._transport.watch(
                presence, lambda _, there: came.set() if there else gone.set()
            )
            try:
                async with asyncio.timeout(ARRIVAL):
                    await came.wait()
            except TimeoutError:
                gone.set()
            await gone.wait()
        except VrError:  # the transport closes: the robot ends itself
            return
        finally:
            if watching is not None:
                await watching.close()
        self._lost(presence)

    def _lost(self, presence: str) -> None:
        self._watching.pop(presence, None)
        for key, callers in list(self._present.items()):
            callers.pop(presence, None)
            if not callers:
                _log.warning("%s: a command was ended, because its caller has gone", self._live.robot.name)
                self._live.cancel(key, GONE)


class _End:
    """Hears the end of one command: a `Listener`."""

    def __init__(self, callers: Callers, key: str) -> None:
        self._callers, self._key = callers, key

    def note(self, fraction: float, text: str) -> None:
        """See `Listener.note`."""

    def settle(self, reply: Returned | Raised) -> None:
        """See `Listener.settle`."""
        del reply
        self._callers.ended(self._key)
