"""Finding a hand's way to a pose: straight, by turning the joints, by way of a tucked arm; else none.

A way is a chain of postures. Between them the joints follow a Catmull-Rom spline (Catmull and Rom, "A class
of local interpolating splines", 1974) over the length of the way, and one number, the length walked, is moved
under a limit of speed, acceleration and jerk. The length of a piece is the larger of what the hand moves and
of what the joints turn times `LEVER`, so that neither a hand nor an elbow is quicker than the speed that was
asked for.

Every way is walked in thought by the guard before anything moves. The other arm may move meanwhile: each
posture of a way is judged with the other arm where it will be at that time, and where its own way ends.

Pure; a reach takes 3 to 12 ms to plan.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
import pinocchio as pin

from robotree.protocol.messages import Reason
from robotree.sim.companion.figure import ARMS, SPAN, Figure, Pose, tool
from robotree.sim.companion.guard import Guard, Objection
from robotree.sim.errors import GoalRefused, OutOfReach
from robotree.sim.motion.path import Limits, Line, Reference
from robotree.sim.physics.vectors import Matrix, Vector

LEVER: Final = 0.2
"""[m] of hand's way that a radian of a joint counts for."""
JERK: Final = 12.0
"""[m/s3]"""


class Way:
    """A chain of postures.

    Args:
        postures: (n, 6) from where the arm is to where it goes [rad].
        hands: (n, 3) where the hand is at each [m].
        speed: of the hand, at most [m/s].
        acceleration: [m/s2].
    """

    def __init__(self, postures: Matrix, hands: Matrix, speed: float, acceleration: float) -> None:
        self._postures, self.speed = postures, speed
        moved = np.linalg.norm(np.diff(hands, axis=0), axis=1)
        turned = LEVER * np.abs(np.diff(postures, axis=0)).max(axis=1)
        steps = np.maximum(np.maximum(moved, turned), 1e-6)
        self._at = np.concatenate(((0.0,), np.cumsum(steps)))
        slopes = np.zeros_like(postures)
        if len(postures) > 2:
            span = (self._at[2:] - self._at[:-2])[:, None]
            slopes[1:-1] = (postures[2:] - postures[:-2]) / span
        slopes[0] = (postures[1] - postures[0]) / steps[0]
        slopes[-1] = (postures[-1] - postures[-2]) / steps[-1]
        self._slopes = slopes
        self.length = float(self._at[-1])
        start = Reference(np.zeros(1), np.zeros(1))
        limits = Limits((speed,), (acceleration,), (JERK,))
        self._walk = Line(start, np.array((self.length,)), limits)

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return self._walk.duration

    @property
    def goal(self) -> Vector:
        """(6,) where it ends [rad]."""
        end: Vector = self._postures[-1]
        return end

    def at(self, time: float) -> Reference:
        """Joints and their velocities `time` [s] after the start."""
        place, speed = self._walk.at(time)
        return self._here(float(place[0]), float(speed[0]))

    def ahead(self, time: float) -> Vector:
        """(6,) joints `time` [s] after the start, or at the end."""
        return self.goal if time >= self.duration else self.at(max(time, 0.0)).pose

    def _here(self, s: float, speed: float) -> Reference:
        i = int(np.searchsorted(self._at, s, side="right")) - 1
        i = min(max(i, 0), len(self._at) - 2)
        h = float(self._at[i + 1] - self._at[i])
        u = min(max((s - float(self._at[i])) / h, 0.0), 1.0)
        a, b = self._postures[i], self._postures[i + 1]
        m, n = h * self._slopes[i], h * self._slopes[i + 1]
        u2, u3 = u * u, u * u * u
        pose = (2 * u3 - 3 * u2 + 1) * a + (u3 - 2 * u2 + u) * m + (3 * u2 - 2 * u3) * b + (u3 - u2) * n
        rate = (6 * u2 - 6 * u) * (a - b) + (3 * u2 - 4 * u + 1) * m + (3 * u2 - 2 * u) * n
        return Reference(pose, rate * (speed / h))


SPACING: Final = 0.025
"""[m] of hand's way between two postures that are judged."""
TURN_SPACING: Final = 0.12
"""[rad] likewise, of any joint, and of the hand's turning on a straight way."""
JUMP: Final = 0.7
"""[rad] between neighbouring postures of a straight way above which the arm would have to flip."""
JOINT_MARGIN: Final = 0.02
"""[rad] that a way keeps from the joints' stops."""
MISSES: Final = 2
"""Searches that ended off a pose after which it counts as out of reach."""
TRIES: Final = 8
"""Objections after which no more ways are tried: the answer must come within 20 ms."""
NEAR: Final = 0.25
"""[m] a hand's way up to which the straight one is tried first: then it is mostly wanted for its own sake."""
TUCKED: Final = (0.15, 0.25, 0.0, 2.1, 0.0, 0.2)
"""[rad] a hand before the breast, by way of which an arm comes around the table."""
RAISED: Final = (0.7, 0.3, 0.0, 1.9, 0.0, -0.3)
"""[rad] a hand before the shoulder."""
VIAS: Final = (TUCKED, RAISED)
REST: Final = (0.05, 0.10, 0.0, 0.45, 0.0, 0.0)
"""[rad] hanging arms."""
SEEDS: Final = (
    REST,
    TUCKED,
    (0.7, 0.2, 0.2, 1.4, 0.0, -0.4),
    (1.3, 0.3, 0.2, 1.0, 0.0, -0.6),
    (1.0, 1.0, 0.6, 1.4, 0.5, 0.0),
)
"""[rad] where the search for a posture begins, beside where the arm is."""
TWISTS: Final = (0.0, 0.35, -0.35, 0.7, -0.7, 1.05, -1.05)
"""[rad] tried, inwards first, where any will do."""
TILTS: Final = (0.5 * math.pi, 0.35 * math.pi, 0.62 * math.pi)
"""[rad] likewise; level first."""


class Forbidden(GoalRefused):
    """The guard of the whole body forbids it."""

    def __init__(self, objection: Objection) -> None:
        self.why = objection.reason
        super().__init__(objection.text)

    @property
    def reason(self) -> Reason:  # type: ignore[override]
        """As the wire says it."""
        return self.why


class Goal(NamedTuple):
    """Where a hand shall be: x, y, z [m] in B; twist and tilt [rad], NaN: any that suits."""

    x: float
    y: float
    z: float
    twist: float
    tilt: float

    @property
    def point(self) -> tuple[float, float, float]:
        """Its place."""
        return self.x, self.y, self.z


Other = Callable[[float], Vector]
"""The posture (6,) of the other arm, `time` [s] from now."""


class Planner:
    """Plans for both arms; keeps scratch memory, so it belongs to one thread."""

    def __init__(self, figure: Figure, guard: Guard) -> None:
        self._figure, self._guard = figure, guard

    def reach(self, side: int, q: Vector, goal: Goal, speed: float, acceleration: float, other: Other) -> Way:
        """Find a way of a hand to a pose.

        Args:
            side: which arm.
            q: (15,) the whole body as it is led now [rad].
            goal: of the hand.
            speed: [m/s]
            acceleration: [m/s2]
            other: where the other arm will be.

        Raises:
            OutOfReach: no posture brings the hand there.
            Forbidden: the guard objects to every way that was tried.
        """
        shoulder = self._figure.shoulder(side, q)
        if (far := math.dist(goal.point, shoulder)) > SPAN + 0.02:
            raise OutOfReach(goal.point, f"{far:.2f} m from the shoulder; the arm is {SPAN} m long")
        objections: list[Objection] = []
        found = False
        for pose in _poses(side, goal):
            for end in self._ends(side, pose, q):
                if len(objections) >= TRIES:
                    raise Forbidden(objections[0])
                found = True
                whole = np.array(q)
                whole[ARMS[side]] = end
                if (objection := self._guard.standing(whole)) is not None:
                    objections.append(objection)
                    continue
                way = self._to(side, q, end, pose, speed, acceleration, other, objections)
                if way is not None:
                    return way
        if not found:
            raise OutOfReach(goal.point, "no posture brings the hand there")
        raise Forbidden(objections[0])

    def posture(
        self, side: int, q: Vector, end: Vector, speed: float, acceleration: float, other: Other
    ) -> Way:
        """Find a way of an arm to a posture (6,) [rad].

        Raises:
            GoalRefused: a joint does not go so far, or the guard objects.
        """
        axes = ARMS[side]
        lower, upper = self._figure.lower[axes], self._figure.upper[axes]
        for i, (value, least, most) in enumerate(zip(end, lower, upper, strict=True), 1):
            if not least <= value <= most:
                raise Forbidden(
                    Objection(
                        Reason.BAD_ARGUMENT,
                        f"j{i} is {value:.2f} rad; it goes from {least:.2f} to {most:.2f}",
                    )
                )
        objections: list[Objection] = []
        way = self._to(side, q, end, None, speed, acceleration, other, objections)
        if way is None:
            raise Forbidden(objections[0])
        return way

    # -- inside

    def _ends(self, side: int, pose: Pose, q: Vector) -> Iterator[Vector]:
        """Postures (6,) that bring the hand to a pose, the one nearest to the present first."""
        figure, axes = self._figure, ARMS[side]
        lower, upper = figure.lower[axes] + JOINT_MARGIN, figure.upper[axes] - JOINT_MARGIN
        ends: list[Vector] = []
        misses = 0
        for seed in (q[axes], *map(np.array, SEEDS)):
            found = figure.solve(side, pose, q, seed, iterations=40)
            inside = bool((found.q >= lower).all() and (found.q <= upper).all())
            if found.reached and inside and all(np.abs(found.q - end).max() > 0.05 for end in ends):
                ends.append(found.q)
                yield found.q
            elif not found.reached and not ends:
                misses += 1
                if misses >= MISSES:
                    return

    def _to(
        self,
        side: int,
        q: Vector,
        end: Vector,
        pose: Pose | None,
        speed: float,
        acceleration: float,
        other: Other,
        objections: list[Objection],
    ) -> Way | None:
        """A way to a posture that the guard allows; None: there is none, and `objections` grew."""
        for chain in self._chains(side, q, end, pose):
            hands = self._hands(side, q, chain)
            way = Way(np.array(chain), hands, speed, acceleration)
            objection = self._guard.objection(list(self._meanwhile(side, q, way, other)))
            if objection is None:
                return way
            objections.append(objection)
            if len(objections) >= TRIES:
                return None
        return None

    def _chains(self, side: int, q: Vector, end: Vector, pose: Pose | None) -> Iterator[Sequence[Vector]]:
        """Chains of postures (6,) to try, the most direct first."""
        begin, figure = q[ARMS[side]], self._figure
        near = pose is not None and math.dist(figure.pose(side, q).position, pose.position) <= NEAR
        yield from self._legs(side, q, begin, end, straight_first=near)
        for via in map(np.array, VIAS):
            for coming in self._legs(side, q, begin, via):
                for going in self._legs(side, q, via, end):
                    yield [*coming, *going[1:]]

    def _legs(
        self, side: int, q: Vector, begin: Vector, end: Vector, *, straight_first: bool = False
    ) -> Iterator[list[Vector]]:
        """Between two postures: by turning the joints, and by a straight way of the hand if there is one."""
        if not straight_first:
            yield [begin, end]
        straight = self._straight(side, q, begin, end)
        if straight is not None:
            yield straight
        if straight_first:
            yield [begin, end]

    def _straight(self, side: int, q: Vector, begin: Vector, end: Vector) -> list[Vector] | None:
        """Postures on a straight way of the hand; None: there is none."""
        figure, axes = self._figure, ARMS[side]
        whole = np.array(q)
        whole[axes] = end
        pose = figure.pose(side, whole)
        whole[axes] = begin
        start = figure.pose(side, whole)
        turn = pin.log3(start.rotation.T @ pose.rotation)
        way = pose.position - start.position
        count = math.ceil(max(math.hypot(*way) / SPACING, math.hypot(*turn) / TURN_SPACING, 1.0))
        chain = [np.array(begin)]
        for i in range(1, count):
            share = i / count
            step = Pose(start.position + share * way, start.rotation @ pin.exp3(share * turn))
            found = figure.solve(side, step, q, chain[-1], iterations=25)
            if not found.reached or np.abs(found.q - chain[-1]).max() > JUMP:
                return None
            chain.append(found.q)
        if np.abs(end - chain[-1]).max() > JUMP:
            return None
        return [*chain, end]

    def _hands(self, side: int, q: Vector, chain: Sequence[Vector]) -> Vector:
        whole, hands = np.array(q), np.empty((len(chain), 3))
        for i, posture in enumerate(chain):
            whole[ARMS[side]] = posture
            hands[i] = self._figure.pose(side, whole).position
        return hands

    def _meanwhile(self, side: int, q: Vector, way: Way, other: Other) -> Iterator[Vector]:
        """The whole body (15,) at moments of a way, close enough to judge it."""
        count = max(2, math.ceil(way.length / SPACING))
        at, ends, duration = ARMS[side], other(math.inf), way.duration
        moves = np.abs(ends - q[ARMS[1 - side]]).max() > 1e-3
        for i in range(count + 1):
            time = duration * i / count
            whole = np.array(q)
            whole[at] = way.ahead(time)
            if moves:
                whole[ARMS[1 - side]] = other(time)
            yield whole
            if moves and i:
                late = np.array(whole)
                late[ARMS[1 - side]] = ends
                yield late


def _poses(side: int, goal: Goal) -> Iterator[Pose]:
    """The poses that a goal allows, the most natural first."""
    point = np.array(goal.point)
    sign = -1.0 if side == 0 else 1.0
    tilts = TILTS if math.isnan(goal.tilt) else (goal.tilt,)
    for tilt in tilts:
        for turn in TWISTS if math.isnan(goal.twist) else (0.0,):
            twist = goal.twist if not math.isnan(goal.twist) else sign * turn
            yield Pose(point, tool(twist, tilt))
