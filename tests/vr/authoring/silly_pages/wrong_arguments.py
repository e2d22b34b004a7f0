"""Arguments are checked without a robot."""

from typing import Annotated

from robotree.vr import Child, Children, Range, Unit, VirtualRobot, command


class Team(VirtualRobot):
    """An arm and its rovers."""

    arm = Child("Arm")
    rovers = Children("Rover", least=0)

    @command
    def go(self) -> None:
        """Go ahead."""
        self.arm.go_to(x=0.3, y=0, twist=0)
        self.arm.go_to(x=0.3, y=0, z="2 kg", twist=0)
        self.arm.grip("shut")
        self.arm.grip.start(action="open", widht=0.02)

# Written below: what a host says (when it refuses the page), and what `robotree check` finds.
# check: line 17: arm.go_to needs z: it takes: x, y, z, twist, speed, blend
# check: line 18: arm.go_to: z: kg cannot be turned into m; give it in m
# check: line 19: arm.grip: action: 'shut' is not one of open, close, width
# check: line 20: arm.grip has no parameter 'widht': did you mean width?
