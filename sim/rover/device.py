"""The rover as one robot: a jerk-limited set-point, a servo on its drive, and the verb MOVE."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason, SetpointKind, Verb
from robotree.sim.errors import BadArgument, OutOfReach
from robotree.sim.firmware.device import (
    Device,
    Plan,
    Progress,
    Start,
    Tunable,
    WayAhead,
    ended,
    or_now,
    pursuing,
    speed_or,
    way_along,
)
from robotree.sim.motion.follower import Follower, Group, Pursuit
from robotree.sim.motion.path import Limits, Line
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

XML: Final = Path(__file__).with_name("rover.xml")
PREFIX: Final = "rover/"


def spec() -> mujoco.MjSpec:
    """Read the rover's description."""
    return mujoco.MjSpec.from_file(str(XML))


@dataclass(frozen=True, slots=True)
class RoverPorts:
    """Views into the live data of a cell.

    Attributes:
        position: (2,) x, y in W [m].
        velocity: (2,) along x, y of W [m/s].
        force: (2,) drive force asked for, along x, y of W [N].
    """

    position: Vector
    velocity: Vector
    force: Vector


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> RoverPorts:
    """Find the rover's ports."""
    x = model.joint(prefix + "x")
    q, v = int(x.qposadr[0]), int(x.dofadr[0])
    u = int(model.actuator_ctrladr[model.actuator(prefix + "x").id])
    return RoverPorts(
        position=data.qpos[q : q + 2], velocity=data.qvel[v : v + 2], force=data.ctrl[u : u + 2]
    )


ARENA: Final = 1.5
"""[m] the rover's centre may go this far from the origin along x and y."""
FORCE_LIMIT: Final = 30.0
"""[N] of the drive."""
SPEED: Final = 0.4
"""[m/s] of a goal that names no speed."""
SLOWEST: Final = 0.01
"""[m/s] that a goal may ask for."""
TOP_SPEED: Final = 1.0
"""[m/s] that a goal may ask for."""
ACCELERATION: Final = 1.0
"""[m/s2]"""
STIFFNESS: Final = 800.0
"""[N/m] of the drive servo; 1 N of friction leaves 1.3 mm."""
DAMPING: Final = 110.0
"""[N s/m]; 0.95 of critical for 4.2 kg."""
JERK: Final = 8.0
"""[m/s3]"""
REACHED: Final = 0.004
"""[m] from the goal, along each axis together."""
SETTLED: Final = 0.005
"""[m/s] that counts as standing."""
SETTLE_WITHIN: Final = 3.0
"""[s] after the end of a path by which the rover must be there, or something holds it."""


@dataclass(slots=True)
class RoverTuning:
    """The values that can be tuned on the rover while it runs; see `PARAMETERS`."""

    speed: float = SPEED
    top_speed: float = TOP_SPEED
    acceleration: float = ACCELERATION
    force_limit: float = FORCE_LIMIT


PARAMETERS: Final = (
    Tunable("BASE_SPEED", "speed", SLOWEST, TOP_SPEED, "m/s, of a goal that names no speed"),
    Tunable("BASE_SPEED_MAX", "top_speed", SLOWEST, TOP_SPEED, "m/s, that a goal or set-point may ask for"),
    Tunable("BASE_ACCEL", "acceleration", 0.1, ACCELERATION, "m/s2, of the next movement"),
    Tunable("DRIVE_FORCE_MAX", "force_limit", 5.0, FORCE_LIMIT, "N, of the drive at most"),
)
"""The parameters that people can tune."""


@dataclass(frozen=True, slots=True)
class RoverState:
    """One reading: `position` (2,) [m] and `velocity` (2,) [m/s], x and y in W."""

    position: Vector
    velocity: Vector


class Rover(Device):
    """The rover in its cell.

    Args:
        ports: of the rover in the cell.
    """

    setpoint_kinds = (SetpointKind.BASE_VELOCITY,)

    def __init__(self, ports: RoverPorts) -> None:
        self._ports = ports
        self.tuning = RoverTuning()
        """The values of `parameters`; they are read in every control period."""
        self._pursuit: Pursuit | None = None
        self._follower = Follower(ports.position)
        self._load = self._waited = 0.0
        plans: Mapping[Verb, Plan] = {
            Verb.MOVE: self._move,
            Verb.GO_TO: self._go_to,
            Verb.HOLD: lambda _: self.hold,
        }
        super().__init__(self.tuning, PARAMETERS, plans)

    def follow(self, kind: int, args: tuple[float, ...]) -> Start:  # noqa: ARG002  there is one kind
        """Check one set-point; nothing changes yet.

        Args:
            kind: BASE_VELOCITY.
            args: (7,) as in robotree.xml; the turn rate must be 0 or NaN, this base does not turn.

        Returns:
            What follows it, within the limits of speed and of the floor.

        Raises:
            BadArgument: it should turn, or a number is infinite.
        """
        if args[2] and not math.isnan(args[2]):
            raise BadArgument("turn rate", args[2], "0: this base does not turn")
        now = [0.0, 0.0] if self._pursuit is None else self._pursuit.rate.tolist()
        rate = np.array([or_now(*each) for each in zip(("vx", "vy"), args, now, strict=False)])
        return lambda: self._pursue().along(rate)

    def hold(self) -> None:
        """Drop the movement and rest here."""
        self._follower.rest(self._ports.position)
        self._running, self._pursuit = ended, None

    def control(self, dt: float) -> None:
        """One period [s] of the drive servo: spring, bounded, and damper on the set-point's velocity."""
        ports = self._ports
        setpoint = self._follower.advance(dt, self._load)
        self._waited = 0.0 if self._follower.moving else self._waited + dt
        pull = STIFFNESS * (setpoint.pose - ports.position)
        self._load = math.hypot(pull[0], pull[1]) / self.tuning.force_limit
        if self._load > 1.0:
            pull /= self._load
        ports.force[:] = pull + DAMPING * (setpoint.velocity - ports.velocity)

    def state(self) -> RoverState:
        """One reading, not changed by later steps."""
        return RoverState(np.array(self._ports.position), np.array(self._ports.velocity))

    def _move(self, args: tuple[float, ...]) -> Start:
        for name, value in zip(("dx", "dy"), args, strict=False):
            if not math.isfinite(value):
                raise BadArgument(name, value, "a finite number of metres")
        # From a set-point at rest, so that the errors of many moves do not add up.
        origin = self._ports.position if self._follower.moving else self._follower.reference.pose
        return self._travel(self._path_to(origin + np.array(args[:2]), args[2]))

    def _go_to(self, args: tuple[float, ...]) -> Start:
        return self._travel(self._path_to(self._goal_of(args), args[4]))

    def _goal_of(self, args: tuple[float, ...]) -> Vector:
        """(2,) the place that a GO_TO means [m]; its height and twist are those of the floor and the base."""
        here = self._follower.reference.pose.tolist()
        return np.array([or_now(*each) for each in zip(("x", "y"), args, here, strict=False)])

    def way(self, verb: int, args: tuple[float, ...]) -> WayAhead:
        """The way of the base to the end of a GO_TO or a MOVE; none for other verbs.

        Args:
            verb: as for `prepare`.
            args: as for `prepare`.

        Raises:
            GoalRefused: as `prepare`.
        """
        if verb == Verb.GO_TO:
            path = self._path_to(self._goal_of(args), args[4])
        elif verb == Verb.MOVE:
            path = self._path_to(self._ports.position + np.array(args[:2]), args[2])
        else:
            return WayAhead()
        return way_along(path, lambda pose: (pose[0], pose[1], 0.0))

    def _path_to(self, goal: Vector, speed: float) -> Line:
        """The way to a place (2,) [m] at a speed [m/s], NaN: the usual one.

        Raises:
            BadArgument: too slow or too fast.
            OutOfReach: it lies outside the arena.
        """
        tuning = self.tuning
        speed = speed_or(speed, tuning.speed, SLOWEST, tuning.top_speed)
        if float(np.abs(goal).max()) > ARENA:
            raise OutOfReach(goal.tolist(), f"the floor ends {ARENA} m from its middle")
        limits = Limits((speed, speed), (tuning.acceleration,) * 2, (JERK,) * 2, place=2)
        return Line(self._follower.reference, goal, limits)

    def _travel(self, path: Line) -> Start:
        def begin() -> None:
            self._follower.follow(path)
            self._running, self._pursuit = self._travelling, None

        return begin

    def _pursue(self) -> Pursuit:
        """The pursuit that runs, else a new one from where the set-point is."""
        groups = (Group(slice(0, 2), self.tuning.top_speed, self.tuning.acceleration),)
        if self._pursuit is None:
            self._pursuit = Pursuit(self._follower.reference, groups, _on_the_floor)
            self._follower.chase(self._pursuit)
            self._running = pursuing
        self._pursuit.limit(groups)
        return self._pursuit

    def _travelling(self) -> Progress:
        fraction = self._follower.progress
        short = float(np.linalg.norm(self._follower.reference.pose - self._ports.position))
        if self._follower.blocked or self._waited > SETTLE_WITHIN:
            return Progress(fraction, done=True, reason=Reason.BLOCKED, text="Something stands in the way.")
        standing = float(np.abs(self._ports.velocity).max()) < SETTLED
        if self._follower.moving:
            return Progress(fraction)
        if short < REACHED and standing:
            return Progress(1.0, done=True)
        return Progress(min(fraction, 0.99))


def _on_the_floor(place: Vector) -> bool:
    return float(np.abs(place).max()) <= ARENA
