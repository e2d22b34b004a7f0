"""The bistable lever as a device."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

XML: Final = Path(__file__).with_name("lever.xml")
PREFIX: Final = "lever/"
OPEN: Final = -0.785
"""[rad] the stop towards the arm."""
CLOSED: Final = 0.785
"""[rad] the stop away from the arm."""


def spec() -> mujoco.MjSpec:
    """Read the lever's description."""
    return mujoco.MjSpec.from_file(str(XML))


@dataclass(frozen=True, slots=True)
class LeverPorts:
    """Views into the live data: `angle` is (1,) [rad], writing it places the lever."""

    angle: Vector


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> LeverPorts:
    """Find the lever's ports."""
    at = int(model.joint(prefix + "lever").qposadr[0])
    return LeverPorts(angle=data.qpos[at : at + 1])
