"""The Companion's own page, run in virtual time: its children are the controller's components themselves.

What a proxy would ask the controller, an operator of `sim.testing` asks here, over real frames; `sleep` lets
the world go on. So a handing over takes seconds of processor time, and a seed decides all of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from robotree.protocol.messages import BaseState, Gripper, GripperState, Speech, SysStatus, Tags, Tool, Verb
from robotree.protocol.messages import GoalState as State
from robotree.proxy.limb import POINTING
from robotree.sim.kinds import HEAD
from robotree.sim.testing import NAN, CompanionBench, Operator
from robotree.vr.base.errors import CommandFailed
from robotree.vr.bundle import Bundle

PAGE = Path(__file__).parents[3] / "examples" / "companion" / "companion.py"


class _UnderWay:
    """A movement that has been asked for; time goes on while somebody waits for its end."""

    def __init__(self, operator: Operator, key: int, verb: Verb) -> None:
        self._operator, self._key, self._verb = operator, key, verb

    def result(self, timeout: float = 120.0) -> None:
        answer = self._operator.end_of(self._key, timeout)
        if State(answer.state) != State.SUCCEEDED:
            raise CommandFailed(robot=self._verb.name, command=self._verb.name.lower(), detail=answer.text)

    def cancel(self) -> None:
        self._operator.cancel(self._key)


class _Movement:
    """A command of a part: called, or begun."""

    def __init__(self, begin: Callable[..., _UnderWay]) -> None:
        self.start = begin

    def __call__(self, **arguments: Any) -> None:
        self.start(**arguments).result()


class _Part:
    """A child that is an operator's component."""

    def __init__(self, operator: Operator) -> None:
        self.operator = operator
        self.asked = 0

    def __getattr__(self, name: str) -> _Movement:
        return _Movement(getattr(type(self), f"_{name}").__get__(self))

    def do(self, verb: Verb, *args: float) -> _UnderWay:
        self.asked += 1
        return _UnderWay(self.operator, self.operator.ask(verb, *args), verb)


class _Limb(_Part):
    def _reach(self, x: float, y: float, z: float, hand: str = "any", speed: float = 0.25) -> _UnderWay:
        return self.do(Verb.REACH, x, y, z, *POINTING[hand], speed)

    def _posture(self, speed: float = 0.25, **joints: float) -> _UnderWay:
        return self.do(Verb.POSTURE, *(joints[f"j{i}"] for i in range(1, 7)), speed)

    def _grip(self, action: str) -> _UnderWay:
        return self.do(Verb.GRIP, 0.08 if action == "open" else 0.0)

    def get_info(self) -> Any:
        self.operator.wait(0.15)
        tool, gripper = self.operator.latest(Tool), self.operator.latest(Gripper)
        return SimpleNamespace(fz=tool.fz, width=gripper.width, holding=gripper.state == GripperState.HOLDING)


class _Base(_Part):
    def _drive(self, x: float, y: float, heading: float, speed: float = 0.4) -> _UnderWay:
        return self.do(Verb.DRIVE, x, y, heading, speed)

    def _move(self, x: float, y: float, speed: float = 0.4) -> _UnderWay:
        return self.do(Verb.MOVE, x, y, speed)

    def _turn(self, heading: float) -> _UnderWay:
        return self.do(Verb.TURN, heading)

    def _lean(self, angle: float) -> _UnderWay:
        return self.do(Verb.LEAN, angle)

    def get_info(self) -> Any:
        self.operator.wait(0.15)
        state = self.operator.latest(BaseState)
        heading = math.remainder(state.heading, math.tau)
        battery = self.operator.latest(SysStatus).battery_remaining / 100
        return SimpleNamespace(x=state.x, y=state.y, heading=heading, battery=battery)


class _Head(_Part):
    def _look(self, pan: float, tilt: float, rate: float = 1.5) -> _UnderWay:
        return self.do(Verb.LOOK, pan, tilt, rate)

    def say(self, text: str) -> None:
        self.operator.say(Speech(0, 1 + self.asked, 1, HEAD, 0, text))
        self.do(Verb.SAY, float(1 + self.asked)).result()

    def see(self, tag: int) -> Any:
        self.operator.wait(0.15)
        tags = self.operator.latest(Tags)
        for i in range(tags.count):
            if tags.tag[i] == tag:
                age = tags.age[i] / 100
                return SimpleNamespace(x=tags.x[i], y=tags.y[i], z=tags.z[i], age=age, seen=True)
        return SimpleNamespace(x=NAN, y=NAN, z=NAN, age=1e6, seen=False)


def companion(bench: CompanionBench) -> Any:
    """The page's robot, with the bench's components in its slots."""
    page: Any = Bundle.read(PAGE).load()

    class InVirtualTime(page):  # type: ignore[misc]
        left, right = _Limb(bench.left), _Limb(bench.right)
        base, head = _Base(bench.base), _Head(bench.head)
        context = SimpleNamespace(command="act")

        def sleep(self, seconds: float) -> None:
            bench.base.wait(seconds)

        def now(self) -> float:
            return bench.base.now

        def progress(self, *_: object) -> None:
            """Nobody looks."""

    return InVirtualTime("companion")
