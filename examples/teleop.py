"""TeleOp: drive an arm step by step, by hand.

    robotree create examples/teleop.py as teleop
    robotree enslave teleop.arm arm-1
    robotree call teleop.jog axis=x distance=5cm

Every step is bounded: a slip of the finger moves the arm by a hand's breadth and no further. A step begins
where the gripper really is, so that pushing on and on against something does not wind up more and more force.
"""

from typing import Annotated, Literal

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Step = Annotated[float, Unit("m"), Range(-0.10, 0.10), "how far; its sign says which way"]
Turn = Annotated[float, Unit("rad"), Range(-0.5, 0.5), "how far; positive is counterclockwise from above"]

CAREFUL = 0.08
"""[m/s] Slow enough to stop in time, quick enough not to bore."""


class TeleOp(VirtualRobot):
    """An arm in the hands of a person."""

    arm = Child("Arm", "the arm to be driven")

    @command
    def jog(self, axis: Literal["x", "y", "z"], distance: Step) -> None:
        """Move the gripper along one axis of the cell: x forward, y to the left, z up."""
        here = self.arm.get_info()
        place = {"x": here.x, "y": here.y, "z": here.z}
        place[axis] += distance
        self.arm.go_to(**place, twist=here.twist, speed=CAREFUL)

    @command
    def twist(self, angle: Turn) -> None:
        """Turn the gripper about the vertical."""
        here = self.arm.get_info()
        self.arm.go_to(x=here.x, y=here.y, z=here.z, twist=here.twist + angle)

    go_to = arm.exposed()
    get_info = arm.exposed()
    grip = arm.exposed()
    hold = arm.exposed()
    halt = arm.exposed()
