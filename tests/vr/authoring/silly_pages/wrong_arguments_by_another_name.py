"""A name that stands for a child, and a loop."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self) -> None:
        """Go ahead."""
        arm = self.arm
        arm.grip("shut")
        for rover in self.rovers:
            rover.move(dx=1)
        for _, rover in self.rovers.items():
            rover.fly()
        for other in self.rovers.values():
            other.halt()
        with self.together() as all_of_them:
            all_of_them.start(self.rovers[0].move, x=1)

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# check: line 18: arm.grip: action: 'shut' is not one of open, close, width
# check: line 20: rovers.move has no parameter 'dx': did you mean x?
# check: line 20: rovers.move needs x: it takes: x, y, speed
# check: line 20: rovers.move needs y: it takes: x, y, speed
# check: line 22: rovers is of kind Rover, which has no command 'fly': it has: get_info, halt, move
# check: line 23: self.rovers has no values(): write for child in self.rovers, or self.rovers.items()
# check: line 26: rovers.move needs y: it takes: x, y, speed
