"""The hand at the end of any arm: its ports, how it is driven in each period, and when it has arrived.

The cell's arm and both arms of the companion hang their hands on the same law, wrist sensor and gripper.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason
from robotree.sim.arm.compliance import Attractor, NaturalAdmittance
from robotree.sim.arm.gripper import Grip, Gripper
from robotree.sim.arm.kinematics import Dynamics, twist_of
from robotree.sim.arm.model import HandPorts
from robotree.sim.arm.wrist import SMOOTHING, WristSensor
from robotree.sim.firmware.device import WIDEST, Progress, or_now, require
from robotree.sim.motion.follower import Follower
from robotree.sim.physics.vectors import Matrix, Vector

YIELDING: Final = 0.025
"""[m] that the hand may be short of a goal, and the goal still count as reached, while the world pulls at it:
a compliant arm yields 20 mm to 10 N, and a lever or a spring at the end of a move is no failure."""
STILL_FOR: Final = 0.1
"""[s] of standing that ends a move."""
SETTLE_WITHIN: Final = 3.0
"""[s] after the end of a path by which the hand must be there, or something holds it."""


@dataclass(frozen=True, slots=True)
class ArmState:
    """One reading of an arm.

    Attributes:
        q: (6,) joint angles [rad].
        position: (3,) of the tool [m], in W; for an arm of the companion in B.
        rotation: (3, 3) of the tool, likewise.
        wrench: (6,) of the world on the tool, at the tool, the same axes, as the wrist feels it [N, N m].
        width: between the fingers [m].
        width_commanded: asked for [m].
        grip: what the fingers are doing.
        grip_force: of each finger [N].
        peak_force: largest net force since the start that the world put on the hand [N]: the true sum over
            all contacts of palm and fingers (and pushes that a test applies to them), taken from the physics
            at every step, not from the sensor; what one finger exerts against the other cancels.
    """

    q: Vector
    position: Vector
    rotation: Matrix
    wrench: Vector
    width: float
    width_commanded: float
    grip: Grip
    grip_force: float
    peak_force: float

    @property
    def twist(self) -> float:
        """Of a tool that points down, about the vertical [rad]."""
        return twist_of(self.rotation)


class Hand:
    """A hand on its arm.

    Args:
        ports: of the hand and of the arm's motors.
        law: what moves the arm.
        reached: [m] between hand and goal that counts as reached.
        settled: [rad/s] of the fastest joint that counts as standing.
        smoothing: share of a new reading of the wrist in the filtered one.
    """

    def __init__(
        self,
        ports: HandPorts,
        law: NaturalAdmittance,
        *,
        reached: float,
        settled: float,
        smoothing: float = SMOOTHING,
    ) -> None:
        self._ports, self._law = ports, law
        self._reached, self._settled = reached, settled
        self._sensor = WristSensor(ports.mass, ports.centre, smoothing)
        self.gripper = Gripper(ports.width)
        self.load = 0.0
        """Share of the law's force that is used; above 1 the attractor waits."""
        self._wrench: Vector = np.zeros(6)
        self._error: Vector = np.zeros(3)
        self._waited = self._still = self._peak = 0.0

    def control(
        self,
        dt: float,
        dynamics: Dynamics,
        q: Vector,
        v: Vector,
        attractor: Attractor,
        *,
        moving: bool,
        grip_force: float,
    ) -> None:
        """One period of the control law.

        Args:
            dt: [s]
            dynamics: of the arm now.
            q: (6,) joints [rad].
            v: (6,) their velocities [rad/s].
            attractor: where the law pulls.
            moving: whether the attractor is on its way.
            grip_force: of each finger, at most [N].
        """
        ports = self._ports
        ports.finger_limit[:] = -2.0 * grip_force, 2.0 * grip_force
        self._wrench = self._sensor.update(ports.wrist_force, ports.wrist_torque, dynamics.rotation)
        effort = self._law.effort(dynamics, q, v, attractor, self._wrench, dt)
        ports.torque[:] = effort.torque
        self.load, self._error = effort.load, effort.error
        self._waited = 0.0 if moving else self._waited + dt
        speeds: list[float] = v.tolist()
        at_rest = self._waited > 0.0 and max(*speeds, -min(speeds)) < self._settled
        self._still = self._still + dt if at_rest else 0.0
        ports.finger_target[0] = 0.5 * self.gripper.advance(
            dt, ports.width, 2.0 * float(ports.finger_speed[0])
        )
        self._peak = max(self._peak, math.hypot(*np.add.reduce(ports.contact).tolist()))

    def state(self, q: Vector, position: Vector, rotation: Matrix) -> ArmState:
        """One reading, not changed by later steps."""
        return ArmState(
            q=np.array(q),
            position=np.array(position),
            rotation=np.array(rotation),
            wrench=np.array(self._wrench),
            width=self._ports.width,
            width_commanded=self.gripper.commanded,
            grip=self.gripper.state,
            grip_force=0.5 * abs(float(self._ports.finger_force[0])),
            peak_force=self._peak,
        )

    # -- goals

    def width_asked(self, args: tuple[float, ...]) -> float:
        """The gap that a GRIP asks for [m].

        Raises:
            BadArgument: fingers do not open so far.
        """
        width = or_now("width", args[0], self._ports.width)
        require("width", width, 0.0, WIDEST, "m")
        return width

    def halt_fingers(self) -> None:
        """Stop the fingers where they are; what they hold they keep."""
        self.gripper.halt(self._ports.width)

    def travelling(self, follower: Follower) -> Progress:
        """How far a move is along the way of a follower."""
        if follower.blocked:
            return self._blocked(follower.progress)
        if follower.moving:
            return Progress(follower.progress)
        short = float(np.linalg.norm(self._error))
        if self._still >= STILL_FOR:
            # At rest spring and world balance: what the world's pull does not explain is friction's share.
            unexplained = float(np.linalg.norm(self._error + self._wrench[:3] / self._law.stiffness))
            if unexplained < self._reached and short < YIELDING:
                return Progress(1.0, done=True, text=self._held_up() if short > self._reached else "")
        if self._waited > SETTLE_WITHIN:
            return self._blocked(follower.progress)
        return Progress(min(follower.progress, 0.99))

    def gripping(self) -> Progress:
        """How far the fingers are."""
        moving = self.gripper.state is Grip.MOVING
        return Progress(0.5 if moving else 1.0, done=not moving)

    def _blocked(self, fraction: float) -> Progress:
        """The end of a goal that something in the way keeps the hand from."""
        text = f"{self._held_up()}; go up, or see what it touches"
        return Progress(fraction, done=True, reason=Reason.BLOCKED, text=text)

    def _held_up(self) -> str:
        force = float(np.linalg.norm(self._wrench[:3]))
        short = 1e3 * float(np.linalg.norm(self._error))
        return f"Something holds the tool with {force:.0f} N, {short:.0f} mm short"
