"""The parameters of the companion that can be tuned while it runs, within the limits it was measured with."""

from dataclasses import dataclass
from typing import Final

from robotree.sim.arm.device import GRIP_FORCE
from robotree.sim.firmware.device import Tunable

HAND_SPEED: Final = 0.25
"""[m/s] of a hand when a goal names no speed: the reduced speed of ISO 10218-1 for people near an arm."""
TOP_HAND_SPEED: Final = 0.8
"""[m/s] of a hand with nobody near."""
SLOWEST: Final = 0.01
"""[m/s]"""
HAND_ACCELERATION: Final = 1.6
"""[m/s2]"""
FORCE_LIMIT: Final = 30.0
"""[N] that the spring of a hand pulls at most."""
BASE_SPEED: Final = 0.4
TOP_BASE_SPEED: Final = 0.8
"""[m/s]"""
BASE_ACCELERATION: Final = 0.5
"""[m/s2]"""
TURN_RATE: Final = 0.9
"""[rad/s]"""
LEAN_RATE: Final = 0.4
"""[rad/s]"""
LOOK_RATE: Final = 1.5
"""[rad/s]"""


@dataclass(slots=True)
class LimbTuning:
    """Of one arm."""

    speed: float = HAND_SPEED
    top_speed: float = TOP_HAND_SPEED
    force_limit: float = FORCE_LIMIT
    grip_force: float = 10.0


LIMB_PARAMETERS: Final = (
    Tunable("HAND_SPEED", "speed", SLOWEST, TOP_HAND_SPEED, "m/s, of a goal that names no speed"),
    Tunable("HAND_SPEED_MAX", "top_speed", SLOWEST, TOP_HAND_SPEED, "m/s, that a goal may ask for"),
    Tunable(
        "HAND_FORCE_MAX", "force_limit", 10.0, FORCE_LIMIT, "N, that the spring of the hand pulls at most"
    ),
    Tunable("GRIP_FORCE", "grip_force", 2.0, GRIP_FORCE, "N, of each finger"),
)


@dataclass(slots=True)
class BaseTuning:
    """Of the base and the waist."""

    speed: float = BASE_SPEED
    top_speed: float = TOP_BASE_SPEED
    acceleration: float = BASE_ACCELERATION
    distance: float = 0.45


BASE_PARAMETERS: Final = (
    Tunable("BASE_SPEED", "speed", SLOWEST, TOP_BASE_SPEED, "m/s, of a goal that names no speed"),
    Tunable("BASE_SPEED_MAX", "top_speed", SLOWEST, TOP_BASE_SPEED, "m/s, that a goal may ask for"),
    Tunable("BASE_ACCEL", "acceleration", 0.1, BASE_ACCELERATION, "m/s2, of the next movement"),
    Tunable("PEOPLE_DIST", "distance", 0.45, 1.5, "m, from the middle of the base to a person, at least"),
)


@dataclass(slots=True)
class HeadTuning:
    """Of the neck."""

    rate: float = LOOK_RATE


HEAD_PARAMETERS: Final = (Tunable("LOOK_RATE", "rate", 0.1, 3.0, "rad/s, of a goal that names no rate"),)
