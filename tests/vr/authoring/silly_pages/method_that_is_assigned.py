"""The next self.progress(…) would fail."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self) -> None:
        """Go ahead."""
        self.progress = 0.5

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 17: self.progress is what every robot uses itself, and this takes it away; keep the value under another name, such as self._progress
# check: line 17: self.progress is what every robot uses itself, and this takes it away: keep the value under another name, such as self._progress
