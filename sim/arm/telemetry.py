"""Telemetry of the arm. Pure: readings in, messages out."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import pinocchio as pin

from robotree.protocol.messages import Gripper, GripperState, Joints, Message, NamedValueFloat, Skeleton, Tool
from robotree.sim.arm.hand import Grip
from robotree.sim.arm.kinematics import Kinematics
from robotree.sim.arm.world import ArmWorld
from robotree.sim.firmware.telemetry import HOT, WARM, Stream
from robotree.sim.physics.vectors import Matrix, Vector

if TYPE_CHECKING:
    from robotree.sim.arm.device import Arm
    from robotree.sim.companion.limb import Limb

_JOINT_PLACES: Final = 8
_BONES: Final = 10
GRIPPER_STATES: Final = {
    Grip.AT_WIDTH: GripperState.AT_WIDTH,
    Grip.MOVING: GripperState.MOVING,
    Grip.HOLDING: GripperState.HOLDING,
}


def hand_streams(arm: "Arm | Limb") -> tuple[Stream, ...]:
    """Of any arm with a hand: JOINTS and TOOL often, GRIPPER less so."""

    def joints(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        q = arm.state().q
        return (Joints(time_boot_ms=now, position=padded(q), count=len(q)),)

    def tool(now: int, busy: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        state = arm.state()
        x, y, z = state.position.tolist()
        fx, fy, fz, tx, ty, tz = state.wrench.tolist()
        return (Tool(now, x, y, z, fx, fy, fz, tx, ty, tz, quaternion(state.rotation), int(busy)),)

    def gripper(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        state = arm.state()
        grip = GRIPPER_STATES[state.grip]
        return (Gripper(now, state.width, state.width_commanded, state.grip_force, grip),)

    return Stream(Joints, HOT, joints), Stream(Tool, HOT, tool), Stream(Gripper, WARM, gripper)


def streams(world: ArmWorld) -> tuple[Stream, ...]:
    """Those of its hand; the lever's angle (`lever`, rad) and `peak_f` (N) less often; its skeleton if asked.

    `peak_f` is `ArmState.peak_force`: the largest true net contact force on the hand since the start.
    """

    def values(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        return (
            NamedValueFloat(now, "lever", world.lever_angle),
            NamedValueFloat(now, "peak_f", world.arm.state().peak_force),
        )

    bones = Kinematics()  # its own scratch memory

    def skeleton(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        places = bones.skeleton(world.arm.state().q)[:_BONES]
        empty = [0.0] * (_BONES - len(places))
        x, y, z = ((*(place[axis] for place in places), *empty) for axis in range(3))
        return (Skeleton(now, x, y, z, len(places)),)

    return (
        Stream(Skeleton, None, skeleton),
        *hand_streams(world.arm),
        Stream(NamedValueFloat, WARM, values),
    )


def quaternion(rotation: Matrix) -> tuple[int, int, int, int]:
    """w, x, y, z of a rotation (3, 3), w not negative, each times 32767."""
    x, y, z, w = pin.Quaternion(rotation).coeffs().tolist()
    sign = -32767.0 if w < 0.0 else 32767.0
    return round(w * sign), round(x * sign), round(y * sign), round(z * sign)


def padded(joints: Vector) -> tuple[float, ...]:
    """Joints as JOINTS holds them: eight, the unused ones 0."""
    return (*joints.tolist(), *(0.0,) * (_JOINT_PLACES - len(joints)))
