"""The proxy of a compliant arm with a gripper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import msgspec

from robotree.protocol.messages import Gripper, GripperState, MavComponent, Tool, Verb
from robotree.proxy.guard import Limits, Span
from robotree.proxy.motion import Hold, Motion, PreviewedWay
from robotree.proxy.robot_proxy import CarriedCamera, RobotProxy, Streamed
from robotree.proxy.translate import twist_of
from robotree.proxy.view import OFTEN, PICTURES, CameraPicture, ToolForce, ToolPose
from robotree.vr.author.command import command
from robotree.vr.author.stream import Stream
from robotree.vr.base.units import Unit

LIMITS: Limits = {
    "x": Span(-0.65, 0.65, "m"),
    "y": Span(-0.65, 0.65, "m"),
    "z": Span(0.025, 0.80, "m"),
    "twist": Span(-math.pi, math.pi, "rad"),
    "speed": Span(0.005, 0.25, "m/s"),
    "blend": Span(0.0, 0.05, "m"),
    "width": Span(0.0, 0.08, "m"),
}
"""The box of W in which the tool may be sent, and how fast. Whether a point of it is within reach, only the
controller knows. The finger tips reach 0.02 m below the tool point, and the table is at 0. An impact's peak
force grows with speed: 35 N at 0.05 m/s, 130 N at 0.2 m/s against a hard table."""
OPEN, CLOSED = LIMITS["width"].upper, LIMITS["width"].lower
"""[m] Widths of the open and of the closed gripper."""
QUATERNION = 32767.0
"""Of the wire: 1 in each component of a unit quaternion."""
USUAL_SPEED = 0.15
"""[m/s] when the caller names none. The proxy always sends a speed: a command then means the
same to every controller, whatever it would do without one (docs/decisions/0008)."""

X = Annotated[float, Unit("m"), LIMITS["x"].range, "forward, from the foot of the arm"]
Y = Annotated[float, Unit("m"), LIMITS["y"].range, "to the left"]
Z = Annotated[float, Unit("m"), LIMITS["z"].range, "up, from the table"]
Twist = Annotated[float, Unit("rad"), LIMITS["twist"].range, "of the gripper, counterclockwise from above"]
ToolSpeed = Annotated[
    float, Unit("m/s"), LIMITS["speed"].range, "along the way; slower where contact is expected"
]
Blend = Annotated[
    float,
    Unit("m"),
    LIMITS["blend"].range,
    "from the point, at which it counts as reached in passing; 0: the tool stands there",
]
Width = Annotated[float, Unit("m"), LIMITS["width"].range, "between the fingers"]
Force = Annotated[float, Unit("N"), "of the world on the tool"]
Torque = Annotated[float, Unit("N*m"), "of the world on the tool"]


@dataclass(frozen=True, slots=True, kw_only=True)
class GoTo(Motion):
    """Move the tool to x, y, z [m] at speed [m/s], pointing down, twist [rad] about the vertical.

    It counts as reached when the tool stands there, or with a blend [m] as soon as it is that near.
    """

    effect = "repeat"
    verb = Verb.GO_TO

    x: float
    y: float
    z: float
    twist: float
    speed: float
    blend: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip(Motion):
    """Bring the fingers to a width [m]; an object in between stops them earlier."""

    effect = "repeat"
    verb = Verb.GRIP

    width: float


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


def _force(m: Tool) -> ToolForce:
    return ToolForce(m.fx, m.fy, m.fz)


def _pose(m: Tool) -> ToolPose:
    w, x, y, z = (each / QUATERNION for each in m.q)
    return ToolPose(m.x, m.y, m.z, w, x, y, z)


class Arm(RobotProxy):
    """A compliant arm: goes to points, gripper down, yields when pushed, and feels what it touches."""

    limits = LIMITS
    camera: ClassVar[CarriedCamera | None] = CarriedCamera("wrist", MavComponent.CAMERA2)
    force: Stream[ToolForce] = Stream(ToolForce, "what the tool feels", rate=OFTEN)
    pose: Stream[ToolPose] = Stream(ToolPose, "where the tool is", rate=OFTEN)
    pictures: Stream[CameraPicture] = Stream(CameraPicture, "of the camera at its wrist", rate=PICTURES)
    streamed = (
        Streamed("force", Tool, _force),
        Streamed("pose", Tool, _pose),
    )

    @command(effect="repeat", offline="queue")
    def go_to(
        self, x: X, y: Y, z: Z, twist: Twist, speed: ToolSpeed = USUAL_SPEED, blend: Blend = 0.0
    ) -> None:
        """Move the gripper to a point, on a line if there is one, and turn it."""
        self.carry_out(GoTo(x=x, y=y, z=z, twist=twist, speed=speed, blend=blend))

    @command(effect="read")
    def preview_go_to(self, x: X, y: Y, z: Z, twist: Twist, speed: ToolSpeed = USUAL_SPEED) -> PreviewedWay:
        """Tell the way that `go_to` would take, or why it would be refused; nothing moves."""
        return self.foresee(GoTo(x=x, y=y, z=z, twist=twist, speed=speed))

    @command(effect="read", offline="memory")
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

    @command(effect="repeat", offline="queue")
    def grip(self, action: Literal["open", "close", "width"], width: Width = OPEN) -> None:
        """Open or close the gripper, or bring it to a width; it stops at what is between the fingers."""
        self.carry_out(Grip(width={"open": OPEN, "close": CLOSED, "width": width}[action]))

    @command(effect="repeat")
    def hold(self) -> None:
        """Stay here: yield when pushed, and come back."""
        self.carry_out(Hold())
