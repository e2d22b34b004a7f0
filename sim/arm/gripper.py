"""The parallel gripper: how its fingers are led to a width, and what they are doing.

Pure: widths, speeds and seconds in, set-points and a state out.
"""

from enum import Enum
from typing import Final

from robotree.sim.firmware.device import WIDEST

SPEED: Final = 0.12
"""[m/s] of the gap, unless it is tuned."""
AT_WIDTH: Final = 0.001
"""[m] that counts as being at the width asked for."""
STILL: Final = 0.002
"""[m/s] of the gap below which the fingers stand."""
STILL_FOR: Final = 0.2
"""[s] of standing short of the width after which something is held."""
YIELDS: Final = 0.002
"""[m] by which the gap may change while the same thing is held: a hand that is carried about shakes."""


class Grip(Enum):
    """The state of the fingers."""

    AT_WIDTH = "at the width asked for"
    MOVING = "moving"
    HOLDING = "holding something"


class Gripper:
    """Leads the fingers.

    Args:
        width: the gap at first [m].
    """

    def __init__(self, width: float) -> None:
        self.commanded = width
        """Width asked for [m]."""
        self.speed = SPEED
        """At which the gap is led [m/s]."""
        self.state = Grip.AT_WIDTH
        self._led = width
        self._still = 0.0
        self._held = width

    def move(self, width: float) -> None:
        """Ask for a gap of `width` [m]."""
        self.commanded = min(max(width, 0.0), WIDEST)
        self.state = Grip.MOVING
        self._still = 0.0

    def halt(self, width: float) -> None:
        """Stop the fingers at `width` [m] if they are on their way; what they hold they keep."""
        if self.state is Grip.MOVING:
            self.commanded = self._led = min(max(width, 0.0), WIDEST)

    def advance(self, dt: float, width: float, speed: float) -> float:
        """Lead on for `dt` [s], the gap being `width` [m] and changing by `speed` [m/s].

        Args:
            dt: control period [s].
            width: the gap now [m].
            speed: its rate of change [m/s].

        Returns:
            The gap that the servo should hold now [m].
        """
        step = self.speed * dt
        self._led += min(max(self.commanded - self._led, -step), step)
        led_there = self._led == self.commanded
        self._still = self._still + dt if led_there and abs(speed) < STILL else 0.0
        if abs(width - self.commanded) < AT_WIDTH:
            self.state = Grip.AT_WIDTH if led_there else self.state
        elif self._still >= STILL_FOR and self.state is not Grip.HOLDING:
            self.state, self._held = Grip.HOLDING, width
        elif self.state is Grip.AT_WIDTH or abs(width - self._held) >= YIELDS:
            self.state = Grip.MOVING
        return self._led
