"""OpenCloseLever: two buttons for a lever.

    robotree create examples/open_close_lever.py as lever
    robotree enslave lever.mover mover
    robotree call lever.close

The lever snaps to one of two stops. To close it, the arm reaches for the handle, grips it, leads it along its
arc, lets go and draws back. The arc need not be met to the millimetre: the arm yields.
"""

import math
from typing import Annotated

from robotree.vr import Child, Failed, Unit, VirtualRobot, command

# Where the lever stands, in metres in the frame of the cell (docs/cell.md), and its angles in radians.
AXLE_X, AXLE_Z = 0.42, 0.08
HANDLE_Y = 0.10
RADIUS = 0.20
OPEN, CLOSED = -0.785, 0.785

ACROSS = math.pi / 2
"""[rad] Twist at which the fingers are before and behind the handle."""
ABOVE = 0.10
"""[m] Where the reach ends and the careful descent begins."""
THINNEST = 0.015
"""[m] Fingers that came closer than this hold nothing."""
ARC = 6
"""Points on the way from one stop to the other."""
CAREFUL, BRISK = 0.05, 0.15
"""[m/s] With and without something in the hand."""

Newtons = Annotated[float, Unit("N"), "largest force that was felt on the way"]


class OpenCloseLever(VirtualRobot):
    """A lever that opens and closes at the press of a button."""

    mover = Child("MoveTo", "the arm beside the lever")

    @command(effect="repeat")
    def close(self) -> Newtons:
        """Close the lever."""
        return self.swing(OPEN, CLOSED)

    @command(effect="repeat")
    def open(self) -> Newtons:
        """Open the lever."""
        return self.swing(CLOSED, OPEN)

    def swing(self, start: float, end: float) -> float:
        """Lead the handle from one angle to the other."""
        self.mover.grip(action="open")
        self.reach(start, above=ABOVE, speed=BRISK)
        self.reach(start, speed=CAREFUL)
        self.mover.grip(action="close")
        if self.mover.get_info().width < THINNEST:
            self.mover.grip(action="open")
            raise Failed(f"the handle is not at {start:g} rad; is the lever there already?")
        felt = 0.0
        for point in range(1, ARC + 1):
            self.reach(start + (end - start) * point / ARC, speed=CAREFUL)
            info = self.mover.get_info()
            felt = max(felt, math.hypot(info.fx, info.fy, info.fz))
            self.progress(point / ARC, f"{felt:.0f} N")
        self.mover.grip(action="open")
        self.reach(end, above=ABOVE, speed=CAREFUL)
        return felt

    def reach(self, angle: float, *, above: float = 0.0, speed: float) -> None:
        """Bring the gripper to where the handle is when the lever is at an angle."""
        x, z = AXLE_X + RADIUS * math.sin(angle), AXLE_Z + RADIUS * math.cos(angle)
        self.mover.move(x=x, y=HANDLE_Y, z=z + above, twist=ACROSS, speed=speed)
