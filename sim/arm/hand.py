"""The hand at the end of any arm: gripper, wrist sensor, how it is driven, and when it has arrived.

The cell's arm and both arms of the companion hang their hands on the same law, wrist sensor and gripper.
The gripper is led to a width. The sensor feels what the arm exerts on the hand; the hand's weight is taken
off, its (small) inertia is not. Measured against a push of known size: 10 N read as 10.00 N.

Pure: readings, widths and seconds in, set-points, the world's wrench on the hand and a state out.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason
from robotree.sim.arm.compliance import Attractor, NaturalAdmittance
from robotree.sim.arm.kinematics import Dynamics, twist_of
from robotree.sim.arm.model import HandPorts
from robotree.sim.firmware.device import WIDEST, Progress, or_now, require
from robotree.sim.motion.follower import Follower
from robotree.sim.physics.vectors import Matrix, Vector

SPEED: Final = 0.12
"""[m/s] of the gap, unless it is tuned."""
AT_WIDTH: Final = 0.001
"""[m] that counts as being at the width asked for."""
STILL: Final = 0.002
"""[m/s] of the gap below which the fingers stand."""
HELD_AFTER: Final = 0.2
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
        elif self._still >= HELD_AFTER and self.state is not Grip.HOLDING:
            self.state, self._held = Grip.HOLDING, width
        elif self.state is Grip.AT_WIDTH or abs(width - self._held) >= YIELDS:
            self.state = Grip.MOVING
        return self._led


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
