"""Which robots can be tele-operated, and within which bounds. Pure."""

from __future__ import annotations

from math import inf

from robotree.tui.screen.jog import AXES, Bounds
from robotree.vr.base.description import CommandSpec, RobotDescription

GO_TO, GET_INFO, GRIP = "go_to", "get_info", "grip"


def bounds(robot: RobotDescription) -> Bounds | None:
    """Return the bounds of tele-operation by axis, or None when the robot cannot be tele-operated.

    It can when it has `get_info` and a `go_to` that takes x, y, z and twist and that needs nothing else.
    """
    go_to, get_info = robot.command(GO_TO), robot.command(GET_INFO)
    if not (go_to and get_info and go_to.available and get_info.available):
        return None
    fields = {spec.name: spec for spec in go_to.parameters}
    if not set(AXES) <= set(fields) or any(
        spec.required for name, spec in fields.items() if name not in AXES
    ):
        return None
    return {axis: _range(go_to, axis) for axis in AXES}


def _range(command: CommandSpec, axis: str) -> tuple[float, float]:
    spec = next(parameter for parameter in command.parameters if parameter.name == axis)
    return (-inf if spec.lower is None else spec.lower, inf if spec.upper is None else spec.upper)
