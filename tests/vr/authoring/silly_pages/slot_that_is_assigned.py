"""The child would be gone."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self) -> None:
        """Go ahead."""
        self.arm = 3

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 17: self.arm is a slot, and this takes the child away; keep the value under another name, such as self._arm
# check: line 17: self.arm is a slot, and this takes the child away: keep the value under another name, such as self._arm
