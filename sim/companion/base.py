"""The base and the waist as a device: drive, turn, lean; a servo on ideal omnidirectional wheels below.

The base stands freely on its wheels: what its drive and its arms do can tip it over, and the guard sees to it
that they do not. It keeps its distance from people, slows down beside them, and waits for who stands in its
way.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, Protocol

import numpy as np

from robotree.protocol.messages import Reason, Verb
from robotree.sim.companion.guard import Objection, Person
from robotree.sim.companion.planner import Forbidden
from robotree.sim.companion.routes import Blocked, Floor, Point
from robotree.sim.companion.tuning import (
    BASE_PARAMETERS,
    LEAN_RATE,
    SLOWEST,
    TURN_RATE,
    BaseTuning,
)
from robotree.sim.errors import BadArgument
from robotree.sim.firmware.device import Device, Plan, Progress, Start, ended, or_now, require, speed_or
from robotree.sim.motion.follower import LEASH_SLACK, Follower
from robotree.sim.motion.path import Limits, Line
from robotree.sim.physics.vectors import Vector

STIFFNESS: Final = np.array((2500.0, 2500.0, 260.0))
"""[N/m, N/m, N m/rad] of the drive servo."""
DAMPING: Final = np.array((560.0, 560.0, 40.0))
"""[N s/m, N s/m, N m s/rad]; 0.8 of critical for 49 kg."""
FORCE_LIMIT: Final = 80.0
"""[N] of the drive; below what ISO/TS 15066, table A.2, allows against a thigh (150 N)."""
TORQUE_LIMIT: Final = 30.0
"""[N m] of the drive about the vertical."""
JERK: Final = 3.0
"""[m/s3]"""
TURN_ACCELERATION, TURN_JERK = 1.5, 8.0
LEAN_ACCELERATION, LEAN_JERK = 0.8, 5.0
LEAN_STIFFNESS, LEAN_DAMPING = 900.0, 130.0
"""[N m/rad, N m s/rad] of the waist's servo."""
REACHED: Final = (0.01, 0.01)
"""[m, rad]"""
LEAN_REACHED: Final = 0.03
"""[rad]"""
SETTLED: Final = 0.01
"""[m/s] that counts as standing."""
SETTLE_WITHIN: Final = 3.0
"""[s] after the end of a way by which the base must be there, or something holds it."""
WAITS_FOR: Final = 8.0
"""[s] that the base waits for a person in its way."""


class Thinking(Protocol):
    """The interface of the whole body that the base uses."""

    def people(self) -> Sequence[Person]:
        """The people and their places."""
        ...

    def tipping(self, lean: float | None) -> Objection | None:
        """Why a drive, or a lean [rad], would tip the base over or bend the body into something."""
        ...

    def must_have_power(self) -> None:
        """Refuse to move with an empty battery."""
        ...

    def base_pace(self) -> float:
        """Share of the full pace that people allow now, 0 to 1."""
        ...


@dataclass(frozen=True, slots=True)
class BaseLook:
    """One reading of the base.

    Attributes:
        place: (3,) x, y [m] and heading [rad] in W.
        rate: (3,) their rates.
        lean: of the waist [rad].
        led: (3,) where it is led.
    """

    place: Vector
    rate: Vector
    lean: float
    led: Vector


class Base(Device):
    """The base in the body.

    Args:
        place: (3,) x, y [m] and heading [rad] when it is switched on.
        lean: of the waist [rad].
        lean_range: least and greatest [rad].
        body: knows people and balance.
    """

    def __init__(self, place: Vector, lean: float, lean_range: tuple[float, float], body: Thinking) -> None:
        self.tuning = BaseTuning()
        self._body, self._lean_range = body, lean_range
        self._follower, self._waist = Follower(place), Follower(np.array((lean,)))
        self._place, self._rate, self._lean = np.array(place), np.zeros(3), lean
        self._load = self._waited = self._halted = 0.0
        self._legs: list[Line] = []
        self._driven = self._length = 0.0
        plans: Mapping[Verb, Plan] = {
            Verb.MOVE: self._move,
            Verb.TURN: self._turn,
            Verb.DRIVE: self._drive,
            Verb.LEAN: self._lean_to,
            Verb.HOLD: lambda _: self.hold,
        }
        super().__init__(self.tuning, BASE_PARAMETERS, plans)

    def hold(self) -> None:
        """Drop the movement and come to a stand here."""
        self._follower.rest(self._place)
        self._waist.rest(np.array((self._lean,)))
        self._legs, self._running = [], ended

    # -- for the body

    @property
    def moving(self) -> bool:
        """Whether it drives or turns."""
        return self._follower.moving

    @property
    def led_lean(self) -> float:
        """To which the waist is led [rad]."""
        return float(self._waist.reference.pose[0])

    @property
    def direction(self) -> tuple[float, float]:
        """Of the way that it is on, as a unit vector in W; (0, 0) while it only turns."""
        if not self._legs:
            return 0.0, 0.0
        way = self._legs[0].goal[:2] - self._place[:2]
        length = math.hypot(way[0], way[1])
        return (float(way[0]) / length, float(way[1]) / length) if length > 1e-3 else (0.0, 0.0)

    def control(
        self, dt: float, place: Vector, rate: Vector, lean: float, lean_rate: float
    ) -> tuple[Vector, float]:
        """Forces along x, y of W [N] and torque [N m] of the drive, and torque of the waist [N m].

        Args:
            dt: [s]
            place: (3,) x, y [m] and heading [rad] now; the heading may have gone round.
            rate: (3,) their rates.
            lean: of the waist [rad].
            lean_rate: [rad/s]
        """
        self._place, self._rate, self._lean = place, rate, lean
        pace = self._body.base_pace() if self._follower.moving else 1.0
        self._halted = self._halted + dt if pace < 0.05 else 0.0
        setpoint = self._follower.advance(dt, max(self._load, 1.0 - (1.0 - LEASH_SLACK) * pace))
        if not self._follower.moving and self._legs:
            self._driven += self._legs.pop(0).duration
            if self._legs:
                self._follower.follow(self._legs[0])
        self._waited = 0.0 if self._follower.moving or self._waist.moving else self._waited + dt
        pull = STIFFNESS * (setpoint.pose - place)
        self._load = max(math.hypot(pull[0], pull[1]) / FORCE_LIMIT, abs(pull[2]) / TORQUE_LIMIT)
        if self._load > 1.0:
            pull /= self._load
        waist = self._waist.advance(dt, 0.0)
        torque = LEAN_STIFFNESS * (float(waist.pose[0]) - lean) + LEAN_DAMPING * (
            float(waist.velocity[0]) - lean_rate
        )
        return pull + DAMPING * (setpoint.velocity - rate), torque

    def look(self) -> BaseLook:
        """One reading, not changed by later steps."""
        return BaseLook(
            np.array(self._place), np.array(self._rate), self._lean, np.array(self._follower.reference.pose)
        )

    # -- the verbs

    def _origin(self) -> Vector:
        led = self._follower.reference.pose
        return np.array(self._place if self._follower.moving else led)

    def _move(self, args: tuple[float, ...]) -> Start:
        for name, value in zip(("dx", "dy"), args, strict=False):
            if not math.isfinite(value):
                raise BadArgument(name, value, "a finite number of metres")
        origin = self._origin()
        goal = origin + np.array((args[0], args[1], 0.0))
        if (blocked := self._floor().on_the_line(_point(origin), _point(goal))) is not None:
            raise self._blocked(blocked)
        return self._beginning([goal], self._speed(args[2]))

    def _turn(self, args: tuple[float, ...]) -> Start:
        origin = self._origin()
        heading = or_now("heading", args[0], float(origin[2]))
        rate = or_now("rate", args[1], TURN_RATE)
        require("rate", rate, 0.05, TURN_RATE, "rad/s")
        goal = np.array((origin[0], origin[1], origin[2] + math.remainder(heading - origin[2], math.tau)))
        return self._beginning([goal], self._speed(math.nan), rate)

    def _drive(self, args: tuple[float, ...]) -> Start:
        origin = self._origin()
        x, y, heading = (
            or_now(*each) for each in zip(("x", "y", "heading"), args, origin.tolist(), strict=False)
        )
        turned = float(origin[2]) + math.remainder(heading - float(origin[2]), math.tau)
        route = self._floor().route(_point(origin), (x, y))
        if isinstance(route, Blocked):
            raise self._blocked(route)
        goals = [np.array((*corner, turned)) for corner in route]
        if len(goals) > 1:  # it looks where it drives, and turns on the last leg
            points = [_point(origin), *route]
            angle = float(origin[2])
            for i, (a, b) in enumerate(pairwise(points[:-1])):
                ahead = math.atan2(b[1] - a[1], b[0] - a[0])
                angle += math.remainder(ahead - angle, math.tau)
                goals[i][2] = angle
            goals[-1][2] = angle + math.remainder(heading - angle, math.tau)
        return self._beginning(goals, self._speed(args[3]))

    def _lean_to(self, args: tuple[float, ...]) -> Start:
        self._body.must_have_power()
        angle = or_now("angle", args[0], self.led_lean)
        require("angle", angle, *self._lean_range, "rad")
        rate = or_now("rate", args[1], LEAN_RATE)
        require("rate", rate, 0.05, LEAN_RATE, "rad/s")
        if (objection := self._body.tipping(angle)) is not None:
            raise Forbidden(objection)
        limits = Limits((rate,), (LEAN_ACCELERATION,), (LEAN_JERK,))
        path = Line(self._waist.reference, np.array((angle,)), limits)

        def begin() -> None:
            self._stand()
            self._waist.follow(path)
            self._running = self._leaning

        return begin

    def _speed(self, asked: float) -> float:
        self._body.must_have_power()
        tuning = self.tuning
        return speed_or(asked, tuning.speed, SLOWEST, tuning.top_speed)

    def _floor(self) -> Floor:
        if (objection := self._body.tipping(None)) is not None:
            raise Forbidden(objection)
        return Floor(self._body.people(), self.tuning.distance)

    def _blocked(self, blocked: Blocked) -> Forbidden:
        if blocked.person:
            text = f"{blocked.what} would be nearer than {self.tuning.distance:g} m; wait or go elsewhere"
            return Forbidden(Objection(Reason.TOO_NEAR, text))
        return Forbidden(Objection(Reason.PATH_BLOCKED, f"{blocked.what} is in the way of the base"))

    def _beginning(self, goals: Sequence[Vector], speed: float, rate: float = TURN_RATE) -> Start:
        acceleration = self.tuning.acceleration
        limits = Limits(
            (speed, speed, rate),
            (acceleration, acceleration, TURN_ACCELERATION),
            (JERK, JERK, TURN_JERK),
            place=2,
        )
        legs: list[Line] = []
        start = self._follower.reference
        for goal in goals:
            leg = Line(start, goal, limits)
            legs.append(leg)
            start = start._replace(pose=goal, velocity=np.zeros(3))

        def begin() -> None:
            self._waist.rest(self._waist.reference.pose)
            self._legs = list(legs)
            self._driven, self._length = 0.0, sum(leg.duration for leg in legs)
            self._follower.follow(legs[0])
            self._running = self._travelling

        return begin

    def _stand(self) -> None:
        """Drive no further."""
        if self._follower.moving:
            self._follower.rest(self._place)
        self._legs = []

    def _travelling(self) -> Progress:
        leg = self._legs[0].duration * self._follower.progress if self._legs else 0.0
        fraction = min((self._driven + leg) / max(self._length, 1e-6), 0.99)
        if self._halted > WAITS_FOR:
            text = f"A person stood in the way for {WAITS_FOR:g} s."
            return Progress(fraction, done=True, reason=Reason.TOO_NEAR, text=text)
        held = self._follower.blocked and not self._halted  # a person in the way is waited for
        if held or self._waited > SETTLE_WITHIN:
            return Progress(fraction, done=True, reason=Reason.BLOCKED, text="Something holds the base.")
        if self._follower.moving or self._legs:
            return Progress(fraction)
        short = self._follower.reference.pose - self._place
        near = math.hypot(short[0], short[1]) < REACHED[0] and abs(short[2]) < REACHED[1]
        standing = float(np.abs(self._rate).max()) < SETTLED
        return Progress(1.0, done=True) if near and standing else Progress(0.99)

    def _leaning(self) -> Progress:
        if self._waist.moving:
            return Progress(min(self._waist.progress, 0.99))
        if abs(self.led_lean - self._lean) < LEAN_REACHED:
            return Progress(1.0, done=True)
        if self._waited > SETTLE_WITHIN:
            return Progress(0.99, done=True, reason=Reason.BLOCKED, text="Something holds the waist.")
        return Progress(0.99)


def _point(place: Vector) -> Point:
    return float(place[0]), float(place[1])
