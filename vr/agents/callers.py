"""Commands end with those who have called them: each caller stays present for as long as its call goes on.

A caller without a bond, an operator's program, names the key under which it is present in its call. When that
key goes, because its process was killed, stopped or cut off, its commands end. A parent needs no such key:
with its presence the bond ends, and with the bond its commands.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging

from robotree.vr.agents.shared import Presence, Undo
from robotree.vr.requests import Raised, Returned
from robotree.vr.running.live import LiveRobot

ARRIVAL = 0.5
"""[s] that the news of a caller's presence may come later than its call."""

GONE = "its caller has gone (`robotree call --detach` lets a command go on)"

_log = logging.getLogger(__name__)


class Callers:
    """The callers of one robot's commands. Lives on the event loop."""

    def __init__(self, live: LiveRobot, presence: Presence) -> None:
        """Begin without any.

        Args:
            live: the robot.
            presence: shows which callers live.
        """
        self._live, self._presence = live, presence
        self._loop = asyncio.get_running_loop()
        self._present: dict[str, dict[str, None]] = {}
        """The callers of each command under way, by its key."""
        self._watching: dict[str, Undo] = {}

    def attend(self, caller: str, key: str) -> None:
        """End a command when the last of those who have called it has gone. From any thread.

        Args:
            caller: key under which it is present.
            key: of the call.
        """
        with contextlib.suppress(RuntimeError):  # the loop is closed: the robot ends itself
            self._loop.call_soon_threadsafe(self._attend, caller, key)

    def close(self) -> None:
        """Watch no caller any more."""
        for unwatch in self._watching.values():
            unwatch()
        self._watching.clear()

    # -- inside -----------------------------------------------------------------------------------

    def _attend(self, caller: str, key: str) -> None:
        if key not in self._present:
            if not self._live.listen(key, _End(self, key)):
                return  # it has ended already
            self._present[key] = {}
        self._present[key][caller] = None
        if caller not in self._watching:
            self._watch(caller)

    def ended(self, key: str) -> None:
        """A command has ended. From any thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._forget, key)

    def _forget(self, key: str) -> None:
        for caller in self._present.pop(key, ()):
            if not any(caller in callers for callers in self._present.values()):
                self._unwatch(caller)

    def _watch(self, caller: str) -> None:
        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            if not there:
                self._lost(caller)

        def arrived() -> None:
            look(caller, self._presence.there(caller))

        end, late = self._presence.watch(caller, look), self._loop.call_later(ARRIVAL, arrived)

        def unwatch() -> None:
            end()
            late.cancel()

        self._watching[caller] = unwatch

    def _unwatch(self, caller: str) -> None:
        if (unwatch := self._watching.pop(caller, None)) is not None:
            unwatch()

    def _lost(self, caller: str) -> None:
        self._unwatch(caller)
        for key, callers in list(self._present.items()):
            if caller not in callers:
                continue
            del callers[caller]
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
