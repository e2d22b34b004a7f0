"""The parameters of the arm that can be tuned while it runs, within the limits it was measured with.

Speeds and accelerations count from the next movement or set-point on; the spring changes gradually (see
`compliance`), so tuning a pressing arm does not make it jump.
"""

from dataclasses import dataclass
from typing import Final

from robotree.sim.arm.compliance import FORCE_LIMIT, TOOL_STIFFNESS
from robotree.sim.arm.hand import SPEED as GRIP_SPEED
from robotree.sim.arm.planner import TOOL_ACCELERATION, TOOL_SPEED
from robotree.sim.firmware.device import Tunable

TOP_SPEED: Final = 0.25
"""[m/s] that a goal may ask for: the reduced speed of ISO 10218-1 for people near an arm."""
SLOWEST: Final = 0.005
"""[m/s] that a goal may ask for."""
GRIP_FORCE: Final = 15.0
"""[N] of each finger; half of what the gripper's servo can pull."""


@dataclass(slots=True)
class ArmTuning:
    """The values of `PARAMETERS`, in their units."""

    speed: float = TOOL_SPEED
    top_speed: float = TOP_SPEED
    acceleration: float = TOOL_ACCELERATION
    stiffness: float = TOOL_STIFFNESS
    force_limit: float = FORCE_LIMIT
    grip_speed: float = GRIP_SPEED
    grip_force: float = GRIP_FORCE


PARAMETERS: Final = (
    Tunable("TOOL_SPEED", "speed", SLOWEST, TOP_SPEED, "m/s, of a goal that names no speed"),
    Tunable("TOOL_SPEED_MAX", "top_speed", SLOWEST, TOP_SPEED, "m/s, that a goal or set-point may ask for"),
    Tunable("TOOL_ACCEL", "acceleration", 0.1, TOOL_ACCELERATION, "m/s2, of the next movement"),
    Tunable("TOOL_STIFFNESS", "stiffness", 250.0, 1000.0, "N/m, of the spring on which the tool hangs"),
    Tunable("TOOL_FORCE_MAX", "force_limit", 10.0, FORCE_LIMIT, "N, that the spring pulls at most"),
    Tunable("GRIP_SPEED", "grip_speed", 0.01, GRIP_SPEED, "m/s, of the gap between the fingers"),
    Tunable("GRIP_FORCE", "grip_force", 2.0, GRIP_FORCE, "N, of each finger"),
)
"""The parameters that people can tune."""
