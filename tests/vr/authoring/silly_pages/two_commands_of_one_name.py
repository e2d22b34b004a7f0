"""The second command replaces the first."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self) -> None:
        """Go ahead."""

    @command
    def go(self, distance: float) -> None:
        """Go a distance."""

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 19: Team.go is a command in line 15 already, and this replaces it; give one of them another name
# check: line 19: Team.go is a command in line 15 already, and this replaces it: give one of them another name
