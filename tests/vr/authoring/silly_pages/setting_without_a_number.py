"""None is no number, in a setting either."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    speed: Annotated[float, Unit("m/s")] = None

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: default of Team: speed: None is no float; write speed: … | None = None, or another default
# check: line 14: default of Team: speed: None is no float; write speed: … | None = None, or another default: a host refuses the page like this
