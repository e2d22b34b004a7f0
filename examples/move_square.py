"""MoveSquare: the first example of the thesis, a rover that drives in squares.

robotree create examples/move_square.py as square
robotree enslave square.rover rover-1
robotree call square.move_square length=20
"""

from typing import Annotated

from robotree.vr import Child, Range, Unit, VirtualRobot, command

Inches = Annotated[float, Unit("in"), Range(1, 40), "of one side"]
METRE = 39.37
"""[in]"""


class MoveSquare(VirtualRobot):
    """A rover that can also drive in squares."""

    rover = Child("Rover", "the rover that drives")

    @command
    def move_square(self, length: Inches) -> None:
        """Drive one square, counterclockwise, and end where it began."""
        side = length / METRE
        for x, y in ((side, 0), (0, side), (-side, 0), (0, -side)):
            self.rover.move(x=x, y=y)  # waits; .tell(...) is one-way, .start(...) gives a future

    move = rover.exposed()  # what is not exposed cannot be called from above
