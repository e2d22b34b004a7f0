"""Patrol: a robot that travels to where its next robot is, and drives it from there.

robotree create examples/patrol.py as patrol
robotree enslave patrol.near rover-1
robotree enslave patrol.far rover-2
robotree call patrol.patrol rounds=2

It asks where its next robot lives, and goes there by itself, as a bundle also to another site. A rover that
is a proxy lives on no host: then it goes to one beside it, or where `near_host=h1` and `far_host=h2` say.
It brings a panel: patrol.panel.yaml.
"""

from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command, state

Metres = Annotated[float, Unit("m"), Range(0.02, 1.0), "of one leg"]


class Patrol(VirtualRobot):
    """Two rovers at two places, and a robot that goes from one to the other."""

    near = Child("Rover", "the rover near the first host")
    far = Child("Rover", "the rover near the second host")
    near_host: str = ""
    far_host: str = ""
    legs: int = state(0)  # travels with it
    moves: int = state(0)

    def readings(self) -> dict[str, float]:
        """Show on its panel how far it is."""
        return {"legs": float(self.legs), "moves": float(self.moves)}

    @command
    def patrol(self, rounds: Annotated[int, Range(1, 100)], leg: Metres = 0.1) -> int:
        """Have both rovers drive out and back in turns, each from the host beside it."""
        for _ in range(rounds):
            for rover, wish in ((self.near, self.near_host), (self.far, self.far_host)):
                host = wish or self.host_of(rover)  # asked anew: it may have moved meanwhile
                self.progress(0.0, f"drives {rover} from {host}")
                self.move_to(host)  # what follows is carried out there
                self.moves += 1
                rover.move(x=leg, y=0)
                rover.move(x=-leg, y=0)
                self.legs += 2
        return self.legs
