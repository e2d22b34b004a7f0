"""The command replaces the slot."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def arm(self) -> None:
        """Lift the arm."""

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 15: Team.arm is a slot in line 11 already, and this replaces it; give one of them another name
# check: line 15: Team.arm is a slot in line 11 already, and this replaces it: give one of them another name
