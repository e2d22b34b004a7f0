"""The proxy of a compliant arm with a gripper."""

from __future__ import annotations

import random
from typing import Annotated, Literal

import msgspec

from robotree.protocol.links.url import connect
from robotree.protocol.messages import Gripper, GripperState, Tool
from robotree.proxy.connection import Dial
from robotree.proxy.guard import ArmLimits, Span
from robotree.proxy.motion import GoTo, Grip, Hold
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.translate import twist_of
from robotree.vr.command import command
from robotree.vr.units import Range, Unit

LIMITS = ArmLimits()
OPEN, CLOSED = LIMITS.width.upper, LIMITS.width.lower
"""[m] Widths of the open and of the closed gripper."""


def _within(span: Span) -> Range:
    return Range(span.lower, span.upper)


X = Annotated[float, Unit("m"), _within(LIMITS.x), "forward, from the foot of the arm"]
Y = Annotated[float, Unit("m"), _within(LIMITS.y), "to the left"]
Z = Annotated[float, Unit("m"), _within(LIMITS.z), "up, from the table"]
Twist = Annotated[float, Unit("rad"), _within(LIMITS.twist), "of the gripper, counterclockwise from above"]
Speed = Annotated[
    float, Unit("m/s"), _within(LIMITS.speed), "along the way; slower where contact is expected"
]
Width = Annotated[float, Unit("m"), _within(LIMITS.width), "between the fingers"]
Force = Annotated[float, Unit("N"), "of the world on the tool"]
Torque = Annotated[float, Unit("N*m"), "of the world on the tool"]


class ArmInfo(msgspec.Struct, frozen=True, kw_only=True):
    """How an arm is at one moment; along and about the axes of the cell."""

    x: X
    y: Y
    z: Z
    twist: Twist
    fx: Force
    fy: Force
    fz: Force
    tx: Torque
    ty: Torque
    tz: Torque
    width: Width
    holding: Annotated[bool, "whether something is between the fingers"]
    busy: Annotated[bool, "whether it moves to a goal"]


class Arm(RobotProxy):
    """A compliant arm: goes to points, gripper down, yields when pushed, and feels what it touches."""

    def __init__(
        self,
        name: str,
        url: str,
        limits: ArmLimits = LIMITS,
        *,
        dial: Dial = connect,
        chance: random.Random | None = None,
    ) -> None:
        """Prepare the proxy of one arm; see `RobotProxy`."""
        super().__init__(name, url, limits, dial=dial, chance=chance)

    @command(effect="repeat")
    def go_to(self, x: X, y: Y, z: Z, twist: Twist, speed: Speed = 0.15) -> None:
        """Move the gripper to a point, on a line if there is one, and turn it."""
        self.carry_out(GoTo(x=x, y=y, z=z, twist=twist, speed=speed))

    @command(effect="read")
    def get_info(self) -> ArmInfo:
        """Tell place, twist, forces on every axis, and what the gripper does."""
        tool = self.news(Tool, since=self.asked_at)
        gripper = self.news(Gripper, since=self.settled_at)
        return ArmInfo(
            x=tool.x,
            y=tool.y,
            z=tool.z,
            twist=twist_of(tool.q),
            fx=tool.fx,
            fy=tool.fy,
            fz=tool.fz,
            tx=tool.tx,
            ty=tool.ty,
            tz=tool.tz,
            width=gripper.width,
            holding=gripper.state == GripperState.HOLDING,
            busy=bool(tool.busy),
        )

    @command(effect="repeat")
    def grip(self, action: Literal["open", "close", "width"], width: Width = OPEN) -> None:
        """Open or close the gripper, or bring it to a width; it stops at what is between the fingers."""
        self.carry_out(Grip(width={"open": OPEN, "close": CLOSED, "width": width}[action]))

    @command(effect="repeat")
    def hold(self) -> None:
        """Stay here: yield when pushed, and come back."""
        self.carry_out(Hold())
