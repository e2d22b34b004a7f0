"""The rover's cell: a walled floor with the rover in the middle and a crate; compiled.

World frame W: x forward, y left, z up, its origin the middle of the floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from robotree.protocol.messages import LocalPositionNed, Message
from robotree.sim.firmware.telemetry import HOT, Stream
from robotree.sim.physics import scenery
from robotree.sim.physics.cell import Cell
from robotree.sim.physics.engine import mujoco
from robotree.sim.rover.device import ARENA, PREFIX, Rover, bind, spec

CRATE: Final = (0.80, -0.90)
"""[m] x, y of a crate in the rover's arena."""

_WALL: Final = (0.33, 0.37, 0.44, 1.0)
_CRATE: Final = (0.85, 0.58, 0.20, 1.0)
_BIN: Final = (0.20, 0.42, 0.66, 1.0)
_DOCK: Final = (0.20, 0.60, 0.42, 1.0)


@dataclass(frozen=True, slots=True)
class RoverWorld:
    """The rover on its floor."""

    cell: Cell
    rover: Rover


def cell() -> mujoco.MjSpec:
    """A walled floor with the rover in the middle and a crate."""
    world = scenery.floor(height=0.0)
    reach = ARENA + 0.2
    for name, x, y in (("east", 1, 0), ("west", -1, 0), ("north", 0, 1), ("south", 0, -1)):
        scenery.box(
            world,
            f"wall_{name}",
            (x * reach, y * reach, 0.06),
            (0.02 if x else reach, 0.02 if y else reach, 0.06),
            _WALL,
        )
    scenery.box(world, "crate", (*CRATE, 0.12), (0.14, 0.14, 0.12), _CRATE)
    scenery.box(world, "bin", (-0.95, 1.05, 0.16), (0.18, 0.12, 0.16), _BIN)
    scenery.box(world, "dock", (0.0, 0.0, 0.001), (0.19, 0.19, 0.001), _DOCK)
    scenery.attach(world, spec(), PREFIX, (0.0, 0.0, 0.0))
    scenery.camera(world, eye=(-2.3, -2.3, 2.1), target=(0.05, 0.05, -0.12), fovy=42.0)
    return world


def build() -> RoverWorld:
    """Build the rover's cell: the rover in the middle of the floor."""
    model = cell().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rover = Rover(bind(model, data))
    return RoverWorld(Cell(model, data, rover), rover)


def streams(world: RoverWorld) -> tuple[Stream, ...]:
    """LOCAL_POSITION_NED: W is x forward, y left, z up, the message's frame x forward, y right, z down."""

    def pose(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        state = world.rover.state()
        (x, y), (vx, vy) = state.position.tolist(), state.velocity.tolist()
        return (LocalPositionNed(now, x, -y, 0.0, vx, -vy, 0.0),)

    return (Stream(LocalPositionNed, HOT, pose),)
