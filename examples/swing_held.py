"""HeldMove: an arm that swings to and fro as long as somebody holds a key.

robotree create examples/swing_held.py as held
robotree enslave held.arm arm-1
robotree call held.swing width=5cm        hold a key; 2 s after the last one the arm stands

The robot ends the command by itself, whatever has become of the screen or the line between.
"""

from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Metres = Annotated[float, Unit("m"), Range(0.0, 0.1), "to each side"]


class HeldMove(VirtualRobot):
    """An arm that moves only while somebody attends it."""

    arm = Child("Arm", "the arm that is moved")

    @command(attended=True)
    def swing(self, width: Metres = 0.05) -> None:
        """Swing to and fro for as long as a key is held."""
        start, times = self.arm.get_info(), 0
        while True:
            for side in (width, -width):
                self.arm.go_to(x=start.x, y=start.y + side, z=start.z, twist=start.twist)
            times += 1
            self.progress(0.0, f"{times} times to and fro")
