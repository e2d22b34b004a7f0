"""Drills: what a robot suffers on purpose, for a while, because a person has asked for it.

It ends after its time, at the latest when the program that asked is present no more: also one that was
killed. Until then the state of the robot says what it is and who has asked, so each screen of the realm can.
"""

from __future__ import annotations

import asyncio
import math
from typing import Protocol, runtime_checkable

from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.errors import NoDrill
from robotree.vr.base.presence import Presence, Undo
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import Disturb, Done
from robotree.vr.running.robot_runtime import RobotRuntime

LONGEST = 3600.0
"""[s] of one drill."""

LONGEST_DELAY = 60.0
"""[s] on a link."""

ARRIVAL = 1.0
"""[s] that the news of the asker's presence may come later than its request."""


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
        self._undo.append(self._loop.call_later(ARRIVAL, self._expect_asker, asker.agent).cancel)
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
        elif not (math.isfinite(request.seconds) and 0.0 < request.seconds <= LONGEST):
            reason = f"it lasts more than 0 and at most {LONGEST:g} s"
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
