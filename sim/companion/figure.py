"""Kinematics, dynamics and shape of the companion, computed by Pinocchio from the file that MuJoCo simulates.

Pure: the same arguments give the same results; a figure only keeps scratch memory, so one belongs to one
thread.

Body frame B: on the floor in the middle of the wheels, x forward, y left, z up. Tool frame T of a hand: at
the point between the finger tips, z along the fingers. A tool is turned by `twist` about the vertical and
raised by `tilt`: R_BT = Rz(twist) Ry(pi - tilt); at tilt 0 it points down, at pi/2 forward along `twist`. At
twist 0 the fingers open along y of B.

Inverse kinematics: damped least squares (Sugihara, IEEE T-RO 2011, eq. 15), as in `arm.kinematics`, over the
six joints of one arm; waist and neck stay.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from robotree.sim.arm.kinematics import Dynamics, Solution
from robotree.sim.physics.vectors import Matrix, Vector

XML: Final = Path(__file__).with_name("companion.xml")
ARM_JOINTS: Final = 6
LEAN: Final = 0
NECK: Final = slice(1, 3)
ARMS: Final = (slice(3, 9), slice(9, 15))
"""Where lean, neck, left and right arm stand in the figure's joints."""
SIDES: Final = ("left", "right")
JOINTS: Final = 15
JOINT_NAMES: Final = ("lean", "pan", "tilt", *(f"{side}_j{i}" for side in SIDES for i in range(1, 7)))
DAMPING: Final = 1e-3
STEP: Final = 0.4
"""[rad] the furthest one joint moves in one iteration."""
REACHED: Final = 1e-4
"""[m and rad, mixed norm] of the tool at which a posture counts as found."""
STALLS: Final = 8
"""Iterations after which a search must have come nearer; one that has not will not reach the pose."""
NEARER: Final = 0.9
"""Share of the squared error of `STALLS` iterations before, which is the most that may be left. Of searches
that reached random poses in the whole room of the arm 1 in 100 was slower, and another seed found the pose;
those that do not reach theirs are ended after 15 iterations in the mean instead of 40."""
SPAN: Final = 0.68
"""[m] from the shoulder to the tool of a stretched arm; further away nothing need be tried."""


def tool(twist: float, tilt: float) -> Matrix:
    """R_BT of a tool that is turned by `twist` about the vertical and raised by `tilt` [rad]."""
    cz, sz = math.cos(twist), math.sin(twist)
    cy, sy = math.cos(math.pi - tilt), math.sin(math.pi - tilt)
    return np.array(((cz * cy, -sz, cz * sy), (sz * cy, cz, sz * sy), (-sy, 0.0, cy)))


class Pose(NamedTuple):
    """A tool: `position` (3,) in B [m] and `rotation` (3, 3) R_BT."""

    position: Vector
    rotation: Matrix


@dataclass(frozen=True, slots=True)
class Balance:
    """Where the weight is: `centre` (3,) of mass in B [m] and `mass` [kg]."""

    centre: Vector
    mass: float


class Figure:
    """The companion with its fingers locked half open (they weigh a hundredth of it)."""

    def __init__(self, path: Path = XML) -> None:
        full = pin.buildModelFromMJCF(str(path))
        shapes = pin.buildGeomFromMJCF(full, str(path), pin.COLLISION)
        reference = np.zeros(full.nq)
        fingers = [full.getJointId(f"{side}_slide_{end}") for side in SIDES for end in "lr"]
        for finger in fingers:
            reference[full.joints[finger].idx_q] = 0.03
        self.model, (self.shapes,) = pin.buildReducedModel(full, [shapes], fingers, reference)
        self.data = self.model.createData()
        self._tools = [self.model.getFrameId(f"{side}_tcp") for side in SIDES]
        self._bodies = [
            [self.model.getJointId(f"{side}_j{i}") for i in range(1, ARM_JOINTS + 1)] for side in SIDES
        ]
        self.lower: Vector = np.array(self.model.lowerPositionLimit)
        self.upper: Vector = np.array(self.model.upperPositionLimit)
        root = full.inertias[0]
        self._root_mass, self._root_moment = float(root.mass), root.mass * np.array(root.lever)
        self._above_mass = sum(float(each.mass) for each in self.model.inertias[1:])

    def pose(self, side: int, q: Vector) -> Pose:
        """Where a tool is at the posture `q` (15,) [rad]."""
        pin.forwardKinematics(self.model, self.data, q)
        return self._placed(side)

    def poses(self, q: Vector) -> tuple[Pose, Pose]:
        """Where both tools are."""
        pin.forwardKinematics(self.model, self.data, q)
        return self._placed(0), self._placed(1)

    def _placed(self, side: int) -> Pose:
        placement = pin.updateFramePlacement(self.model, self.data, self._tools[side])
        return Pose(np.array(placement.translation), np.array(placement.rotation))

    def shoulder(self, side: int, q: Vector) -> Vector:
        """(3,) where an arm begins, in B [m]."""
        pin.forwardKinematics(self.model, self.data, q)
        return np.array(self.data.oMi[self._bodies[side][0]].translation)

    def dynamics(self, q: Vector, v: Vector) -> tuple[Vector, tuple[Dynamics, Dynamics]]:
        """Gravity and velocity torques (15,) [N m], and what the law of each arm needs.

        The body is taken to stand still under the arms: lean and base move slowly, and what they do to the
        arms is left to the spring.
        """
        model, data = self.model, self.data
        pin.computeAllTerms(model, data, q, v)
        bias = np.array(data.nle)
        mass = data.M
        arms: list[Dynamics] = []
        for side, axes in enumerate(ARMS):
            placement = pin.updateFramePlacement(model, data, self._tools[side])
            jacobian = pin.getFrameJacobian(model, data, self._tools[side], pin.LOCAL_WORLD_ALIGNED)[:, axes]
            own = np.array(mass[axes, axes])
            arms.append(
                Dynamics(
                    np.array(placement.translation),
                    np.array(placement.rotation),
                    jacobian,
                    own,
                    np.asarray(np.linalg.inv(own), np.float64),
                    bias[axes],
                )
            )
        return bias, (arms[0], arms[1])

    def balance(self, q: Vector) -> Balance:
        """Where the weight is at the posture `q` (15,)."""
        above = pin.centerOfMass(self.model, self.data, q)
        mass = self._above_mass + self._root_mass
        return Balance((self._above_mass * np.array(above) + self._root_moment) / mass, mass)

    def solve(self, side: int, goal: Pose, q: Vector, seed: Vector, iterations: int = 60) -> Solution:
        """Find the posture of one arm near `seed` (6,) that brings its tool to a pose.

        Args:
            side: which arm.
            goal: in B.
            q: (15,) what the other joints are [rad].
            seed: (6,) where to begin [rad].
            iterations: when to give up.
        """
        model, data, axes, frame = self.model, self.data, ARMS[side], self._tools[side]
        lower, upper = self.lower[axes], self.upper[axes]
        whole = np.array(q)
        whole[axes] = seed
        target = pin.SE3(goal.rotation, goal.position)
        squared, before = math.inf, [math.inf] * STALLS
        for i in range(iterations):
            pin.forwardKinematics(model, data, whole)
            placement = pin.updateFramePlacement(model, data, frame)
            error = pin.log6(placement.actInv(target)).vector
            squared = float(error @ error)
            if squared < REACHED**2 or squared > NEARER * before[i % STALLS]:
                break
            before[i % STALLS] = squared
            jacobian = pin.computeFrameJacobian(model, data, whole, frame, pin.LOCAL)[:, axes]
            damping = (DAMPING * squared + 1e-9) * _I6
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + damping, error)
            furthest = float(np.abs(step).max())
            if furthest > STEP:
                step *= STEP / furthest
            whole[axes] = np.clip(whole[axes] + step, lower, upper)
        return Solution(np.array(whole[axes]), math.sqrt(squared))


_I6: Final = np.eye(6)
