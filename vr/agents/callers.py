"""What ends with the program that has asked for it: commands, and drills.

Each caller stays present for as long as its call goes on. A caller without a bond, an operator's program,
names the key under which it is present in its call. When that key goes, because its process was killed,
stopped or cut off, its commands end. A parent needs no such key: with its presence the bond ends, and with
the bond its commands.

A drill is what a robot suffers on purpose, for a while, because a person has asked for it. It ends after
its time, at the latest when the program that asked is present no more. Until then the state of the robot
says what it is and who has asked, so each screen of the realm can.
"""

from __future__ import annotations

import asyncio
import logging
import math
from functools import partial
from typing import Protocol, runtime_checkable

from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.errors import NoDrill
from robotree.vr.base.presence import Presence, Undo
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import Disturb, Done
from robotree.vr.core import events as on
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.runner import soon

ARRIVAL = 0.5
"""[s] that the news of a caller's presence may come later than its call: they take different connections."""
LONGEST_DRILL = 3600.0
"""[s]"""
DRILL_ARRIVAL = 1.0
"""[s] that the news of the presence of who asks for a drill may come later than its request."""
LONGEST_DELAY = 60.0
"""[s] on a link, in a drill."""
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


@runtime_checkable
class Disturbable(Protocol):
    """A robot with a link that can be disturbed."""

    def disturb(self, *, cut: bool, delay: float) -> None:
        """Lose everything on the link, or deliver it `delay` [s] later; neither: the link is as it was."""
        ...


class Drills:
    """The drill of one robot. Lives on the event loop."""

    def __init__(self, runtime: RobotRuntime, presence: Presence) -> None:
        """Begin without any."""
        self._runtime, self._presence = runtime, presence
        self._loop = asyncio.get_running_loop()
        self._undo = list[Undo]()

    def take(self, request: Disturb, asker: Principal) -> Done:
        """Begin a drill, or end the one that goes on.

        Raises:
            NoDrill: the robot has no such link, or nobody is there with whom the drill would end.
        """
        if not request.fault:
            self.end("")
            return Done()
        self._expect(request, asker)
        self.end("")
        robot = self._runtime.robot
        words = f"{request.fault}, by {asker.person or asker.user}"
        if request.fault in {"cut", "delay"}:
            assert isinstance(robot, Disturbable)  # noqa: S101 # expected above
            robot.disturb(cut=request.fault == "cut", delay=request.delay)
            self._undo.append(lambda: robot.disturb(cut=False, delay=0.0))
        if request.fault == "delay":
            words = f"delay of {request.delay:g} s, by {asker.person or asker.user}"
        timer = self._loop.call_later(request.seconds, self.end, "its time is over")
        self._undo += [timer.cancel, self._presence.watch(asker.agent, self._look)]
        self._undo.append(self._loop.call_later(DRILL_ARRIVAL, self._expect_asker, asker.agent).cancel)
        self._runtime.log.say("warning", f"drill: {words}, for {request.seconds:g} s at most")
        self._show(words)
        return Done(note=words)

    def _expect(self, request: Disturb, asker: Principal) -> None:
        robot, reason = self._runtime.robot, ""
        linked = isinstance(robot, Disturbable) and not isinstance(robot, VirtualRobot)
        if asker.site or asker.assistant or not asker.person:
            reason = "only a person at its machine can ask for one"
        elif not asker.agent:
            reason = "the program that asks is not present, so it would not end with it"
        elif not (math.isfinite(request.seconds) and 0.0 < request.seconds <= LONGEST_DRILL):
            reason = f"it lasts more than 0 and at most {LONGEST_DRILL:g} s"
        elif not (math.isfinite(request.delay) and 0.0 <= request.delay <= LONGEST_DELAY):
            reason = f"a delay is 0 to {LONGEST_DELAY:g} s"
        elif request.fault in {"cut", "delay"} and not linked:
            reason = "it has no link to a controller; name the robot below it that has one"
        if reason:
            raise NoDrill(robot=robot.name, reason=reason)

    def _show(self, words: str) -> None:
        self._runtime.drill = words
        self._runtime.changed()

    def _look(self, _key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        if not there:
            self._loop.call_soon_threadsafe(self.end, "who has asked for it is gone")

    def _expect_asker(self, key: str) -> None:
        if not self._presence.there(key):
            self.end("who has asked for it is gone")

    def end(self, reason: str) -> None:
        """End the drill, if one goes on; `reason` is a clause for the log."""
        if not self._undo:
            return
        undo, self._undo = self._undo, []
        for each in undo:
            each()
        self._runtime.log.say("info", f"the drill is over{': ' if reason else ''}{reason}")
        self._show("")
