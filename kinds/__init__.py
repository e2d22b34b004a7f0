"""The kinds of robots that come with robotree, as interfaces: `arm = Child(Arm)`.

Written by `python docs/kinds.py`.
"""

from robotree.kinds.arm import Arm
from robotree.kinds.base import Base
from robotree.kinds.companion import Companion
from robotree.kinds.head import Head
from robotree.kinds.limb import Limb
from robotree.kinds.moveto import MoveTo
from robotree.kinds.rover import Rover
from robotree.kinds.teleop import TeleOp
from robotree.kinds.twoarms import TwoArms

__all__ = ["Arm", "Base", "Companion", "Head", "Limb", "MoveTo", "Rover", "TeleOp", "TwoArms"]

STREAMS = {
    "Arm": ("force", "pictures", "pose"),
    "Base": ("place",),
    "Head": ("gaze", "pictures"),
    "Limb": ("force", "pose"),
    "Rover": ("place",),
}
"""Names of the streams of each kind, which are no readings."""
