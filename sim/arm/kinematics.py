"""Kinematics and dynamics of the arm, computed by Pinocchio from the very file that MuJoCo simulates.

Pure: the same arguments give the same results; the objects only keep scratch memory, so one belongs to one
thread.

Frames: W the world (the arm's foot, see `world`), T the tool point between the finger tips, z along
the fingers. `twist` is the angle of a tool that points straight down: R_WT = Rz(twist) Ry(pi). At twist 0 the
fingers open along y of W.

Inverse kinematics: damped least squares on the body-frame error log6(X_WT^-1 X_WG), the damping proportional
to the squared error (Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt
method", IEEE T-RO 2011, eq. 15), so that unreachable goals end quietly at the nearest posture instead of
oscillating.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from robotree.sim.arm.model import JOINTS, XML
from robotree.sim.physics.vectors import Matrix, Vector

HOME: Final = (0.0, -0.3, 1.9, 0.0, math.pi - 1.6, 0.0)
"""[rad] posture in which the arm is switched on: tool down, elbow up."""
ERROR_REACHED: Final = 1e-4
"""[m and rad, mixed norm] of the tool at which a posture counts as found."""
ROLL: Final = 3
"""The forearm's roll, which a tool that points down does not need. The search leaves it at 0: where the
forearm is vertical too, roll and twist turn about one line, and a free roll would wander off to its stop."""
DAMPING: Final = 1e-3
"""Damping per squared error; with the reach of this arm the median goal takes 7 iterations."""
STEP: Final = 0.3
"""[rad] the furthest one joint moves in one iteration."""


class Dynamics(NamedTuple):
    """The quantities of one instant that the control law needs.

    Attributes:
        position: (3,) of T in W [m].
        rotation: (3, 3) R_WT.
        jacobian: (6, 6) joint velocity -> linear and angular velocity of T, at T, axes of W.
        mass: (6, 6) joint-space inertia with the rotors [kg m2].
        mass_inverse: (6, 6) its inverse.
        bias: (6,) gravity and velocity torques [N m].
    """

    position: Vector
    rotation: Matrix
    jacobian: Matrix
    mass: Matrix
    mass_inverse: Matrix
    bias: Vector


@dataclass(frozen=True, slots=True)
class Solution:
    """An answer of inverse kinematics: the posture `q` (6,) [rad], and how far from the goal its tool is."""

    q: Vector
    error: float

    @property
    def reached(self) -> bool:
        """Whether the tool is at the goal."""
        return self.error < ERROR_REACHED


def tool_down(twist: float) -> Matrix:
    """R_WT of a tool that points straight down, turned by `twist` [rad] about the vertical."""
    c, s = math.cos(twist), math.sin(twist)
    return np.array(((-c, -s, 0.0), (-s, c, 0.0), (0.0, 0.0, -1.0)))


def twist_of(rotation: Matrix) -> float:
    """The twist [rad], in (-pi, pi], of a tool with R_WT that points roughly down."""
    return math.atan2(-rotation[0, 1], rotation[1, 1])


class Kinematics:
    """The arm with its fingers locked half open (they weigh a fiftieth of the arm)."""

    def __init__(self) -> None:
        full = pin.buildModelFromMJCF(str(XML))
        reference = np.zeros(full.nq)
        reference[JOINTS:] = 0.03
        fingers = [full.getJointId("slide_l"), full.getJointId("slide_r")]
        self._model = pin.buildReducedModel(full, fingers, reference)
        self._data = self._model.createData()
        self._tool = self._model.getFrameId("tcp")
        self.lower: Vector = np.array(self._model.lowerPositionLimit)
        self.upper: Vector = np.array(self._model.upperPositionLimit)

    def pose(self, q: Vector) -> tuple[Vector, Matrix]:
        """Position (3,) [m] and R_WT (3, 3) of the tool at the posture `q` (6,) [rad]."""
        pin.forwardKinematics(self._model, self._data, q)
        placement = pin.updateFramePlacement(self._model, self._data, self._tool)
        return np.array(placement.translation), np.array(placement.rotation)

    def skeleton(self, q: Vector) -> list[tuple[float, float, float]]:
        """Where foot, joints and tool are in W [m] at the posture `q` (6,) [rad], from below."""
        pin.forwardKinematics(self._model, self._data, q)
        tool = pin.updateFramePlacement(self._model, self._data, self._tool)
        joints = [self._data.oMi[joint].translation for joint in range(1, JOINTS + 1)]
        places = [*(place.tolist() for place in joints), tool.translation.tolist()]
        return [(0.0, 0.0, 0.0), *((x, y, z) for x, y, z in places)]

    def dynamics(self, q: Vector, v: Vector) -> Dynamics:
        """Everything the control law needs at `q` (6,) [rad] and `v` (6,) [rad/s].

        The arrays are valid until the next call: at 1 kHz copies would cost more than the law itself.
        """
        model, data = self._model, self._data
        pin.computeAllTerms(model, data, q, v)
        placement = pin.updateFramePlacement(model, data, self._tool)
        jacobian = pin.getFrameJacobian(model, data, self._tool, pin.LOCAL_WORLD_ALIGNED)
        inverse = pin.computeMinverse(model, data, q)
        return Dynamics(placement.translation, placement.rotation, jacobian, data.M, inverse, data.nle)

    def solve(self, position: Vector, rotation: Matrix, seed: Vector, iterations: int = 60) -> Solution:
        """Find the posture near `seed`, its forearm not rolled, that brings the tool to a pose.

        Args:
            position: (3,) of T in W [m].
            rotation: (3, 3) R_WT.
            seed: (6,) where to begin [rad].
            iterations: when to give up.
        """
        model, data = self._model, self._data
        goal = pin.SE3(rotation, position)
        q = np.array(seed)
        q[ROLL] = 0.0
        squared = math.inf
        for _ in range(iterations):
            pin.forwardKinematics(model, data, q)
            placement = pin.updateFramePlacement(model, data, self._tool)
            error = pin.log6(placement.actInv(goal)).vector
            squared = float(error @ error)
            if squared < ERROR_REACHED**2:
                break
            jacobian = pin.computeFrameJacobian(model, data, q, self._tool, pin.LOCAL)
            jacobian[:, ROLL] = 0.0
            damping = (DAMPING * squared + 1e-9) * np.eye(6)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping, error)
            furthest = float(np.abs(step).max())
            if furthest > STEP:
                step *= STEP / furthest
            q = np.clip(q + step, self.lower, self.upper)
        return Solution(q, math.sqrt(squared))
