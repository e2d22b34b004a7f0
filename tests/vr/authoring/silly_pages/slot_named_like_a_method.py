"""A slot hides what each command calls."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    sleep = Child("Arm")

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: Team.sleep: it cannot have this name; every robot uses it itself
# check: line 14: Team.sleep: it cannot have this name; every robot uses it itself: a host refuses the page like this
