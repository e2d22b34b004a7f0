"""MoveSquare: the first example of the thesis, a rover that drives in squares.

robotree create examples/move_square.py as square
robotree enslave square.rover rover-1
robotree call square.move_square length="50 cm"
"""

from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Metres = Annotated[float, Unit("m"), Range(0.02, 1.0), "of one side"]


class MoveSquare(VirtualRobot):
    """A rover that can also drive in squares."""

    rover = Child("Rover", "the rover that drives")

    @command
    def move_square(self, length: Metres) -> None:
        """Drive one square, counterclockwise, and end where it began."""
        for x, y in ((length, 0), (0, length), (-length, 0), (0, -length)):
            self.rover.move(x=x, y=y)  # waits; .tell(...) is one-way, .start(...) gives a future

    move = rover.exposed()  # what is not exposed cannot be called from above
