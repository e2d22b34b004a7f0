"""Visitors: simple figures with tags who come, listen, follow, take a cup and leave, each by a play of steps.

They notice what people would: where the robot is and whether it stands, what it says when it is near, a cup
that is held out to them, and a weight in their open hand. They close their fingers about a cup once it rests
on the palm; the simulator then fixes it there, as a person's grip would.

Pure: what they notice comes in, where they are and what they do goes out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple, TypeAlias

from robotree.sim.companion.flat import DOOR, OUTSIDE, Figurine

WALK: Final = 0.7
"""[m/s]"""
TURN: Final = 2.5
"""[rad/s]"""
SHY: Final = 0.75
"""[m] from the middle of the robot's base at which a visitor walks no further towards it."""
EARSHOT: Final = 4.0
"""[m]"""
OFFER: Final = 1.3
"""[m] from a held cup to a visitor who holds out the hand for it."""
HAND_HEIGHT: Final = 0.56
"""Share of the visitor's height at which the palm is held out."""
HAND_AHEAD: Final = 0.34
"""[m] before the visitor's middle."""
HAND_AT_REST: Final = (0.0, 0.20, 0.44)
"""[m, m, share of the height] ahead and to the left of the middle, and how high: the hand beside the hip."""
FELT: Final = 0.6
"""Share of a cup's weight on the palm that is felt as a cup that stands there."""
LET_GO: Final = 0.18
"""[m] from the palm to the robot's hands beyond which a visitor moves the hand with a cup."""
CLOSE_AFTER: Final = 0.35
"""[s] of feeling it after which the fingers close."""
REACH_RATE: Final = 0.6
"""[m/s] of the hand."""

Point: TypeAlias = tuple[float, float]


class Come(NamedTuple):
    """Wait outside until the robot stands near a place [m] and no other visitor is in the flat."""

    near: Point
    within: float = 0.8


class Walk(NamedTuple):
    """Walk to a place [m], and turn to a heading [rad] if there is one."""

    to: Point
    heading: float = math.nan


class Listen(NamedTuple):
    """Wait until the robot says something within earshot, `patience` [s] at most."""

    patience: float = 60.0


class Say(NamedTuple):
    """Say a sentence."""

    text: str


class Wait(NamedTuple):
    """Wait [s]."""

    seconds: float


class Follow(NamedTuple):
    """Walk behind the robot until it stands near a place [m]."""

    to: Point
    within: float = 0.9
    distance: float = 1.1
    patience: float = 120.0


class Receive(NamedTuple):
    """Hold out the hand when a cup is offered, and take it; who is clumsy pulls the hand away too early."""

    clumsy: bool = False
    patience: float = 240.0


Step: TypeAlias = Come | Walk | Listen | Say | Wait | Follow | Receive
Play: TypeAlias = Sequence[Step]


class Notice(NamedTuple):
    """The facts that a visitor can notice at one moment.

    Attributes:
        robot: x, y of the robot's base [m].
        still: whether it stands.
        spoken: how many texts it has said so far.
        cups: x, y, z of each cup by its tag [m].
        held: tags of the cups that are in a hand of the robot.
        hands: x, y, z of the robot's hands [m].
        alone: whether no other visitor is in the flat.
        felt: what rests on the visitor's palm, as a share of a cup's weight, and the tag of that cup.
    """

    robot: Point
    still: bool
    spoken: int
    cups: dict[int, tuple[float, float, float]]
    held: frozenset[int]
    hands: Sequence[tuple[float, float, float]]
    alone: bool
    felt: tuple[float, int]


@dataclass(slots=True)
class Visitor:
    """One visitor.

    Attributes:
        looks: who it is.
        x: [m, W]
        y: [m, W]
        heading: [rad]
        hand: the palm's place (3,) [m, W].
        holding: tag of the cup in the hand; 0: none.
        inside: whether it has come and not gone yet.
        words: what was said since it was looked at last.
    """

    looks: Figurine
    x: float
    y: float
    heading: float = 0.0
    hand: tuple[float, float, float] = (0.0, 0.0, 0.0)
    holding: int = 0
    inside: bool = False
    words: list[str] = field(default_factory=list[str])
    _play: list[Step] = field(default_factory=list[Step])
    _since: float = 0.0
    _felt: float = 0.0
    _spoken: int = -1
    _out: bool = False

    def __post_init__(self) -> None:
        """The hand hangs."""
        self.hand = self._rest()

    @property
    def offers(self) -> bool:
        """Whether the open hand is held out."""
        return self._out

    def put(self, x: float, y: float, heading: float = 0.0) -> None:
        """Let the visitor stand elsewhere at once [m, rad]."""
        self.x, self.y, self.heading = x, y, heading
        self.hand = self._rest()

    def perform(self, play: Play) -> None:
        """Begin a play."""
        self._play, self._since, self._spoken, self._felt = list(play), 0.0, -1, 0.0

    def advance(self, dt: float, seen: Notice) -> None:
        """Go on for `dt` [s]."""
        wanted = self._rest()
        if self._play and self._perform(self._play[0], dt, seen):
            self.inside = len(self._play) > 1 and (self.inside or isinstance(self._play[0], Come))
            del self._play[0]
            self._since, self._spoken, self._felt = 0.0, -1, 0.0
            self._out = False
        else:
            self._since += dt
        if self._out:
            wanted = self._palm()
        elif self.holding:
            wanted = self._carry()
        self.hand = _nearer(self.hand, wanted, max(REACH_RATE, 2 * WALK) * dt)

    # -- inside

    def _perform(self, step: Step, dt: float, seen: Notice) -> bool:  # noqa: PLR0911  one for each step
        """Do a part of a step; returns whether it has ended."""
        match step:
            case Come(near, within):
                return seen.alone and seen.still and math.dist(near, seen.robot) < within
            case Walk(to, heading):
                return self._walk(to, dt, seen) and (math.isnan(heading) or self._turn(heading, dt))
            case Listen(patience):
                self._face(seen.robot, dt)
                return self._hears(seen) or self._since > patience
            case Say(text):
                self.words.append(text)
                return True
            case Wait(seconds):
                return self._since >= seconds
            case Follow(to, within, distance, patience):
                if seen.still and math.dist(to, seen.robot) < within:
                    return True
                if math.dist((self.x, self.y), seen.robot) > distance:
                    self._walk(seen.robot, dt, seen, short=distance)
                return self._since > patience
            case Receive(clumsy, patience):
                return self._receive(dt, seen, clumsy=clumsy) or self._since > patience

    def _receive(self, dt: float, seen: Notice, *, clumsy: bool) -> bool:
        near = [tag for tag in seen.held if math.dist(seen.cups[tag][:2], (self.x, self.y)) < OFFER]
        share, tag = seen.felt
        if not self._out:
            self._face(seen.robot, dt)
            self._out = bool(near)
            return False
        self._felt = self._felt + dt if share > FELT else 0.0
        if clumsy:
            return self._felt > 0.0 and tag not in seen.held
        if self._felt > CLOSE_AFTER and tag not in seen.held:
            self.holding = tag
        # Fingers that hold a cup stay where they are until the robot's hand has gone.
        return bool(self.holding) and min(math.dist(self.hand, each) for each in seen.hands) > LET_GO

    def _hears(self, seen: Notice) -> bool:
        if self._spoken < 0:
            self._spoken = seen.spoken
        near = math.dist((self.x, self.y), seen.robot) < EARSHOT
        return near and seen.spoken > self._spoken

    def _walk(self, to: Point, dt: float, seen: Notice, short: float = 0.02) -> bool:
        """A step towards a place; returns whether it is reached."""
        away = math.dist((self.x, self.y), to)
        if away <= short:
            return True
        heading = math.atan2(to[1] - self.y, to[0] - self.x)
        if not self._turn(heading, dt, within=0.5):
            return False
        step = min(WALK * dt, away - short if short > 0.02 else away)
        x, y = self.x + step * math.cos(heading), self.y + step * math.sin(heading)
        dx, dy = seen.robot[0] - x, seen.robot[1] - y
        ahead = dx * math.cos(heading) + dy * math.sin(heading)
        if math.hypot(dx, dy) < SHY and ahead > 0.7 * math.hypot(dx, dy):
            return False
        self.x, self.y = x, y
        return False

    def _turn(self, heading: float, dt: float, within: float = 0.02) -> bool:
        off = math.remainder(heading - self.heading, math.tau)
        self.heading += min(max(off, -TURN * dt), TURN * dt)
        return abs(off) < within

    def _face(self, point: Point, dt: float) -> None:
        self._turn(math.atan2(point[1] - self.y, point[0] - self.x), dt)

    def _at(self, ahead: float, left: float, height: float) -> tuple[float, float, float]:
        c, s = math.cos(self.heading), math.sin(self.heading)
        return self.x + c * ahead - s * left, self.y + s * ahead + c * left, height

    def _rest(self) -> tuple[float, float, float]:
        ahead, left, share = HAND_AT_REST
        return self._at(ahead, left, share * self.looks.height)

    def _palm(self) -> tuple[float, float, float]:
        return self._at(HAND_AHEAD, 0.0, min(max(HAND_HEIGHT * self.looks.height, 0.80), 0.98))

    def _carry(self) -> tuple[float, float, float]:
        return self._at(0.24, 0.12, min(max(HAND_HEIGHT * self.looks.height, 0.80), 0.98))


def _nearer(
    now: tuple[float, float, float], wanted: tuple[float, float, float], step: float
) -> tuple[float, float, float]:
    away = math.dist(now, wanted)
    if away <= step:
        return wanted
    share = step / away
    return (
        now[0] + share * (wanted[0] - now[0]),
        now[1] + share * (wanted[1] - now[1]),
        now[2] + share * (wanted[2] - now[2]),
    )


ENTRANCE: Final = (-1.55, -1.1)
"""[m] where the robot receives visitors."""
LOUNGE: Final = (0.15, -1.0)
"""[m] where the robot guides them."""


def _arrives(name: str) -> tuple[Step, ...]:
    return (
        Come(ENTRANCE),
        Walk(DOOR),
        Walk((-2.45, -1.5)),
        Say(f"Good day, I am {name}."),
        Listen(),
    )


def _leaves(row: int) -> tuple[Step, ...]:
    return Walk((-1.9, -1.75)), Walk(DOOR), Walk((OUTSIDE[0] - 0.9 * row, OUTSIDE[1]))


SEAT: Final = (0.95, -1.35)
"""[m] before the sofa."""
GUIDED: Final = (
    *_arrives("Anna"),
    Follow(LOUNGE),
    Walk(SEAT),
    Receive(),
    Say("Thank you very much."),
    Wait(1.5),
    *_leaves(0),
)
"""Is greeted, guided and served, and leaves with the cup."""
IMPATIENT: Final = (
    *_arrives("Bela"),
    Follow(LOUNGE),
    Walk(SEAT),
    Wait(2.0),
    Say("I am sorry, I have to go."),
    *_leaves(1),
)
"""Leaves before the cup comes."""
CLUMSY: Final = (
    *_arrives("Cleo"),
    Follow(LOUNGE),
    Walk(SEAT),
    Receive(clumsy=True),
    Say("Oh no! I let it fall."),
    Receive(),
    Say("Thank you, I will hold this one tight."),
    Wait(1.0),
    *_leaves(2),
)
"""Lets the first cup fall, and takes the second one."""
EVENING: Final[tuple[Play, ...]] = (GUIDED, (Wait(2.0), *IMPATIENT), (Wait(4.0), *CLUMSY))
"""The plays of the three visitors, who come one after the other."""
