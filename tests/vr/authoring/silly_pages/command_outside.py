"""A command beside the class is never found."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)


@command
def go(self) -> None:
    """Go ahead."""

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 16: go is marked as a command and stands in no class, so no robot has it; make it a method of the robot's class
# check: line 16: go is marked as a command and stands in no class, so no robot has it: make it a method of the robot's class
