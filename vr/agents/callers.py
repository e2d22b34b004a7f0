"""Commands end with those who have called them: each caller stays present for as long as its call goes on.

A caller without a bond, an operator's program, names the key under which it is present in its call. When that
key goes, because its process was killed, stopped or cut off, its commands end. A parent needs no such key:
with its presence the bond ends, and with the bond its commands (`lease.py`).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from robotree.vr.errors import VrError
from robotree.vr.running.jobs import Job
from robotree.vr.transport import Registration, Transport

ARRIVAL = 0.5
"""[s] that the news of a caller's presence may come later than its call."""

GONE = "its caller has gone (`robotree call --detach` lets a command go on)"

_log = logging.getLogger(__name__)


class Callers:
    """The callers of one robot's commands. Lives on the event loop."""

    def __init__(self, robot: str, transport: Transport, cancel: Callable[[str, str], None]) -> None:
        """Begin without any.

        Args:
            robot: its name.
            transport: where callers are seen.
            cancel: ends the command of a key, for a reason.
        """
        self._robot, self._transport, self._cancel = robot, transport, cancel
        self._present: dict[str, set[str]] = {}
        """The callers of each command under way, by its key."""
        self._watching: dict[str, asyncio.Task[None]] = {}

    def attend(self, presence: str, job: Job) -> None:
        """End a command when the last of those who have called it has gone.

        Args:
            presence: key of the caller's presence.
            job: the command.
        """
        if job.outcome.done():
            return
        key = job.context.key
        if key not in self._present:
            self._present[key] = set()
            job.outcome.add_done_callback(lambda _: self._forget(key))
        self._present[key].add(presence)
        if presence not in self._watching:
            task = asyncio.get_running_loop().create_task(self._watch(presence))
            self._watching[presence] = task

    def close(self) -> None:
        """Look after nobody any more."""
        for task in self._watching.values():
            task.cancel()

    # -- inside -----------------------------------------------------------------------------------

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
            callers.discard(presence)
            if not callers:
                _log.warning("%s: a command was ended, because its caller has gone", self._robot)
                self._cancel(key, GONE)
