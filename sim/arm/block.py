"""The block as a device: something to pick up."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

XML: Final = Path(__file__).with_name("block.xml")
PREFIX: Final = "block/"
SIDE: Final = 0.04
"""[m]; half of what the gripper opens."""
PLACE: Final = (0.30, -0.20, SIDE / 2)
"""[m] in W, where its middle is at first: away from the lever, within reach of a hand that points down."""


def spec() -> mujoco.MjSpec:
    """Read the block's description."""
    return mujoco.MjSpec.from_file(str(XML))


@dataclass(frozen=True, slots=True)
class BlockPorts:
    """Views into the live data: `place` is (3,) the block's middle in W [m]."""

    place: Vector


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> BlockPorts:
    """Find the block's ports."""
    at = int(model.joint(prefix + "block").qposadr[0])
    return BlockPorts(place=data.qpos[at : at + 3])
