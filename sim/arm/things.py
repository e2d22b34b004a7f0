"""The things on the arm's table: a bistable lever and a block to pick up."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from robotree.sim.physics import scenery
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
