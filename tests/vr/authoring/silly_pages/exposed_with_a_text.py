"""A unit is written Unit(…)."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    go_to = arm.exposed(x="mm")

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: exposed(x='mm'): a unit is written x=Unit('mm')
# check: line 14: exposed(x='mm'): a unit is written x=Unit('mm'): a host refuses the page like this
