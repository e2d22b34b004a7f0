"""The panel would stay empty."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    def readings(self, scale: float) -> dict[str, float]:
        return {"height": scale}

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: Team.readings must take what the robot gives it: write def readings(self)
# check: line 14: Team.readings must take what the robot gives it: write def readings(self): a host refuses the page like this
