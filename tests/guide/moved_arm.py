"""A faked arm whose movements are made by a simulated one, with its lever and its block."""

from __future__ import annotations

from typing import Any

from robotree.protocol.messages import GoalState, Tool, Verb
from robotree.proxy.arm import CLOSED, OPEN, Arm
from robotree.proxy.translate import twist_of
from robotree.sim.testing import ArmBench
from robotree.testing import Fake
from robotree.vr.base.errors import CommandFailed

AGAINST = 0.01
"""[rad] that the lever turns when it was only touched."""


def moved_arm(name: str) -> Fake:
    """Return the fake; it claims to hold something, so that pages that fetch go on to their end.

    A movement that the simulated arm refuses, that something holds up, or that meets the lever fails with
    that reason. The simulated arm is built for the first command.
    """
    benches: list[ArmBench] = []

    def bench() -> ArmBench:
        if not benches:
            benches.append(ArmBench())
            benches[0].operator.wait(0.1)  # until it has told where it is
        return benches[0]

    def move(verb: Verb, *numbers: float) -> None:
        arm = bench()
        before = arm.world.lever_angle
        end = arm.operator.do(verb, *numbers)
        why = "" if end.state == GoalState.SUCCEEDED and verb is Verb.GRIP else end.text
        if not why and abs(arm.world.lever_angle - before) > AGAINST:
            why = "it meets the lever"
        if why or end.state != GoalState.SUCCEEDED:
            detail = f"{verb.name}{numbers}: {why or GoalState(end.state).name}"
            raise CommandFailed(robot=name, command=verb.name.lower(), detail=detail)

    def go_to(x: float, y: float, z: float, twist: float, speed: float) -> None:
        move(Verb.GO_TO, x, y, z, twist, speed)

    def grip(action: str, width: float) -> None:
        move(Verb.GRIP, {"open": OPEN, "close": CLOSED, "width": width}[action])

    def get_info() -> dict[str, Any]:
        tool = bench().operator.latest(Tool)
        return {"x": tool.x, "y": tool.y, "z": tool.z, "twist": twist_of(tool.q), "holding": True}

    return Fake(Arm, takes=0.2, go_to=go_to, grip=grip, get_info=get_info)
