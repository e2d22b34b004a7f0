"""All of them are named, not the first alone."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    async def go(self) -> None:
        """Go ahead."""

    @command
    async def back(self) -> None:
        """Go back."""

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# host: line 15: Team.go: write it without async; a command has a thread of its own and may block
# check: line 15: Team.go: write it without async: a command has a thread of its own and may block
# check: line 19: Team.back: write it without async: a command has a thread of its own and may block
