"""Patrol: a robot that travels to where its next robot is, and drives it from there.

robotree create examples/patrol.py as patrol near_host=host-1 far_host=host-2
robotree enslave patrol.near rover-1
robotree enslave patrol.far rover-2
robotree call patrol.patrol rounds=2

With `far_host=hall:host-2` it travels to another site, as a bundle. It brings a panel: patrol.panel.yaml.
"""

from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command, state

Metres = Annotated[float, Unit("m"), Range(0.02, 1.0), "of one leg"]


class Patrol(VirtualRobot):
    """Two rovers at two places, and a robot that goes from one to the other."""

    near = Child("Rover", "the rover near the first host")
    far = Child("Rover", "the rover near the second host")
    near_host: str = "host-1"
    far_host: str = "host-2"
    legs: int = state(0)  # travels with it

    def readings(self) -> dict[str, float]:
        """Show on its panel how far it is."""
        return {"legs": float(self.legs)}

    @command
    def patrol(self, rounds: Annotated[int, Range(1, 100)], leg: Metres = 0.1) -> int:
        """Have both rovers drive out and back in turns, each from the host beside it."""
        for _ in range(rounds):
            for rover, host in ((self.near, self.near_host), (self.far, self.far_host)):
                self.move_to(host)  # what follows is carried out there
                rover.move(x=leg, y=0)
                rover.move(x=-leg, y=0)
                self.legs += 2
        return self.legs
