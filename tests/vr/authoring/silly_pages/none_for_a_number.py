"""None is no number."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self, distance: float = None) -> None:
        """Go a distance."""

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 15: default of Team.go: distance: None is no float; write distance: … | None = None, or another default
# check: line 15: default of Team.go: distance: None is no float; write distance: … | None = None, or another default: a host refuses the page like this
