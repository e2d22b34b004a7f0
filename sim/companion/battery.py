"""The battery: it empties by what computers and motors draw, and charges at its place. Pure."""

from typing import Final

CAPACITY: Final = 400.0 * 3600.0
"""[J]: 400 Wh."""
IDLE: Final = 70.0
"""[W] of computers, cameras and brakes."""
LOSSES: Final = 2.0
"""times the mechanical power of the motors that they draw."""
CHARGING: Final = 600.0
"""[W] at the charging place."""
FULL_VOLTAGE, EMPTY_VOLTAGE = 29.4, 21.0
"""[V] of seven lithium cells."""
EMPTY: Final = 0.03
"""Share below which nothing begins to move any more; what is left holds the arms."""


class Battery:
    """How full it is, and what flows."""

    def __init__(self) -> None:
        self.charge = 0.86
        """Share, 0 to 1."""
        self.power = -IDLE
        """[W] into the battery."""

    @property
    def charging(self) -> bool:
        """Whether it charges."""
        return self.power > 0.0

    @property
    def empty(self) -> bool:
        """Whether nothing may begin to move any more."""
        return self.charge < EMPTY

    @property
    def voltage(self) -> float:
        """Between the poles [V]."""
        return EMPTY_VOLTAGE + (FULL_VOLTAGE - EMPTY_VOLTAGE) * self.charge

    @property
    def current(self) -> float:
        """[A] out of the battery."""
        return -self.power / self.voltage

    def advance(self, dt: float, effort: float, *, docked: bool) -> None:
        """Go on for `dt` [s] with a mechanical power of the motors of `effort` [W]."""
        self.power = (CHARGING if docked and self.charge < 1.0 else 0.0) - IDLE - LOSSES * effort
        self.charge = min(max(self.charge + self.power * dt / CAPACITY, 0.0), 1.0)
