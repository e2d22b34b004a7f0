"""The whole body: what its four devices have in common, and the one step of control for all of them.

It reads the joints once, computes the dynamics once, and leads base, waist, neck and arms together. What two
arms might do to each other in the coming moments is looked at while they move, and both wait before they
would touch. Control runs in every step of the flat, at 500 Hz.
"""

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason
from robotree.sim.companion.base import Base
from robotree.sim.companion.battery import Battery
from robotree.sim.companion.figure import ARMS, LEAN, NECK, Figure
from robotree.sim.companion.flat import BodyPorts
from robotree.sim.companion.guard import Guard, Objection, Person, Place
from robotree.sim.companion.head import Head
from robotree.sim.companion.limb import Limb
from robotree.sim.companion.planner import Forbidden, Goal, Planner, Way
from robotree.sim.companion.tuning import HAND_SPEED
from robotree.sim.physics.vectors import Vector

LOOK: Final = 0.03
"""[s] between two looks ahead while something moves."""
AHEAD: Final = 0.15
"""[s] that is looked ahead."""
BESIDE: Final = 0.6
"""[m] from a hand to a person's middle within which the hand must be slow."""
SLOW_AT, STOP_AT = 1.4, 0.50
"""[m] from the middle of the base to a person ahead at which it slows down, and stands."""

People = Callable[[], Sequence[Person]]


class Body:
    """The companion in its flat.

    Args:
        ports: of the body in the flat; its joints stand where it is switched on.
        people: who is where; as a safety sensor around the base would tell.
        aloud: told what the loudspeaker says.
        crowd: how many persons there may be.
        battery: feeds it.
    """

    def __init__(
        self,
        ports: BodyPorts,
        people: People,
        aloud: Callable[[str], None],
        crowd: int,
        battery: Battery,
    ) -> None:
        self._battery = battery
        self._ports, self.people = ports, people
        """Where everybody is."""
        self._figure, self._led = Figure(), Figure()
        thinking = Figure()
        self._guard = Guard(thinking, crowd)
        self._planner = Planner(thinking, self._guard)
        figure = self._figure
        q = np.array(ports.qpos[ports.at])
        self._q, self._turns = q, 0.0
        poses = figure.poses(q)
        self.limbs = tuple(
            Limb(side, hand, q[ARMS[side]], poses[side], self) for side, hand in enumerate(ports.hands)
        )
        self.head = Head(q[NECK], figure.lower[NECK], figure.upper[NECK], aloud)
        lean_range = float(figure.lower[LEAN]), float(figure.upper[LEAN])
        self._heading = _heading(ports.root)
        place = np.array((*ports.root[:2], self._heading))
        self.base = Base(place, float(q[LEAN]), lean_range, self)
        self._look_in = 0.0
        self._pace = [1.0, 1.0]
        self._base_pace = 1.0
        self._nearest = math.inf

    # -- in every step

    def control(self, dt: float) -> None:
        """One period [s] of the control of everything."""
        ports, base, limbs = self._ports, self.base, self.limbs
        q, v = ports.qpos[ports.at], ports.qvel[ports.rate_at]
        self._q = q
        self._heading += math.remainder(_heading(ports.root) - self._heading, math.tau)
        self._look_in -= dt
        if self._look_in <= 0.0:
            self._look_in = LOOK
            self._look()
        bias, dynamics = self._figure.dynamics(q, v)
        led = np.array(q)
        for side, limb in enumerate(limbs):
            led[ARMS[side]] = limb.lead(dt)
        goals = self._led.poses(led)
        for side, limb in enumerate(limbs):
            axes = ARMS[side]
            limb.control(dt, dynamics[side], q[axes], v[axes], goals[side])
        ports.neck[:] = self.head.control(dt, q[NECK], v[NECK], bias[NECK])
        place = np.array((ports.root[0], ports.root[1], self._heading))
        rate = np.array((ports.root_rate[0], ports.root_rate[1], ports.root_rate[5]))
        push, waist = base.control(dt, place, rate, float(q[LEAN]), float(v[LEAN]))
        c, s = math.cos(self._heading), math.sin(self._heading)
        ports.drive[:] = c * push[0] + s * push[1], c * push[1] - s * push[0], push[2]
        ports.waist[0] = waist + bias[LEAN]

    @property
    def place(self) -> Place:
        """Where the base is."""
        return Place(float(self._ports.root[0]), float(self._ports.root[1]), self._heading)

    @property
    def q(self) -> Vector:
        """(15,) joints now [rad]."""
        return np.array(self._q)

    @property
    def nearest(self) -> float:
        """[m] from the middle of the base to the nearest person."""
        return self._nearest

    def balance(self) -> float:
        """[m] by which the zero-moment point stays inside the wheels when the base brakes."""
        return self._guard.balance(self._q)

    # -- what the devices ask

    def reach(self, side: int, goal: Goal, speed: float, acceleration: float) -> Way:
        """A way of a hand to a pose.

        Raises:
            GoalRefused: no posture, or the guard objects.
        """
        self._guard.look(self.place, self.people())
        return self._planner.reach(side, self._whole(), goal, speed, acceleration, self.limbs[1 - side].ahead)

    def posture(self, side: int, end: Vector, speed: float, acceleration: float) -> Way:
        """A way of an arm to a posture.

        Raises:
            GoalRefused: a joint does not go so far, or the guard objects.
        """
        self._guard.look(self.place, self.people())
        return self._planner.posture(
            side, self._whole(), end, speed, acceleration, self.limbs[1 - side].ahead
        )

    def allow(self, side: int, goal: Vector | None, speed: float) -> None:
        """Refuse a speed [m/s] that is too fast beside a person.

        Raises:
            Forbidden: a person is near the hand, or near where it goes.
        """
        if speed <= HAND_SPEED * 1.001:
            return
        here = self._figure.pose(side, self._q).position
        for person in self.people():
            x, y = self.place.inside(person.at)
            gaps = [math.hypot(x - p[0], y - p[1]) for p in (here, goal) if p is not None]
            if min(gaps) < BESIDE:
                text = f"{person.name} is {min(gaps):.2f} m away; move the hand at {HAND_SPEED} m/s or slower"
                raise Forbidden(Objection(Reason.TOO_NEAR, text))

    def must_have_power(self) -> None:
        """Refuse to move with an empty battery.

        Raises:
            Forbidden: it is empty.
        """
        if self._battery.empty:
            text = "the battery is empty; push the robot to its charging place and wait"
            raise Forbidden(Objection(Reason.FAULT, text))

    def pace(self, side: int) -> float:
        """Share of the full pace that an arm may have now."""
        return self._pace[side]

    def tipping(self, lean: float | None) -> Objection | None:
        """Why a drive, or a lean [rad], would tip the base over, or bend the body into something."""
        self._guard.look(self.place, self.people())
        q = self._whole()
        if lean is None:
            return self._guard.tipping(q)
        count = max(2, math.ceil(abs(lean - q[LEAN]) / 0.04))
        begin, steps = float(q[LEAN]), range(count + 1)
        postures = [np.array((begin + (lean - begin) * i / count, *q[1:])) for i in steps]
        return self._guard.objection(postures)

    def base_pace(self) -> float:
        """Share of the full pace that the base may have now."""
        return self._base_pace

    # -- inside

    def _whole(self) -> Vector:
        """(15,) the posture to which everything is led."""
        led = np.array(self._q)
        led[LEAN] = self.base.led_lean
        for side, limb in enumerate(self.limbs):
            led[ARMS[side]] = limb.led
        return led

    def _look(self) -> None:
        """Look ahead, and decide how fast everything may be in the coming moments."""
        people, place = self.people(), self.place
        here = (place.x, place.y)
        self._nearest = min((math.dist(here, each.at) for each in people), default=math.inf)
        self._base_pace = self._pace_of_base(people) if self.base.moving else 1.0
        moving = [limb.moving for limb in self.limbs]
        if not any(moving):
            self._pace[:] = 1.0, 1.0
            return
        for side, limb in enumerate(self.limbs):
            self._pace[side] = self._pace_beside(people, side) if limb.moving else 1.0
        if self._would_touch(place, people):
            self._pace[:] = 0.0, 0.0

    def _would_touch(self, place: Place, people: Sequence[Person]) -> bool:
        """Whether something comes too near within the next moments that is not so near now."""
        self._guard.look(place, people)
        now = self._whole()
        soon = np.array(now)
        for side, limb in enumerate(self.limbs):
            soon[ARMS[side]] = limb.ahead(AHEAD)
        coming = self._guard.too_near(soon)
        return bool(coming) and bool(set(coming) - set(self._guard.too_near(now)))

    def _pace_beside(self, people: Sequence[Person], side: int) -> float:
        """A hand near a person has the reduced speed at most."""
        way = self.limbs[side].speed
        if way <= HAND_SPEED:
            return 1.0
        hand = self._figure.pose(side, self._q).position
        x, y = hand[0], hand[1]
        for person in people:
            px, py = self.place.inside(person.at)
            if math.hypot(px - x, py - y) < BESIDE:
                return HAND_SPEED / way
        return 1.0

    def _pace_of_base(self, people: Sequence[Person]) -> float:
        """The nearer a person ahead, the slower the base; it stands `STOP_AT` before one."""
        pace, (vx, vy) = 1.0, self.base.direction
        place = self.place
        for person in people:
            dx, dy = person.at[0] - place.x, person.at[1] - place.y
            away = math.hypot(dx, dy)
            ahead = dx * vx + dy * vy
            if away < SLOW_AT and ahead > 0.5 * away:
                pace = min(pace, (away - STOP_AT) / (SLOW_AT - STOP_AT))
        return max(pace, 0.0)


def _heading(root: Vector) -> float:
    """[rad] about the vertical, of a body with the quaternion w, x, y, z in `root[3:7]`."""
    w, x, y, z = root[3:7].tolist()
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
