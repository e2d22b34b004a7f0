"""TwoArms: one robot that commands two arms at once.

    robotree create examples/two_arms.py as pair
    robotree enslave pair.left arm-1
    robotree enslave pair.right arm-2
    robotree call pair.lift height=10cm

What is started in a block of `together` runs at the same time; the block waits for the end of all, and if one
fails, the others are cancelled.
"""

from typing import Annotated, Literal

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Height = Annotated[float, Unit("m"), Range(-0.2, 0.2), "how far up; negative: down"]
Metres = Annotated[float, Unit("m"), "how far apart they are in height"]


class TwoArms(VirtualRobot):
    """Two arms that do the same thing at the same time."""

    left = Child("Arm")
    right = Child("Arm")

    @command
    def lift(self, height: Height) -> Metres:
        """Raise both grippers, each from where it is."""
        arms = self.left, self.right
        places = [arm.get_info() for arm in arms]
        with self.together() as both:
            for arm, at in zip(arms, places, strict=True):
                both.start(arm.go_to, x=at.x, y=at.y, z=at.z + height, twist=at.twist)
        left, right = (arm.get_info().z for arm in arms)
        return float(abs(left - right))

    @command(effect="repeat")
    def grip(self, action: Literal["open", "close"]) -> None:
        """Open or close both grippers."""
        with self.together() as both:
            both.start(self.left.grip, action=action)
            both.start(self.right.grip, action=action)
