"""A lambda has no name."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    go = command(lambda self: None)

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: a command is a method with a name; write it with def instead of lambda
# check: line 14: a command is a method with a name; write it with def instead of lambda: a host refuses the page like this
