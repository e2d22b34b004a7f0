"""All calls would share the list."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    def _sum(self, numbers: list[float] = []) -> float:
        return sum(numbers)

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# check: line 14: all calls of _sum share the default []: write None, and make it inside of the function
