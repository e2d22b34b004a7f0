"""It would fail in the emergency."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    def safe_stop(self) -> None:
        self.valve = 0

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 14: Team.safe_stop must take what the robot gives it: write def safe_stop(self, reason)
# check: line 14: Team.safe_stop must take what the robot gives it: write def safe_stop(self, reason): a host refuses the page like this
# check: line 15: self.valve does not survive a reload: declare it in the class, `valve: int = state(0)` with its type, or name it _valve
