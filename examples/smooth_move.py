"""SmoothMove: one motion of so many small steps, after each of which the arm is looked at.

    robotree create examples/smooth_move.py as smooth on host-1
    robotree enslave smooth.arm arm-1
    robotree place smooth auto
    robotree call smooth.sweep steps=50 length="2 cm"

Each step needs two calls of the arm, so on a slow line the way takes as long as the line, and beside the arm
as long as the arm.
"""

from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Metres = Annotated[float, Unit("m"), Range(-0.1, 0.1), "how far it goes"]
Seconds = Annotated[float, Unit("s"), "that all steps took"]


class SmoothMove(VirtualRobot):
    """An arm that goes sideways in small and watched steps."""

    arm = Child("Arm", "the arm that is moved")

    @command
    def sweep(self, steps: Annotated[int, Range(1, 1000)] = 50, length: Metres = 0.02) -> Seconds:
        """Go sideways, and look where the arm is after each step."""
        began, start = self.now(), self.arm.get_info()
        for step in range(1, steps + 1):
            y, blend = start.y + length * step / steps, 0.005 if step < steps else 0.0
            self.arm.go_to(x=start.x, y=y, z=start.z, twist=start.twist, speed=0.2, blend=blend)
            here = self.arm.get_info()
            self.progress(step / steps, f"{(here.y - start.y) * 1000:.1f} mm")
        return self.now() - began
