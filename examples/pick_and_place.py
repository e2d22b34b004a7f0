"""PickAndPlace: take a thing from one place on the table to another.

robotree create examples/pick_and_place.py as picker
robotree enslave picker.arm arm-1
robotree call picker.pick_and_place x="30 cm" y="-20 cm" to_x="30 cm" to_y="-30 cm"
"""

from typing import Annotated

from robotree.vr import Child, Failed, Range, Unit, VirtualRobot, command

Metres = Annotated[float, Unit("m"), Range(-0.6, 0.6)]
LOW, HIGH = 0.03, 0.15  # [m] of the gripper above the table: where it grips, and where it travels


class PickAndPlace(VirtualRobot):
    """An arm that moves things about."""

    arm = Child("Arm", "the arm beside the table")

    @command
    def pick_and_place(self, x: Metres, y: Metres, to_x: Metres, to_y: Metres) -> None:
        """Take what lies at x, y to to_x, to_y."""
        try:
            self._visit(x, y, "close")
            self.progress(0.5, "gripped")
            self._visit(to_x, to_y, "open")
        finally:
            with self.cleanup(within=5):
                self.arm.grip(action="open")

    def _visit(self, x: float, y: float, grip: str) -> None:
        for z in (HIGH, LOW):
            self.arm.go_to(x=x, y=y, z=z, twist=0)
        self.arm.grip(action=grip)
        self.arm.go_to(x=x, y=y, z=HIGH, twist=0)
        if grip == "close" and not self.arm.get_info().holding:
            raise Failed("nothing is there", x=x, y=y)
