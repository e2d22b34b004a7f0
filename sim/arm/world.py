"""The arm's cell: a table with the arm, a bistable lever and a block; compiled, and put in its first place.

World frame W: x forward, y left, z up, its origin the arm's foot on the table top.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pinocchio as pin

from robotree.protocol.messages import Gripper, GripperState, Joints, Message, NamedValueFloat, Skeleton, Tool
from robotree.sim.arm import model as arm_model
from robotree.sim.arm.device import Arm
from robotree.sim.arm.hand import Grip
from robotree.sim.arm.kinematics import HOME, Kinematics
from robotree.sim.firmware.telemetry import HOT, WARM, Stream
from robotree.sim.physics import scenery
from robotree.sim.physics.cell import Cell
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Matrix, Vector

if TYPE_CHECKING:
    from robotree.sim.companion.limb import Limb


@dataclass(frozen=True, slots=True)
class Thing:
    """A body with one joint of the same name, as the XML file of that name beside this one describes it."""

    name: str
    foot: tuple[float, float, float]
    """[m] in W: where its frame is put."""

    def attach(self, cell: mujoco.MjSpec) -> None:
        """Put it into a cell."""
        spec = mujoco.MjSpec.from_file(str(Path(__file__).with_name(f"{self.name}.xml")))
        scenery.attach(cell, spec, f"{self.name}/", self.foot)

    def bind(self, data: mujoco.MjData) -> Vector:
        """Return a view into the live data, the position of its joint; writing it places the thing."""
        return data.joint(f"{self.name}/{self.name}").qpos


LEVER: Final = Thing("lever", (0.42, 0.045, 0.0))
LEVER_OPEN: Final = -0.785
"""[rad] its stop towards the arm; the other one is at the same angle away from the arm."""

BLOCK_SIDE: Final = 0.04
"""[m]; half of what the gripper opens."""
BLOCK: Final = Thing("block", (0.30, -0.20, BLOCK_SIDE / 2))
"""Its frame is its middle: away from the lever, within reach of a hand that points down."""


FINGERS_AT_FIRST: Final = 0.03
"""[m] slide of each finger: the gripper is three quarters open."""
TABLE_HEIGHT: Final = 0.72
"""[m] of the table top above the floor."""

_WOOD: Final = (0.80, 0.68, 0.52, 1.0)
_STEEL: Final = (0.42, 0.45, 0.50, 1.0)


@dataclass(frozen=True, slots=True)
class ArmWorld:
    """The arm at its table, with the lever open and the block to its right.

    Attributes:
        cell: what is simulated.
        arm: the device.
        lever: (1,) its angle [rad], live; writing it places the lever.
        block: (7,) its middle in W [m] and its quaternion, live; writing it places the block.
    """

    cell: Cell
    arm: Arm
    lever: Vector
    block: Vector

    @property
    def lever_angle(self) -> float:
        """[rad] below 0: open, towards the arm; above 0: closed."""
        return float(self.lever[0])

    @property
    def block_place(self) -> tuple[float, float, float]:
        """[m] in W: the middle of the block."""
        x, y, z = self.block[:3].tolist()
        return x, y, z


def cell() -> mujoco.MjSpec:
    """A table with the arm, and the lever and the block within its reach."""
    world = scenery.floor(height=-TABLE_HEIGHT)
    _table(world)
    scenery.attach(world, arm_model.spec(), arm_model.PREFIX, (0.0, 0.0, 0.0))
    for thing in (LEVER, BLOCK):
        thing.attach(world)
    world.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    scenery.camera(world, eye=(1.42, -1.22, 0.80), target=(0.17, 0.03, 0.27), fovy=36.0)
    return world


def build() -> ArmWorld:
    """Build the arm's cell: arm at home, fingers open, lever open."""
    model = cell().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ports = arm_model.bind(model, data)
    lever = LEVER.bind(data)
    ports.q[:] = HOME
    for finger in ("slide_l", "slide_r"):
        data.qpos[model.joint(arm_model.PREFIX + finger).qposadr[0]] = FINGERS_AT_FIRST
    ports.hand.finger_target[:] = FINGERS_AT_FIRST
    lever[:] = LEVER_OPEN
    mujoco.mj_forward(model, data)
    arm = Arm(ports)
    return ArmWorld(Cell(model, data, arm), arm, lever, BLOCK.bind(data))


def _table(cell: mujoco.MjSpec) -> None:
    scenery.box(cell, "table", (0.26, 0.0, -0.02), (0.52, 0.48, 0.02), _WOOD)
    scenery.box(cell, "apron", (0.26, 0.0, -0.065), (0.47, 0.43, 0.025), _STEEL)
    for name, x, y in (("fl", 1, 1), ("fr", 1, -1), ("rl", -1, 1), ("rr", -1, -1)):
        half = (TABLE_HEIGHT - 0.04) / 2
        scenery.box(
            cell, f"leg_{name}", (0.26 + 0.45 * x, 0.41 * y, -0.04 - half), (0.03, 0.03, half), _STEEL
        )


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
