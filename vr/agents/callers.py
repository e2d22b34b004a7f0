"""Commands end with those who have called them: each caller stays present for as long as its call goes on.

A caller without a bond, an operator's program, names the key under which it is present in its call. When that
key goes, because its process was killed, stopped or cut off, its commands end. A parent needs no such key:
with its presence the bond ends, and with the bond its commands.
"""

from __future__ import annotations

import asyncio
import logging
from functools import partial

from robotree.vr.base.presence import Presence, Undo
from robotree.vr.core import events as on
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.runner import soon

ARRIVAL = 0.5
"""[s] that the news of a caller's presence may come later than its call: they take different connections."""
LINGER = 10.0
"""[s] after which a caller that has not called again is watched no more; at most twice that."""

GONE = "its caller has gone (`robotree call --detach` lets a command go on)"

_log = logging.getLogger(__name__)


class Callers:
    """The callers of one robot's commands. Who calls what is noted in any thread; the event loop watches.

    A caller that calls again and again is watched once: the loop is not woken for each of its calls.
    """

    def __init__(self, runtime: RobotRuntime, presence: Presence) -> None:
        """Begin without any.

        Args:
            runtime: the robot.
            presence: shows which callers live.
        """
        self._runtime, self._presence = runtime, presence
        self._loop = asyncio.get_running_loop()
        self._lock = runtime.process.runner.lock()
        """Guards what follows; nothing else is locked while it is held."""
        self._watching: dict[str, Undo | None] = {}
        """By caller; None: it is about to begin."""
        self._operators: dict[str, Undo] = {}
        """The programs of operators who have control, or ask for it, by key."""
        self._recent: set[str] = set()
        """Callers that have called since it was last asked if they are still to be watched."""
        self._closed = False

    def attend(self, caller: str, key: str) -> None:
        """End a command when the last of those who have called it has gone. From any thread.

        Args:
            caller: key under which it is present.
            key: of the call.
        """
        self._runtime.attend(key, caller)
        with self._lock:
            unknown = caller not in self._watching
            self._recent.add(caller)
            if unknown:
                self._watching[caller] = None
        if unknown:
            soon(self._loop, partial(self._watch, caller))

    def watch_operators(self, agents: frozenset[str]) -> None:
        """Have an operator lose control when the program has gone. On the loop.

        Args:
            agents: keys under which those are present who have it, or ask for it.
        """
        for agent in self._operators.keys() - agents:
            self._operators.pop(agent)()
        for agent in () if self._closed else agents - self._operators.keys():
            self._operators[agent] = self._watch_operator(agent)

    def _watch_operator(self, agent: str) -> Undo:
        def lost() -> None:
            if not self._presence.there(agent):
                unix = self._runtime.process.runner.unix()
                self._runtime.post(on.OperatorGone(agent=agent, unix=unix))

        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            if not there:
                lost()

        end, timer = self._presence.watch(agent, look), self._loop.call_later(ARRIVAL, lost)

        def unwatch() -> None:
            end()
            timer.cancel()

        return unwatch

    def close(self) -> None:
        """Watch no caller any more."""
        self._closed = True
        self.watch_operators(frozenset())
        with self._lock:
            self._closed, watching = True, dict(self._watching)
            self._watching.clear()
        for unwatch in filter(None, watching.values()):
            unwatch()

    # -- on the loop ------------------------------------------------------------------------------

    def _watch(self, caller: str) -> None:
        if self._closed:
            return

        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            if not there:
                self._lost(caller)

        def arrived() -> None:
            timers.append(self._loop.call_later(LINGER, again))
            look(caller, self._presence.there(caller))

        def again() -> None:
            timers[:] = [self._loop.call_later(LINGER, again)]
            self._unwatch(caller, idle=True)

        end = self._presence.watch(caller, look)
        timers = [self._loop.call_later(ARRIVAL, arrived)]

        def unwatch() -> None:
            end()
            for timer in timers:
                timer.cancel()

        with self._lock:
            self._watching[caller] = unwatch

    def _unwatch(self, caller: str, *, idle: bool = False) -> None:
        """Watch a caller no more.

        Args:
            caller: the caller; its next call begins another watch.
            idle: only if it has not called since it was last asked, and no call of it goes on.
        """
        calls = idle and self._runtime.is_attended_by(caller)
        with self._lock:
            calls = calls or (idle and caller in self._recent)
            self._recent.discard(caller)
            unwatch = None if calls else self._watching.pop(caller, None)
        if unwatch is not None:
            unwatch()

    def _lost(self, caller: str) -> None:
        self._unwatch(caller)
        for key in self._runtime.lose(caller):
            _log.warning("%s: a command was ended, because its caller has gone", self._runtime.robot.name)
            self._runtime.cancel(key, GONE)
