"""What a robot tells about itself, and how often: one registry of streams per kind of robot.

Pure: readings in, messages out. Times are controller time, so a stream keeps its rate per simulated second.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import pinocchio as pin

from robotree.protocol.messages import (
    Gripper,
    GripperState,
    Joints,
    LocalPositionNed,
    Message,
    NamedValueFloat,
    Tool,
)
from robotree.sim.gripper import Grip
from robotree.sim.vectors import Matrix, Vector
from robotree.sim.worlds import ArmWorld, RoverWorld

HOT: Final = 20
"""[ms] between two poses: 50 Hz."""
WARM: Final = 100
"""[ms] between two readings of what changes slowly: 10 Hz."""
_JOINT_PLACES: Final = 8
_GRIPPER_STATES: Final = {
    Grip.AT_WIDTH: GripperState.AT_WIDTH,
    Grip.MOVING: GripperState.MOVING,
    Grip.HOLDING: GripperState.HOLDING,
}


class Stream(NamedTuple):
    """Messages of one kind.

    Attributes:
        kind: of message.
        period: [ms] between two, unless a client asks for another; None: only when asked for.
        read: the messages of one reading, at controller time [ms] and told whether something moves.
    """

    kind: type[Message]
    period: int | None
    read: Callable[[int, bool], Sequence[Message]]

    @property
    def msgid(self) -> int:
        """Of its kind, on the wire."""
        return self.kind.codec.definition.id


def arm_streams(world: ArmWorld) -> tuple[Stream, ...]:
    """JOINTS and TOOL often; GRIPPER, the lever's angle (`lever`, rad) and `peak_f` (N) less so.

    `peak_f` is `ArmState.peak_force`: the largest true net contact force on the hand since the start.
    """

    def joints(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        q = world.arm.state().q
        return (Joints(time_boot_ms=now, position=_padded(q), count=len(q)),)

    def tool(now: int, busy: bool) -> Sequence[Message]:  # noqa: FBT001
        state = world.arm.state()
        x, y, z = state.position.tolist()
        fx, fy, fz, tx, ty, tz = state.wrench.tolist()
        return (Tool(now, x, y, z, fx, fy, fz, tx, ty, tz, quaternion(state.rotation), int(busy)),)

    def gripper(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        state = world.arm.state()
        grip = _GRIPPER_STATES[state.grip]
        return (Gripper(now, state.width, state.width_commanded, state.grip_force, grip),)

    def values(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        return (
            NamedValueFloat(now, "lever", world.lever_angle),
            NamedValueFloat(now, "peak_f", world.arm.state().peak_force),
        )

    return (
        Stream(Joints, HOT, joints),
        Stream(Tool, HOT, tool),
        Stream(Gripper, WARM, gripper),
        Stream(NamedValueFloat, WARM, values),
    )


def rover_streams(world: RoverWorld) -> tuple[Stream, ...]:
    """LOCAL_POSITION_NED: W is x forward, y left, z up, the message's frame x forward, y right, z down."""

    def pose(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        state = world.rover.state()
        (x, y), (vx, vy) = state.position.tolist(), state.velocity.tolist()
        return (LocalPositionNed(now, x, -y, 0.0, vx, -vy, 0.0),)

    return (Stream(LocalPositionNed, HOT, pose),)


def quaternion(rotation: Matrix) -> tuple[int, int, int, int]:
    """w, x, y, z of a rotation (3, 3), w not negative, each times 32767."""
    x, y, z, w = pin.Quaternion(rotation).coeffs().tolist()
    sign = -32767.0 if w < 0.0 else 32767.0
    return round(w * sign), round(x * sign), round(y * sign), round(z * sign)


def _padded(joints: Vector) -> tuple[float, ...]:
    return (*joints.tolist(), *(0.0,) * (_JOINT_PLACES - len(joints)))
