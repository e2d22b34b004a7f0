"""A host has no keyboard."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self) -> None:
        """Go ahead."""
        breakpoint()

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# check: line 17: breakpoint waits for a keyboard: a host has none: take it away, and use print, or it in a rehearsal
