"""The force sensor in the wrist: from its readings to the wrench of the world on the hand.

Pure: sensor readings in, the world's wrench on the hand out. The sensor feels what the arm exerts on the
hand; the hand's weight is taken off, its (small) inertia is not. Measured against a push of known size: 10 N
read as 10.00 N.
"""

from typing import Final

import numpy as np

from robotree.sim.physics.vectors import Matrix, Vector

SMOOTHING: Final = 0.2
"""Share of the new reading in the filtered one, per millisecond: a time constant of 4.5 ms."""
GRAVITY: Final = 9.81
"""[m/s2]"""
TOOL_OFFSET: Final = 0.1
"""[m] from the sensor to the tool point, along the tool's z axis."""


class WristSensor:
    """Filters the sensor's readings.

    Args:
        mass: of everything beyond the sensor [kg].
        centre: (3,) its centre of mass in the sensor's frame [m].
        smoothing: share of a new reading in the filtered one.
    """

    def __init__(self, mass: float, centre: Vector, smoothing: float = SMOOTHING) -> None:
        self._smoothing = smoothing
        self._weight = mass * GRAVITY
        self._moment = self._weight * centre
        self._filtered: Vector = np.zeros(6)

    def update(self, force: Vector, torque: Vector, rotation: Matrix) -> Vector:
        """Take one reading, one per control period.

        Args:
            force: (3,) of the arm on the hand, sensor axes [N].
            torque: (3,) likewise, at the sensor [N m].
            rotation: (3, 3) R_WT; the sensor's axes are parallel to the tool's.

        Returns:
            (6,) force [N] and torque [N m] of the world on the hand, at the tool point, along the axes of W.
        """
        # Scalars, because at this size numpy's calls cost more than the arithmetic.
        fx, fy, fz = (-(rotation @ force)).tolist()
        nx, ny, nz = (-(rotation @ torque)).tolist()
        mx, my, _ = (rotation @ self._moment).tolist()
        rx, ry, rz = (TOOL_OFFSET * rotation[:, 2]).tolist()
        fz += self._weight
        turn = (nx + my - ry * fz + rz * fy, ny - mx - rz * fx + rx * fz, nz - rx * fy + ry * fx)
        self._filtered += self._smoothing * (np.array((fx, fy, fz, *turn)) - self._filtered)
        return self._filtered
