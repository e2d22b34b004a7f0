"""What can be tuned on the rover while it runs, and how far: never beyond what it was measured with."""

from dataclasses import dataclass
from typing import Final

from robotree.sim.firmware.tunable import Tunable

ARENA: Final = 1.5
"""[m] the rover's centre may go this far from the origin along x and y."""
FORCE_LIMIT: Final = 30.0
"""[N] of the drive."""
SPEED: Final = 0.4
"""[m/s] of a goal that names no speed."""
SLOWEST: Final = 0.01
"""[m/s] that a goal may ask for."""
TOP_SPEED: Final = 1.0
"""[m/s] that a goal may ask for."""
ACCELERATION: Final = 1.0
"""[m/s2]"""


@dataclass(slots=True)
class RoverTuning:
    """What can be tuned on the rover while it runs; see `PARAMETERS`."""

    speed: float = SPEED
    top_speed: float = TOP_SPEED
    acceleration: float = ACCELERATION
    force_limit: float = FORCE_LIMIT


PARAMETERS: Final = (
    Tunable("BASE_SPEED", "speed", SLOWEST, TOP_SPEED, "m/s, of a goal that names no speed"),
    Tunable("BASE_SPEED_MAX", "top_speed", SLOWEST, TOP_SPEED, "m/s, that a goal or set-point may ask for"),
    Tunable("BASE_ACCEL", "acceleration", 0.1, ACCELERATION, "m/s2, of the next movement"),
    Tunable("DRIVE_FORCE_MAX", "force_limit", 5.0, FORCE_LIMIT, "N, of the drive at most"),
)
"""What people can tune."""
