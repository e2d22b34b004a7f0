"""The guard of the whole body: judges a path before anything moves.

It knows the body's own shape (Pinocchio's geometry, distances by Coal), the furniture (the flat's map), and
where people are. A path is refused when one of its postures
  * brings two parts of the body, or a part and a piece of furniture, nearer than a margin,
  * brings a hand or an arm too near to a person's body or head,
  * shifts the weight so far that braking could tip the base over.

Tipping: the zero-moment point of a rigid body that decelerates at `a` lies a h / g ahead of the projection of
its centre of mass at height h (Vukobratovic and Borovac, "Zero-Moment Point: thirty five years of its life",
IJHR 2004, eq. 7); it must stay inside the wheels' rectangle.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from robotree.protocol.messages import Reason
from robotree.sim.companion.figure import SIDES, Figure
from robotree.sim.companion.flat import FURNITURE, WAIST
from robotree.sim.physics.vectors import Vector

SELF_MARGIN: Final = 0.015
"""[m] that parts of the body keep from each other; arms follow their ways to 4 mm when nothing pushes."""
THING_MARGIN: Final = 0.008
"""[m] from furniture."""
PERSON_MARGIN: Final = 0.10
"""[m] of arms and hands from a person's body and head; a hand that is held out may be touched."""
TRACK, WHEELBASE = 0.14, 0.16
"""[m] from the middle to the wheels, sideways and lengthwise."""
GRAVITY: Final = 9.81
"""[m/s2]"""
BRAKING: Final = 0.7
"""[m/s2] at which the base may have to brake at any moment."""
BALANCE_MARGIN: Final = 0.02
"""[m] that the zero-moment point keeps from the wheels' rectangle."""
BODY: Final = ("chassis", "column", "trunk_l", "trunk_r", "chest", "skull")
LIMB: Final = ("upper_arm", "lower_arm", "cuff", "knuckle", "palm", "pad_l", "pad_r")
NEIGHBOURS: Final = {("upper_arm", "chest"), ("upper_arm", "trunk_l"), ("upper_arm", "trunk_r")}
"""Beside the shoulder; the joints' stops keep them apart."""
_IN_WORDS: Final = {
    "chassis": "base",
    "trunk_l": "trunk",
    "trunk_r": "trunk",
    "skull": "head",
    "pad_l": "fingers",
    "pad_r": "fingers",
    "palm": "hand",
    "knuckle": "wrist",
    "cuff": "wrist",
    "lower_arm": "forearm",
    "upper_arm": "upper arm",
}


class Person(NamedTuple):
    """Where somebody stands: x, y [m, W] and the height [m]."""

    name: str
    at: tuple[float, float]
    height: float


class Objection(NamedTuple):
    """Why something is refused: the wire's reason, and one sentence."""

    reason: Reason
    text: str


class Place(NamedTuple):
    """Where the base is in W: x, y [m] and heading [rad]."""

    x: float
    y: float
    heading: float

    def inside(self, point: Sequence[float]) -> tuple[float, float]:
        """x, y in B of a point x, y in W [m]."""
        dx, dy = point[0] - self.x, point[1] - self.y
        c, s = math.cos(self.heading), math.sin(self.heading)
        return c * dx + s * dy, c * dy - s * dx


class _Pair(NamedTuple):
    first: int
    second: int
    margin: float
    words: str
    reason: Reason


class Guard:
    """Judges postures of the whole body. Keeps scratch memory, so it belongs to one thread.

    Args:
        figure: the body; the guard's own.
        people: how many persons there may be.
    """

    def __init__(self, figure: Figure, people: int) -> None:
        self._figure = figure
        shapes = figure.shapes
        self._things = [
            self._add(f"thing_{box.name}", coal.Box(*(2 * s for s in box.half))) for box in FURNITURE
        ]
        self._people = [self._add(f"person_{i}", coal.Capsule(WAIST, 1.0)) for i in range(people)]
        self._heads = [self._add(f"head_{i}", coal.Sphere(0.12)) for i in range(people)]
        self._pairs = [*self._own_pairs(), *self._thing_pairs(), *self._person_pairs()]
        for pair in self._pairs:
            shapes.addCollisionPair(pin.CollisionPair(pair.first, pair.second))
        self._scratch = shapes.createData()
        for request, pair in zip(self._scratch.collisionRequests, self._pairs, strict=True):
            request.security_margin = pair.margin
        self._names: list[str] = [""] * people
        self._place = Place(math.nan, 0.0, 0.0)

    def look(self, place: Place, people: Sequence[Person]) -> None:
        """Take in where the base is, and who is where."""
        if place != self._place:
            self._place = place
            for index, box in zip(self._things, FURNITURE, strict=True):
                x, y = place.inside(box.at)
                self._put(index, (x, y, box.at[2]), -place.heading)
        for i, person in enumerate(people):
            x, y = place.inside(person.at)
            self._names[i] = person.name
            self._put(self._people[i], (x, y, 0.5 * person.height), 0.0)
            self._put(self._heads[i], (x, y, 0.93 * person.height), 0.0)

    def too_near(self, q: Vector) -> list[int]:
        """Which pairs are nearer than their margins at the posture `q` (15,); empty: none."""
        figure, shapes, scratch = self._figure, self._figure.shapes, self._scratch
        if not pin.computeCollisions(figure.model, figure.data, shapes, scratch, q, False):
            return []
        return [i for i, result in enumerate(scratch.collisionResults) if result.isCollision()]

    def gap(self, pair: int) -> float:
        """[m] between a pair at the posture that was looked at last."""
        return float(pin.computeDistance(self._figure.shapes, self._scratch, pair).min_distance)

    def objection(self, postures: Sequence[Vector]) -> Objection | None:
        """Why a way is refused; None: it is not.

        Where two parts are too near already, as with a hand that lies on the table, they may come apart.

        Args:
            postures: (15,) along the way, the first one where it begins; no more than 3 cm apart.
        """
        outset = {pair: self.gap(pair) for pair in self.too_near(postures[0])}
        for q in postures[1:]:
            for pair in self.too_near(q):
                if pair not in outset or self.gap(pair) < min(outset[pair], self._pairs[pair].margin) - 0.003:
                    return self.word(pair)
            if (tipping := self.tipping(q)) is not None:
                return tipping
        return None

    def standing(self, q: Vector) -> Objection | None:
        """Why the body may not be at the posture `q` (15,); None: it may."""
        touching = self.too_near(q)
        return self.word(touching[0]) if touching else self.tipping(q)

    def tipping(self, q: Vector) -> Objection | None:
        """Why the base would tip over when it brakes at BRAKING; None: it would not."""
        room = self.balance(q)
        if room >= BALANCE_MARGIN:
            return None
        text = f"the weight would lie {100 * room:.0f} cm inside the wheels; keep {100 * BALANCE_MARGIN:.0f}"
        return Objection(Reason.TIP_OVER, f"it could tip over: {text}; lean or reach less far")

    def balance(self, q: Vector, braking: float = BRAKING) -> float:
        """[m] by which the zero-moment point stays inside the wheels' rectangle; negative: outside."""
        x, y, z = map(float, self._figure.balance(q).centre)
        ahead = braking * z / GRAVITY
        return min(WHEELBASE - abs(x) - ahead, TRACK - abs(y) - ahead)

    def word(self, pair: int) -> Objection:
        """Return the objection to a pair that is too near."""
        _, _, margin, words, reason = self._pairs[pair]
        for i, name in enumerate(self._names):
            words = words.replace(f"person {i}", name)
        return Objection(reason, f"{words} would come nearer than {1000 * margin:.0f} mm")

    # -- inside

    def _add(self, name: str, shape: coal.CollisionGeometry) -> int:
        return int(
            self._figure.shapes.addGeometryObject(
                pin.GeometryObject(name, 0, pin.SE3(np.eye(3), np.array((0.0, 0.0, -50.0))), shape)
            )
        )

    def _put(self, index: int, at: tuple[float, float, float], heading: float) -> None:
        c, s = math.cos(heading), math.sin(heading)
        turned = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
        self._figure.shapes.geometryObjects[index].placement = pin.SE3(turned, np.array(at))

    def _id(self, name: str) -> int:
        return int(self._figure.shapes.getGeometryId(name))

    def _own_pairs(self) -> list[_Pair]:
        pairs: list[_Pair] = []
        for side in SIDES:
            for limb in LIMB:
                for body in BODY:
                    if (limb, body) not in NEIGHBOURS:
                        words = f"{side} {_IN_WORDS[limb]} and {_IN_WORDS.get(body, body)}"
                        pairs.append(self._own(f"{side}_{limb}", body, words))
            for limb in ("palm", "pad_l", "pad_r", "knuckle"):
                words = f"{side} {_IN_WORDS[limb]} and {side} upper arm"
                pairs.append(self._own(f"{side}_{limb}", f"{side}_upper_arm", words))
        for mine in LIMB:
            for other in LIMB:
                words = f"left {_IN_WORDS[mine]} and right {_IN_WORDS[other]}"
                pairs.append(self._own(f"left_{mine}", f"right_{other}", words))
        return pairs

    def _own(self, first: str, second: str, words: str) -> _Pair:
        return _Pair(self._id(first), self._id(second), SELF_MARGIN, words, Reason.SELF_COLLISION)

    def _thing_pairs(self) -> list[_Pair]:
        parts = [f"{side}_{limb}" for side in SIDES for limb in LIMB[1:]] + ["skull", "chest"]
        return [
            _Pair(
                self._id(part),
                thing,
                THING_MARGIN,
                f"{_words(part)} and the {box.name.replace('_', ' ')}",
                Reason.PATH_BLOCKED,
            )
            for part in parts
            for thing, box in zip(self._things, FURNITURE, strict=True)
        ]

    def _person_pairs(self) -> list[_Pair]:
        parts = [f"{side}_{limb}" for side in SIDES for limb in ("lower_arm", "palm", "pad_l", "pad_r")]
        return [
            _Pair(
                self._id(part),
                shape,
                PERSON_MARGIN,
                f"{_words(part)} and person {i}",
                Reason.TOO_NEAR,
            )
            for part in (*parts, "skull", "chest")
            for shapes in (self._people, self._heads)
            for i, shape in enumerate(shapes)
        ]


def _words(part: str) -> str:
    side, _, limb = part.partition("_")
    return f"{side} {_IN_WORDS[limb]}" if side in SIDES else _IN_WORDS.get(part, part)
