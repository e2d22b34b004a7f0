"""A place is not measured in kilograms."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    go_to = arm.exposed(x=Unit("kg"))

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# check: line 14: arm.go_to: x: kg cannot be turned into m; give it in m
