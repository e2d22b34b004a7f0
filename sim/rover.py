"""The rover as one robot: a jerk-limited set-point, a servo on its drive, and the verb MOVE."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason, Verb
from robotree.sim.device import ENDED, Progress, Start
from robotree.sim.errors import BadArgument, OutOfReach, UnknownVerb
from robotree.sim.limits import require
from robotree.sim.models.rover import RoverPorts
from robotree.sim.models.scenery import ARENA
from robotree.sim.motion import Follower, Limits, Line
from robotree.sim.vectors import Vector

STIFFNESS: Final = 800.0
"""[N/m] of the drive servo; 1 N of friction leaves 1.3 mm."""
DAMPING: Final = 110.0
"""[N s/m]; 0.95 of critical for 4.2 kg."""
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
JERK: Final = 8.0
"""[m/s3]"""
REACHED: Final = 0.004
"""[m] from the goal, along each axis together."""
SETTLED: Final = 0.005
"""[m/s] that counts as standing."""
SETTLE_WITHIN: Final = 3.0
"""[s] after the end of a path by which the rover must be there, or something holds it."""


@dataclass(frozen=True, slots=True)
class RoverState:
    """One reading: `position` (2,) [m] and `velocity` (2,) [m/s], x and y in W."""

    position: Vector
    velocity: Vector


class Rover:
    """The rover in its cell.

    Args:
        ports: of the rover in the cell.
    """

    def __init__(self, ports: RoverPorts) -> None:
        self._ports = ports
        self._follower = Follower(ports.position)
        self._load = self._waited = 0.0
        self._running: Callable[[], Progress] = _ended
        self._verbs: Mapping[Verb, Callable[[tuple[float, ...]], Start]] = {
            Verb.MOVE: self._move,
            Verb.HOLD: self._stay,
        }

    @property
    def verbs(self) -> Collection[Verb]:
        """What it can be asked to do."""
        return self._verbs.keys()

    def prepare(self, verb: int, args: tuple[float, ...]) -> Start:
        """Check and plan one movement; nothing moves yet.

        Args:
            verb: MOVE or HOLD.
            args: (7,) as in robotree.xml.

        Returns:
            What begins the movement, in place of whatever runs.

        Raises:
            GoalRefused: with the reason; nothing has changed.
        """
        if verb not in self._verbs:
            raise UnknownVerb(verb, [known.name for known in self._verbs])
        return self._verbs[Verb(verb)](args)

    def progress(self) -> Progress:
        """How far the movement is that was begun last."""
        return self._running()

    def hold(self) -> None:
        """Drop the movement and rest here."""
        self._follower.rest(self._ports.position)
        self._running = _ended

    def control(self, dt: float) -> None:
        """One period [s] of the drive servo: spring, bounded, and damper on the set-point's velocity."""
        ports = self._ports
        setpoint = self._follower.advance(dt, self._load)
        self._waited = 0.0 if self._follower.moving else self._waited + dt
        pull = STIFFNESS * (setpoint.pose - ports.position)
        self._load = math.hypot(pull[0], pull[1]) / FORCE_LIMIT
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
        speed = SPEED if math.isnan(args[2]) else args[2]
        require("speed", speed, SLOWEST, TOP_SPEED, "m/s")
        start = self._follower.setpoint
        # From a set-point at rest, so that the errors of many moves do not add up.
        origin = self._ports.position if self._follower.moving else start.pose
        goal = origin + np.array(args[:2])
        if float(np.abs(goal).max()) > ARENA:
            raise OutOfReach(goal.tolist(), f"the floor ends {ARENA} m from its middle")
        limits = Limits((speed, speed), (ACCELERATION,) * 2, (JERK,) * 2)
        path = Line(start, goal, limits)

        def begin() -> None:
            self._follower.follow(path)
            self._running = self._travelling

        return begin

    def _stay(self, _: tuple[float, ...]) -> Start:
        return self.hold

    def _travelling(self) -> Progress:
        fraction = self._follower.progress
        short = float(np.linalg.norm(self._follower.setpoint.pose - self._ports.position))
        if self._follower.blocked or self._waited > SETTLE_WITHIN:
            return Progress(fraction, done=True, reason=Reason.BLOCKED, text="Something stands in the way.")
        standing = float(np.abs(self._ports.velocity).max()) < SETTLED
        if self._follower.moving:
            return Progress(fraction)
        if short < REACHED and standing:
            return Progress(1.0, done=True)
        return Progress(min(fraction, 0.99))


def _ended() -> Progress:
    return ENDED
