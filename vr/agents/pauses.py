"""Pause, step and continue as one virtual robot carries them out.

What is paused, the core knows, and its renewals tell those below; where a command waits, its frame knows
(`Frame.hold`). A robot without a page has no steps: its present command ends by itself, and its parent does
not begin the next one. All of this runs on the event loop.
"""

from __future__ import annotations

import math

from robotree.vr.agents.children import ChildKeeper
from robotree.vr.base.errors import NothingHeld
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import Done, Reply, TakeStep
from robotree.vr.core import events as on
from robotree.vr.core.machine import RobotState
from robotree.vr.running.robot_runtime import RobotRuntime


def pause(runtime: RobotRuntime, asker: Principal) -> Reply:
    """Have each command wait before its next step.

    Raises:
        LeaseError: its parent commands it.
    """
    by = asker.person or asker.user
    runtime.post(on.PauseAsked(by=by, principal=asker))
    runtime.log.say("info", f"paused by {by}")
    now = runtime.process.runner.now()
    return Done(note=runtime.look(lambda state: _deadline(state, now)))


async def step(runtime: RobotRuntime, children: ChildKeeper, order: TakeStep, asker: Principal) -> Reply:
    """Let the step pass that waits for the longest time, of this robot, else of one below it.

    Raises:
        NothingHeld: nothing waits before a step.
        NotPaused: the robot is not paused.
        LeaseError: its parent commands it, and somebody else asks.
    """
    name = runtime.name
    if taken := runtime.let_step(order.epoch, asker):
        _note(runtime, f"takes {taken}", asker)
        return Done(note=f"{name} takes {taken}")
    if taken := await children.step(order.within):
        return Done(note=taken)
    command = runtime.look(lambda state: state.calls.command_of(state.calls.running))
    reason = f"the present step of {command} goes on" if command else "it carries nothing out"
    raise NothingHeld(robot=name, reason=reason)


def go_on(runtime: RobotRuntime, asker: Principal) -> Reply:
    """End the pause.

    Raises:
        LeaseError: its parent commands it.
    """
    paused = runtime.look(lambda state: state.pause.in_force)
    runtime.post(on.ContinueAsked(principal=asker))
    if paused:
        _note(runtime, "goes on", asker)
    return Done(note="" if paused else f"{runtime.name} was not paused")


def _note(runtime: RobotRuntime, order: str, asker: Principal) -> None:
    by = asker.person or ("its parent" if asker.agent.startswith("robot/") else asker.user)
    runtime.log.say("info", f"{order}, ordered by {by}")


def _deadline(state: RobotState, now: float) -> str:
    """Say that the time of what runs goes on, with what is left of it."""
    running = state.calls.live.get(state.calls.running)
    if running is None or not math.isfinite(running.deadline_at):
        return ""
    return f"the deadline of {running.command} goes on: {max(running.deadline_at - now, 0.0):.0f} s left"
