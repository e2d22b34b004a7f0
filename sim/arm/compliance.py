"""The control law: natural admittance in the tool's space.

The tool hangs on a spring and a damper whose other end, the attractor, follows the path; the spring's pull is
bounded, so the steady force on anything in the way is bounded too, whatever arrives over the network and
however late.

    e   = (x_a - x,  log3(R_a R^T))                     tool error
    f   = sat(K e) - D (J v - v_a)                      |force| <= FORCE_LIMIT, |torque| <= TORQUE_LIMIT
    tau = J^T f + bias(q, v) + posture                  impedance
    a_r = M^-1 (J^T f + J^T w)                          without friction, the world's wrench being w
    v_r += dt (a_r + LEAK (v - v_r))                    a reference with the arm's own inertia
    tau += BETA M (v_r - v)                             velocity servo on that reference

The posture term is a weak spring between the joints and those of a posture that brings the tool to the
attractor. It decides where the tool's spring alone leaves the joints to chance: in the arm of the cell, whose
forearm may hang vertically, roll and twist turn about one line; in an arm that can be stretched, the elbow
may bend to either side. The posture has its tool at the attractor, so the term costs no accuracy.

Keeping the arm's own inertia in the reference is what makes the admittance *natural* (Newman, "Stability and
performance limits of interaction controllers", ASME JDSMC 1992; Glosser and Newman, "The implementation of a
natural admittance controller on an industrial manipulator", ICRA 1994): friction is rejected by BETA / (BETA
+ LEAK), an outside force is obeyed, and contact with any passive environment stays stable. Stiffness may grow
to 16 times K against a rigid table before dt = 8 ms would become unstable; the step here is 1 ms.

Pure: state in, torque out; the only memory is the reference velocity.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from robotree.sim.arm.kinematics import Dynamics, tool_down
from robotree.sim.motion.path import Reference
from robotree.sim.physics.vectors import Matrix, Vector

FORCE_LIMIT: Final = 30.0
"""[N] pull of the translational spring; the steady force the tool can exert."""
TORQUE_LIMIT: Final = 4.0
"""[N m] pull of the rotational spring."""

TOOL_STIFFNESS: Final = 500.0
"""[N/m] of the translational spring: a push of 10 N yields 20 mm."""
STIFFENING: Final = 500.0
"""[N/m per s] at which the spring is tuned."""
STRENGTHENING: Final = 20.0
"""[N/s] at which the bound of its pull is tuned."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Numbers of the law; chosen by measurement on this arm.

    Attributes:
        stiffness: (6,) K, x y z [N/m] and about x y z [N m/rad].
        damping: (6,) D, [N s/m] and [N m s/rad]; critical for the 6 kg felt at the tool.
        posture_stiffness: (6,) of the posture spring, by joint [N m/rad].
        posture_damping: (6,) [N m s/rad].
        beta: gain of the velocity servo [1/s].
        leak: how fast the reference forgets what the arm does not follow [1/s].
    """

    stiffness: tuple[float, ...] = (TOOL_STIFFNESS, TOOL_STIFFNESS, TOOL_STIFFNESS, 30.0, 30.0, 12.0)
    damping: tuple[float, ...] = (110.0, 110.0, 110.0, 3.2, 3.2, 1.0)
    posture_stiffness: tuple[float, ...] = (0.0, 0.0, 0.0, 6.0, 0.0, 0.0)
    posture_damping: tuple[float, ...] = (0.0, 0.0, 0.0, 0.6, 0.0, 0.0)
    beta: float = 80.0
    leak: float = 8.0


class Attractor(NamedTuple):
    """The far end of the spring.

    Attributes:
        position: (3,) of the tool [m].
        rotation: (3, 3) of the tool.
        velocity: (6,) linear [m/s] and angular [rad/s].
        posture: (6,) joint angles to which the posture spring leads [rad].
    """

    position: Vector
    rotation: Matrix
    velocity: Vector
    posture: Vector


def pointing_down(reference: Reference) -> Attractor:
    """The attractor of a tool that points down.

    Args:
        reference: x, y, z [m] and twist [rad], and their velocities.
    """
    (_, _, _, twist), (vx, vy, vz, spin) = reference
    velocity = np.array((vx, vy, vz, 0.0, 0.0, spin))
    return Attractor(reference.pose[:3], tool_down(float(twist)), velocity, _STRAIGHT)


_STRAIGHT: Final = np.zeros(6)
"""The posture spring of the cell's arm acts on the forearm's roll alone, which is best at 0."""


class Effort(NamedTuple):
    """The law's answer.

    Attributes:
        torque: (6,) for the joints [N m].
        load: pull of the spring as a share of its limit; 1 and more: saturated.
        error: (3,) from the tool to the attractor [m].
    """

    torque: Vector
    load: float
    error: Vector


class NaturalAdmittance:
    """The law above for one arm."""

    def __init__(self, gains: Gains | None = None) -> None:
        gains = gains or Gains()
        self._stiffness: Vector = np.array(gains.stiffness)
        self._damping: Vector = np.array(gains.damping)
        self._posture_stiffness: Vector = np.array(gains.posture_stiffness)
        self._posture_damping: Vector = np.array(gains.posture_damping)
        self._beta, self._leak = gains.beta, gains.leak
        self._reference: Vector = np.zeros(6)
        self._critical = gains.damping[0] / math.sqrt(gains.stiffness[0])
        self.stiffness, self.force_limit = gains.stiffness[0], FORCE_LIMIT
        """Of the translational spring: [N/m], and its largest pull [N]. Set them with `tune`."""
        self.braking = 1.0
        """By which the damping of translation is multiplied; up to 6 was tried, the step being 1 ms."""

    def tune(self, stiffness: float, force_limit: float, dt: float) -> None:
        """Bring the translational spring nearer to what is wanted of it.

        A spring that is taut must not jump when it is tuned, so both change at `STIFFENING` and
        `STRENGTHENING`. The damping keeps its ratio to the critical one: D ~ sqrt(K).

        Args:
            stiffness: wanted [N/m].
            force_limit: wanted [N].
            dt: control period [s].
        """
        if stiffness == self.stiffness and force_limit == self.force_limit:
            return
        self.stiffness = _nearer(self.stiffness, stiffness, STIFFENING * dt)
        self.force_limit = _nearer(self.force_limit, force_limit, STRENGTHENING * dt)
        self._stiffness[:3] = self.stiffness
        self._damping[:3] = self._critical * math.sqrt(self.stiffness)

    def begin(self, v: Vector) -> None:
        """Go on from the velocity (6,) [rad/s] that the arm has, whatever the reference would still do."""
        self._reference = np.array(v)

    def effort(
        self, dynamics: Dynamics, q: Vector, v: Vector, attractor: Attractor, wrench: Vector, dt: float
    ) -> Effort:
        """Torques for the next `dt` [s].

        Args:
            dynamics: of the arm now.
            q: (6,) joint angles [rad].
            v: (6,) joint velocities [rad/s].
            attractor: far end of the spring.
            wrench: (6,) of the world on the tool, at T, axes of W [N, N m].
            dt: control period [s].

        Returns:
            The joint torques and the state of the spring.
        """
        jacobian = dynamics.jacobian
        error: Vector = np.empty(6)
        error[:3] = attractor.position - dynamics.position
        error[3:] = pin.log3(attractor.rotation @ dynamics.rotation.T)
        force = self._stiffness * error
        fx, fy, fz, tx, ty, tz = force.tolist()
        pull, turn = math.hypot(fx, fy, fz) / self.force_limit, math.hypot(tx, ty, tz) / TORQUE_LIMIT
        if pull > 1.0:
            force[:3] /= pull
        if turn > 1.0:
            force[3:] /= turn
        slip = jacobian @ v - attractor.velocity
        slip[:3] *= self.braking
        force -= self._damping * slip
        transposed = jacobian.T
        wanted = transposed @ force
        wanted += self._posture_stiffness * (attractor.posture - q) - self._posture_damping * v
        self._reference += dt * (
            dynamics.mass_inverse @ (wanted + transposed @ wrench) + self._leak * (v - self._reference)
        )
        torque = wanted + dynamics.bias + self._beta * (dynamics.mass @ (self._reference - v))
        return Effort(torque, max(pull, turn), error[:3])


def _nearer(now: float, wanted: float, step: float) -> float:
    """`now`, moved towards `wanted` by `step` at most."""
    return now + min(max(wanted - now, -step), step)
