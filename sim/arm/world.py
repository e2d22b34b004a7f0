"""The arm's cell: a table with the arm, a bistable lever and a block; compiled, and put in its first place.

World frame W: x forward, y left, z up, its origin the arm's foot on the table top.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotree.sim.arm import model as arm_model
from robotree.sim.arm.device import Arm
from robotree.sim.arm.kinematics import HOME
from robotree.sim.physics import scenery
from robotree.sim.physics.cell import Cell
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector


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
