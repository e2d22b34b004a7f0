"""MoveTo: the same way as `go_to`, but in small and watched steps.

    robotree create examples/move_to.py as mover
    robotree enslave mover.arm arm-1
    robotree call mover.move x=0.45 y=0 z=0.3 twist=0

`go_to` is one stride; `move` is many short ones, each begun only when the one before has arrived and the arm
has been looked at. Where something is in the way, the arm stops within one step of it.
"""

import math
from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Metres = Annotated[float, Unit("m"), Range(-0.8, 0.8)]
Radians = Annotated[float, Unit("rad"), Range(-math.pi, math.pi)]
Speed = Annotated[float, Unit("m/s"), Range(0.01, 0.2), "along the way"]

STRIDE = 0.07
"""[m] The longest step."""
TURN = 0.4
"""[rad] The furthest that one step turns."""


class MoveTo(VirtualRobot):
    """An arm that moves smoothly and looks where it goes."""

    arm = Child("Arm", "the arm that is moved")

    @command(effect="repeat")
    def move(self, x: Metres, y: Metres, z: Metres, twist: Radians, speed: Speed = 0.1) -> None:
        """Go to a point in small steps."""
        start = self.arm.get_info()
        goal = {"x": x, "y": y, "z": z, "twist": twist}
        way = {name: value - start[name] for name, value in goal.items()}
        length = math.hypot(way["x"], way["y"], way["z"])
        steps = max(1, math.ceil(length / STRIDE), math.ceil(abs(way["twist"]) / TURN))
        for step in range(1, steps + 1):
            part = step / steps
            self.arm.go_to(**{name: start[name] + part * way[name] for name in goal}, speed=speed)
            here = self.arm.get_info()
            left = math.dist((x, y, z), (here.x, here.y, here.z))
            self.progress(part, f"{left * 100:.0f} cm to go")

    go_to = arm.exposed()
    get_info = arm.exposed()
    grip = arm.exposed()
