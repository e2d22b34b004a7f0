"""What a robot has that cannot travel to another host, in words."""

from __future__ import annotations

import io
import socket
import threading
import types
from collections.abc import Iterator
from inspect import getattr_static
from typing import Any

from robotree.vr.author.together import Race
from robotree.vr.author.virtual_robot import Service, VirtualRobot
from robotree.vr.core.machine import RobotState
from robotree.vr.running.frame import Frame
from robotree.vr.running.robot_runtime import RobotRuntime

_OURS = frozenset({"stream_outlet", "lent"})
"""Attributes of a robot that our own code sets anew at the destination."""

_LOCKS = (type(threading.Lock()), type(threading.RLock()), threading.Event, threading.Condition)
TIED: dict[str, tuple[type[Any], ...]] = {
    "an open file": (io.IOBase,),
    "a socket": (socket.socket,),
    "a thread": (threading.Thread,),
    "a lock": _LOCKS,
    "a generator": (types.GeneratorType, types.CoroutineType),
}
"""Things that exist in one process only, in words."""


def tied_to_process(value: object) -> str:
    """Return what a value is that exists in one process only, in words; empty: it does not."""
    return next((words for words, kinds in TIED.items() if isinstance(value, kinds)), "")


def unfit_reasons(runtime: RobotRuntime, *, standing: bool = False) -> list[str]:
    """Return why a robot cannot leave its process now, as clauses; none: it can.

    Args:
        runtime: the robot.
        standing: all its code stands, so what is in its variables is looked at, too.
    """
    return [
        *_of_attributes(runtime),
        *runtime.look(_of_calls),
        *_of_frames(runtime, standing=standing),
        *(["its page is just being reloaded"] if runtime.reloads else []),
        *(
            ["it carries out an order; wait for its end"]
            if runtime.takes_order
            or runtime.look(lambda state: not runtime.ordered.isdisjoint(state.calls.live))
            else []
        ),
    ]


def _of_attributes(runtime: RobotRuntime) -> Iterator[str]:
    robot = runtime.robot
    if not isinstance(robot, VirtualRobot):
        yield "it is no virtual robot: a proxy stays where its controller is"
        return
    if isinstance(robot, Service) and robot.behaviours:
        yield "it is a service, and its behaviours stay here; delete it, and start it there"
    for name, value in vars(robot).items():
        if name in _OURS:
            continue
        if hasattr(getattr_static(type(robot), name, None), "__get__"):  # it keeps itself there: a slot
            continue
        if words := tied_to_process(value):
            yield f"self.{name} is {words}, which exists in this process only"
        elif not runtime.is_as_made(name, value):
            yield f"self.{name} was set outside of declared state; declare it with state(…), and it travels"


def _of_calls(state: RobotState) -> list[str]:
    reasons = [
        f"its {command} ignores every cancel and still runs" for command in state.calls.abandoned.values()
    ]
    for call in state.calls.live.values():
        if call.forgotten:
            reasons.append(f"{call.command} has taken more steps than are kept, without self.checkpoint()")
        if call.doubt:
            reasons.append(f"{call.command} asks a person; answer first (`robotree decide`)")
    return reasons


def _of_frames(runtime: RobotRuntime, *, standing: bool) -> Iterator[str]:
    for frame in tuple(runtime.frames):
        if not isinstance(frame, Frame):
            continue
        command = frame.context.command
        if frame.guests or frame.guest:
            yield f"{command} uses a thread of its page's own"
        group = frame.group
        while group is not None:
            if isinstance(group, Race):
                yield f"{command} waits for the first of several; that is not kept before it is decided"
            group = group.outer
        if standing:
            yield from _of_variables(runtime, frame)


def _of_variables(runtime: RobotRuntime, frame: Frame) -> Iterator[str]:
    """Look into the variables of the page's functions that wait."""
    source = runtime.source_of(frame.context.command)
    at = runtime.process.runner.stack_of(frame.worker.thread)
    while at is not None:
        if source and at.f_code.co_filename == source:
            for name, value in at.f_locals.items():
                if words := tied_to_process(value):
                    yield f"{name} in {at.f_code.co_name} (line {at.f_lineno}) is {words}"
        at = at.f_back
