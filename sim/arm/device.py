"""The arm as one robot: ports below, verbs above, the control law between.

Each control period: read the joints and the wrist sensor, walk the attractor on its leash, compute the
torques.
"""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason, SetpointKind, Verb
from robotree.sim.arm.compliance import NaturalAdmittance, pointing_down
from robotree.sim.arm.gripper import Grip, Gripper
from robotree.sim.arm.kinematics import Kinematics, twist_of
from robotree.sim.arm.model import ArmPorts
from robotree.sim.arm.planner import TWIST, Planner
from robotree.sim.arm.tuning import PARAMETERS, SLOWEST, ArmTuning
from robotree.sim.arm.wrist import WristSensor
from robotree.sim.firmware.device import (
    WIDEST,
    Plan,
    Progress,
    Start,
    Tunable,
    ended,
    or_now,
    planned,
    pursuing,
    require,
)
from robotree.sim.firmware.previews import POINTS, WayAhead
from robotree.sim.motion.follower import Follower
from robotree.sim.motion.path import Path
from robotree.sim.motion.pursuit import Group, Pursuit
from robotree.sim.physics.vectors import Vector

REACHED: Final = 0.004
"""[m] between tool and goal that counts as reached; friction leaves 1 mm, 3 mm at worst."""
YIELDING: Final = 0.025
"""[m] that the tool may be short of a goal, and the goal still count as reached, while the world pulls at it:
a compliant arm yields 20 mm to 10 N, and a lever or a spring at the end of a move is no failure."""
SETTLED: Final = 0.01
"""[rad/s] of the fastest joint that counts as standing."""
STILL_FOR: Final = 0.1
"""[s] of standing that ends a move."""
SETTLE_WITHIN: Final = 3.0
"""[s] after the end of a path by which the tool must be there, or something holds it."""
BRAKING: Final = 5.0
"""times the damping of the usual law while the tool is brought to a stand."""
BRAKED_WITHIN: Final = 0.3
"""[s] after which a tool that was told to hold and has not come to a stand keeps the place it was told at."""
AXES: Final = ("x", "y", "z", "twist")
"""Of a tool that points down."""


@dataclass(frozen=True, slots=True)
class ArmState:
    """One reading of the arm.

    Attributes:
        q: (6,) joint angles [rad].
        position: (3,) of the tool in W [m].
        rotation: (3, 3) R_WT.
        wrench: (6,) of the world on the tool, at the tool, axes of W, as the wrist feels it [N, N m].
        width: between the fingers [m].
        width_commanded: asked for [m].
        grip: what the fingers are doing.
        grip_force: of each finger [N].
        peak_force: largest net force since the start that the world put on the hand [N]: the true sum over
        all
            contacts of palm and fingers (and pushes that a test applies to them), taken from the physics at
            every step, not from the sensor; what one finger exerts against the other cancels.
    """

    q: Vector
    position: Vector
    rotation: Vector
    wrench: Vector
    width: float
    width_commanded: float
    grip: Grip
    grip_force: float
    peak_force: float

    @property
    def twist(self) -> float:
        """Of the tool about the vertical [rad]."""
        return twist_of(self.rotation)


class Arm:
    """The arm in its cell.

    Args:
        ports: of the arm in the cell; its joints stand where the arm is switched on.
    """

    def __init__(self, ports: ArmPorts) -> None:
        self._ports = ports
        self.tuning = ArmTuning()
        """The values of `parameters`; they are read in every control period."""
        self._kinematics = Kinematics()
        self._planner = Planner(Kinematics())
        self._law = NaturalAdmittance()
        self._sensor = WristSensor(ports.hand_mass, ports.hand_centre)
        self._gripper = Gripper(2.0 * float(ports.finger[0]))
        self._position, self._rotation = self._kinematics.pose(ports.q)
        self._follower = Follower(self._here())
        self._wrench: Vector = np.zeros(6)
        self._error: Vector = np.zeros(3)
        self._velocity: Vector = np.zeros(len(AXES))
        self._braking: Vector | None = None
        """The velocity at which it was told to hold, while it brakes."""
        self._load = self._waited = self._still = self._peak = self._brake_left = 0.0
        self._running: Callable[[], Progress] = ended
        self._pursuit: Pursuit | None = None
        self._plans: Mapping[Verb, Plan] = {
            Verb.GO_TO: self._go_to,
            Verb.GRIP: self._grip,
            Verb.HOLD: lambda _: self.hold,
        }

    @property
    def verbs(self) -> Collection[Verb]:
        """The verbs that it carries out."""
        return self._plans.keys()

    @property
    def setpoint_kinds(self) -> Collection[SetpointKind]:
        """The set-points that it can follow."""
        return (SetpointKind.TOOL_POSE, SetpointKind.TOOL_VELOCITY)

    @property
    def parameters(self) -> Collection[Tunable]:
        """The parameters that can be tuned."""
        return PARAMETERS

    def prepare(self, verb: int, args: tuple[float, ...]) -> Start:
        """Check and plan one movement; nothing moves yet.

        Args:
            verb: GO_TO, GRIP or HOLD.
            args: (7,) as in robotree.xml.

        Returns:
            What begins the movement, in place of whatever runs.

        Raises:
            GoalRefused: with the reason; nothing has changed.
        """
        return planned(self._plans, verb, args)

    def follow(self, kind: int, args: tuple[float, ...]) -> Start:
        """Check one set-point; nothing changes yet.

        Args:
            kind: TOOL_POSE or TOOL_VELOCITY.
            args: (7,) as in robotree.xml.

        Returns:
            What follows it, within the limits of speed and place.

        Raises:
            GoalRefused: no posture brings the tool there, or a number is infinite.
        """
        if kind == SetpointKind.TOOL_POSE:
            here = self._follower.reference.pose.tolist()
            target = np.array([or_now(*each) for each in zip(AXES, args, here, strict=False)])
            target[3] = here[3] + math.remainder(target[3] - here[3], math.tau)
            self._planner.check(target, np.array(self._ports.q))
            return lambda: self._pursue().toward(target)
        now = [0.0] * len(AXES) if self._pursuit is None else self._pursuit.rate.tolist()
        rate = np.array([or_now(*each) for each in zip(AXES, args, now, strict=False)])
        return lambda: self._pursue().along(rate)

    def progress(self) -> Progress:
        """How far the movement is that was begun last."""
        return self._running()

    def hold(self) -> None:
        """Drop the movement, brake, and rest where the tool then stands; the fingers keep what they hold."""
        self._braking, self._brake_left = np.array(self._velocity), BRAKED_WITHIN
        self._law.braking = BRAKING
        self._follower.rest(self._here())
        self._gripper.halt(2.0 * float(self._ports.finger[0]))
        self._running, self._pursuit = ended, None

    def control(self, dt: float) -> None:
        """One period [s] of the control law."""
        ports, tuning = self._ports, self.tuning
        self._law.tune(tuning.stiffness, tuning.force_limit, dt)
        self._gripper.speed = tuning.grip_speed
        ports.finger_limit[:] = -2.0 * tuning.grip_force, 2.0 * tuning.grip_force
        dynamics = self._kinematics.dynamics(ports.q, ports.v)
        self._wrench = self._sensor.update(ports.wrist_force, ports.wrist_torque, dynamics.rotation)
        twist = dynamics.jacobian @ ports.v
        self._velocity[:3], self._velocity[3] = twist[:3], twist[5]
        if self._braking is not None:
            self._brake(self._braking, dt)
        setpoint = self._follower.advance(dt, self._load)
        effort = self._law.effort(dynamics, ports.q, ports.v, pointing_down(setpoint), self._wrench, dt)
        ports.torque[:] = effort.torque
        self._load, self._error = effort.load, effort.error
        self._waited = 0.0 if self._follower.moving else self._waited + dt
        speeds: list[float] = ports.v.tolist()
        at_rest = self._waited > 0.0 and max(*speeds, -min(speeds)) < SETTLED
        self._still = self._still + dt if at_rest else 0.0
        self._position[:], self._rotation[:] = dynamics.position, dynamics.rotation
        width, speed = 2.0 * float(ports.finger[0]), 2.0 * float(ports.finger_speed[0])
        ports.finger_target[0] = 0.5 * self._gripper.advance(dt, width, speed)
        self._peak = max(self._peak, math.hypot(*np.add.reduce(ports.contact).tolist()))

    def state(self) -> ArmState:
        """One reading, not changed by later steps."""
        ports = self._ports
        return ArmState(
            q=np.array(ports.q),
            position=np.array(self._position),
            rotation=np.array(self._rotation),
            wrench=np.array(self._wrench),
            width=2.0 * float(ports.finger[0]),
            width_commanded=self._gripper.commanded,
            grip=self._gripper.state,
            grip_force=0.5 * abs(float(ports.finger_force[0])),
            peak_force=self._peak,
        )

    def _brake(self, began: Vector, dt: float) -> None:
        """Once the tool has come to a stand, rest there: the spring, stretched by then, would pull it back.

        Args:
            began: (4,) velocity at which it was told to hold; cleared for the axes that stand.
            dt: control period [s].
        """
        self._brake_left -= dt
        rest, here = np.array(self._follower.reference.pose), self._here()
        for axes in (slice(0, 3), slice(3, 4)):
            if began[axes].any() and float(self._velocity[axes] @ began[axes]) <= 0.0:
                rest[axes], began[axes] = here[axes], 0.0
                self._follower.rest(rest)
                self._law.begin(self._ports.v)
        if self._brake_left <= 0.0 or not began.any():
            self._go_free()

    def _go_free(self) -> None:
        """Brake no more."""
        self._braking, self._law.braking = None, 1.0

    def _here(self) -> Vector:
        return np.array((*self._position, twist_of(self._rotation)))

    def way(self, verb: int, args: tuple[float, ...]) -> WayAhead:
        """The way of the tool to the end of a GO_TO; none for other verbs.

        Args:
            verb: as for `prepare`.
            args: as for `prepare`.

        Raises:
            GoalRefused: as `prepare`.
        """
        if verb != Verb.GO_TO:
            return WayAhead()
        path = self._path_to(args)
        ticks = [path.duration * tick / (POINTS - 1) for tick in range(POINTS)]
        points = [path.at(tick).pose.tolist() for tick in ticks]
        return WayAhead([(x, y, z) for x, y, z, _ in points], path.duration)

    def _path_to(self, args: tuple[float, ...]) -> Path:
        start = self._follower.reference
        goal = np.array([or_now(*each) for each in zip(AXES, args, start.pose.tolist(), strict=False)])
        tuning = self.tuning
        speed = or_now("speed", args[4], min(tuning.speed, tuning.top_speed))
        require("speed", speed, SLOWEST, tuning.top_speed, "m/s")
        return self._planner.plan(start, np.array(self._ports.q), goal, speed, tuning.acceleration)

    def _go_to(self, args: tuple[float, ...]) -> Start:
        path = self._path_to(args)

        def begin() -> None:
            self._follower.follow(path)
            self._running, self._pursuit = self._travelling, None
            self._go_free()

        return begin

    def _grip(self, args: tuple[float, ...]) -> Start:
        width = or_now("width", args[0], 2.0 * float(self._ports.finger[0]))
        require("width", width, 0.0, WIDEST, "m")

        def begin() -> None:
            self.hold()
            self._gripper.move(width)
            self._running = self._gripping

        return begin

    def _pursue(self) -> Pursuit:
        """The pursuit that runs, else a new one from where the attractor is."""
        tuning = self.tuning
        groups = (
            Group(slice(0, 3), tuning.top_speed, tuning.acceleration),
            Group(slice(3, 4), TWIST[0], TWIST[1]),
        )
        if self._pursuit is None:
            self._pursuit = Pursuit(self._follower.reference, groups, self._stands)
            self._follower.chase(self._pursuit)
            self._go_free()
            self._running = pursuing
        self._pursuit.limit(groups)
        return self._pursuit

    def _stands(self, pose: Vector) -> bool:
        return self._planner.stands(pose, np.array(self._ports.q))

    def _travelling(self) -> Progress:
        fraction = self._follower.progress
        if self._follower.blocked:
            return self._blocked(fraction)
        if self._follower.moving:
            return Progress(fraction)
        if self._still >= STILL_FOR:
            # At rest spring and world balance: what the world's pull does not explain is friction's share.
            short = float(np.linalg.norm(self._error))
            unexplained = float(np.linalg.norm(self._error + self._wrench[:3] / self._law.stiffness))
            if unexplained < REACHED and short < YIELDING:
                return Progress(1.0, done=True, text=self._held_up() if short > REACHED else "")
        if self._waited > SETTLE_WITHIN:
            return self._blocked(fraction)
        return Progress(min(fraction, 0.99))

    def _gripping(self) -> Progress:
        moving = self._gripper.state is Grip.MOVING
        return Progress(0.5 if moving else 1.0, done=not moving)

    def _blocked(self, fraction: float) -> Progress:
        """The end of a goal that something in the way keeps the tool from."""
        text = f"{self._held_up()}; go up, or see what it touches"
        return Progress(fraction, done=True, reason=Reason.BLOCKED, text=text)

    def _held_up(self) -> str:
        force = float(np.linalg.norm(self._wrench[:3]))
        short = 1e3 * float(np.linalg.norm(self._error))
        return f"Something holds the tool with {force:.0f} N, {short:.0f} mm short"
