"""The rover as a device."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

XML: Final = Path(__file__).with_name("rover.xml")
PREFIX: Final = "rover/"


def spec() -> mujoco.MjSpec:
    """Read the rover's description."""
    return mujoco.MjSpec.from_file(str(XML))


@dataclass(frozen=True, slots=True)
class RoverPorts:
    """Views into the live data of a cell.

    Attributes:
        position: (2,) x, y in W [m].
        velocity: (2,) along x, y of W [m/s].
        force: (2,) drive force asked for, along x, y of W [N].
    """

    position: Vector
    velocity: Vector
    force: Vector


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> RoverPorts:
    """Find the rover's ports."""
    x = model.joint(prefix + "x")
    q, v = int(x.qposadr[0]), int(x.dofadr[0])
    u = int(model.actuator_ctrladr[model.actuator(prefix + "x").id])
    return RoverPorts(
        position=data.qpos[q : q + 2], velocity=data.qvel[v : v + 2], force=data.ctrl[u : u + 2]
    )
