"""Companion: a robot that receives visitors, and the library of its actions.

    robotree sim companion --listen tcp:127.0.0.1:5770
    robotree proxy base base --connect tcp:127.0.0.1:5770
    robotree proxy limb left --connect tcp:127.0.0.1:5770 --component 25
    robotree proxy limb right --connect tcp:127.0.0.1:5770 --component 26
    robotree proxy head head --connect tcp:127.0.0.1:5770 --component 27
    robotree create examples/companion/companion.py as companion
    robotree enslave companion.base base        (and left, right, head)
    robotree call companion.wave

Every action is a command over a few primitives of base, arms and head, so a script, a session or a person can
use it. A role changes how they are carried out: the words, the speed, the distance to people, the gestures.
Whether something may be done at all, the robot's controller decides, and says why not.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from robotree.vr import Child, CommandFailed, Range, Unit, command
from robotree.vr.scripts.roles import Limit, RolePlayer

# -- the flat, as data -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Place:
    """A named place: where the base stands [m] and looks [rad], and what is there to look at [m]."""

    x: float
    y: float
    heading: float
    at: tuple[float, float, float]


PlaceName = Literal["door", "sofa", "table", "shelf", "middle", "dock"]
ThingName = Literal["red cup", "green cup", "blue cup"]

PLACES: dict[PlaceName, Place] = {
    "door": Place(-1.55, -1.10, -2.55, (-2.8, -1.6, 1.2)),
    "sofa": Place(0.15, -1.00, -0.75, (0.9, -2.0, 0.8)),
    "table": Place(0.85, 0.90, 0.0, (1.6, 0.9, 0.75)),
    "shelf": Place(2.10, -1.20, 0.0, (2.8, -1.2, 0.9)),
    "middle": Place(0.0, 0.0, 0.0, (1.0, 0.0, 1.0)),
    "dock": Place(-2.45, 1.80, 0.0, (-1.5, 1.8, 1.0)),
}
"""Where things are in the flat. Another flat: another page with another table."""
THINGS: dict[str, int] = {"red cup": 1, "green cup": 2, "blue cup": 3}
PEOPLE = {"anna": 11, "bela": 12, "cleo": 13}
TAGS: dict[str, int] = {**THINGS, **PEOPLE}
"""What wears a tag, by the name that people use."""
PALM = 10
"""Added to a person's tag: the tag of the hand that is held out."""

# -- the body ----------------------------------------------------------------------------------------------

REST = {"j1": 0.05, "j2": 0.10, "j3": 0.0, "j4": 0.45, "j5": 0.0, "j6": 0.0}
CARRY = {"j1": 0.15, "j2": 0.12, "j3": 0.0, "j4": 1.75, "j5": 0.0, "j6": -0.33}
"""Postures of an arm [rad], the same for left and right: hanging; a level hand before the hip."""
SHOULDER, EYES = (-0.03, 0.225, 1.02), 1.28
"""[m] of the left shoulder in the body's frame, and the height of the eyes above the floor."""
AHEAD, ASIDE = 0.45, 0.20
"""[m] where a hand works best: before the body, and to the side of its shoulder."""
BESIDE = 0.06
"""[m] further aside: there a hand that holds a cup does not hide an open hand before it from the eyes."""
CUP = 0.11
"""[m] height of a cup; its tag marks its middle."""
HOLDS = 0.02
"""[m] fingers that came closer than this hold nothing."""
INWARD, ALONG = 0.12, (0.0, 0.3, -0.3, 0.15, -0.15)
"""[m] towards the robot and to its left from the point of a table that is looked at: where a cup may be."""
LOW = 0.3
"""[m] above the floor: what is lower has fallen."""
NEAR = 0.7
"""[m] around the middle of the table, or around a person: what is seen there is on it, or with the person."""
GENTLE, BRISK = 0.10, 0.25
"""[m/s] of a hand with and without something that it may knock over."""
LETTERS = 15.0
"""Letters spoken in a second by a role that names no other rate."""
GLANCE = 0.1
"""[s] between two looks at the fingers while a hand carries something; two of them must tell of a loss."""
STALE = 2.0
"""[s] after which what was seen is looked at again."""

Hand = Literal["left", "right"]
Text = Annotated[str, "what to say, up to 200 bytes"]
What = Annotated[str, "a place, a thing or a person by name: " + ", ".join([*PLACES, *TAGS])]
Who = Annotated[str, "a person by name: " + ", ".join(PEOPLE)]
Thing = Annotated[ThingName, "a thing by name"]
Where = Annotated[PlaceName, "a place by name"]
Speed = Annotated[float, Unit("m/s"), Range(0.05, 0.8), "of the base; slower near people"]
Distance = Annotated[float, Unit("m"), Range(0.5, 3.0), "to the person"]
Seconds = Annotated[float, Unit("s"), Range(0.0, 3600.0), "how long"]
Times = Annotated[int, Range(1, 10), "how often"]
Depth = Annotated[float, Unit("rad"), Range(0.0, 0.6), "how deep"]
Share = Annotated[float, Range(0.0, 1.0), "0 to 1"]
X = Annotated[float, Unit("m"), Range(-3.0, 3.0), "of the flat"]
Y = Annotated[float, Unit("m"), Range(-2.4, 2.4), "of the flat"]
Z = Annotated[float, Unit("m"), Range(0.2, 1.7), "above the floor"]


class Companion(RolePlayer):
    """A robot that receives visitors, shows them the way and hands them a cup."""

    limits: ClassVar[Mapping[str, Limit]] = {"speed": Limit(upper=0.8), "distance": Limit(lower=0.5)}

    left = Child("Limb", "the left arm")
    right = Child("Limb", "the right arm")
    head = Child("Head", "cameras, ears and voice")
    base = Child("Base", "wheels and waist")

    listen = head.exposed()
    heard = head.exposed()

    def __init__(self, name: str, attributes: Mapping[str, str] | None = None) -> None:
        """Name the robot; its hands are empty."""
        super().__init__(name, attributes)
        self.carried: dict[str, str] = {}
        """What each hand has taken, by the name of the thing."""
        self.battery = math.nan
        """How full its battery was when it was looked at last, 0 to 1."""
        self.moved: dict[str, tuple[str, float]] = {}
        """Where a hand has left a thing (see `where`), and when [s]."""

    def readings(self) -> dict[str, float]:
        """See `Robot.readings`: the battery as it was in the latest act that looked where the base stands."""
        return {} if math.isnan(self.battery) else {"battery": self.battery}

    # -- speaking and looking

    @command(offline="queue")
    def say(self, text: Text) -> str:
        """Say a phrase as the present role words it; returns when it is said."""
        said = self.manner.words(text)
        self.head.say(text=said)
        self.sleep(len(said) / (LETTERS * max(self.manner.number("rate", 1.0), 0.1)))
        return said

    @command(effect="repeat")
    def look_at(self, what: What) -> None:
        """Turn the head to something."""
        self.look_towards(*self.point_of(what))

    @command(effect="repeat")
    def nod(self, times: Times = 2) -> None:
        """Nod."""
        for _ in range(round(self.manner.number("times", times))):
            self.head.look(pan=0.0, tilt=0.35, rate=2.0)
            self.head.look(pan=0.0, tilt=-0.05, rate=2.0)
        self.head.look(pan=0.0, tilt=0.0)

    @command(effect="repeat")
    def shake_head(self, times: Times = 2) -> None:
        """Shake the head."""
        for _ in range(round(self.manner.number("times", times))):
            self.head.look(pan=0.4, tilt=0.0, rate=2.5)
            self.head.look(pan=-0.4, tilt=0.0, rate=2.5)
        self.head.look(pan=0.0, tilt=0.0)

    @command(effect="read")
    def see(self, what: What) -> bool:
        """Tell whether it has been seen in the last two seconds."""
        return bool(what in TAGS and self.head.see(tag=TAGS[what]).age < STALE)

    # -- gestures

    @command(effect="repeat")
    def wave(self, times: Times = 3, height: Share = 0.8) -> None:
        """Wave with the right hand, and let it hang again."""
        height = min(max(self.manner.number("height", height), 0.0), 1.0)
        up = {"j1": 0.25, "j2": 0.35 + 0.6 * height, "j4": 2.25, "j5": 0.0, "j6": 0.0}
        self.right.posture(**up, j3=0.2, speed=0.6)
        for _ in range(round(self.manner.number("times", times))):
            self.right.posture(**up, j3=0.65, speed=0.8)
            self.right.posture(**up, j3=0.0, speed=0.8)
        self.right.posture(**REST, speed=0.5)

    @command(effect="repeat")
    def bow(self, depth: Depth = 0.3) -> None:
        """Bow from the waist, and stand upright again."""
        depth = min(self.manner.number("depth", depth), 0.6)
        self.base.lean(angle=depth)
        self.head.look(pan=0.0, tilt=0.3)
        self.sleep(0.4)
        self.head.look(pan=0.0, tilt=0.0)
        self.base.lean(angle=0.0)

    @command(effect="repeat")
    def point_at(self, what: What) -> Hand:
        """Look at something and stretch an arm towards it; `rest` takes the arm down."""
        x, y, z = self.point_of(what)
        ahead, aside, _ = self.in_body(x, y, z)
        if abs(math.atan2(aside, ahead)) > 1.0:
            self.base.turn(heading=self.heading_to(x, y))
            ahead, aside, _ = self.in_body(x, y, z)
        self.look_towards(x, y, z)
        side, sign = ("left", 1.0) if aside >= 0.0 else ("right", -1.0)
        away = (ahead - SHOULDER[0], sign * aside - SHOULDER[1], z - SHOULDER[2])
        length = math.hypot(*away)
        outward = min(max(math.asin(away[1] / length), -0.5), 1.4)
        forward = min(max(math.atan2(away[0], -away[2]), 0.2), 2.2)
        self.hand(side).posture(j1=forward, j2=outward, j3=0.0, j4=0.12, j5=0.0, j6=0.0, speed=0.5)
        return side

    @command(effect="repeat")
    def rest(self) -> None:
        """Let the arms hang, stand upright and look ahead; a hand that holds something stays level."""
        for side in ("left", "right"):
            self.hand(side).posture(**(CARRY if self.holds(side) else REST), speed=BRISK)
        self.base.lean(angle=0.0)
        self.head.look(pan=0.0, tilt=0.0)

    # -- going about

    @command(effect="repeat", offline="queue")
    def go_to(self, place: Where, speed: Speed = 0.5) -> None:
        """Go to a place by its name."""
        there = PLACES[place]
        self.carry(self.base.drive, x=there.x, y=there.y, heading=there.heading, speed=self.pace(speed))
        self.here()

    @command(effect="repeat")
    def turn_to(self, what: What) -> None:
        """Turn the whole body to something."""
        x, y, _ = self.point_of(what)
        self.base.turn(heading=self.heading_to(x, y))

    @command
    def follow(self, who: Who, seconds: Seconds = 20.0, distance: Distance = 1.0) -> None:
        """Go after a person, at a distance, until the time is over."""
        distance, end = max(self.manner.number("distance", distance), 0.5), self.now() + seconds
        while self.now() < end:
            x, y, _ = self.point_of(who)
            here = self.here()
            away, heading = math.dist((x, y), (here.x, here.y)), self.heading_to(x, y)
            step = min(away - distance, 0.6)
            if step > 0.1:
                to = here.x + step * math.cos(heading), here.y + step * math.sin(heading)
                self.base.drive(x=to[0], y=to[1], heading=heading, speed=self.pace(0.5))
            elif abs(math.remainder(heading - here.heading, math.tau)) > 0.3:
                self.base.turn(heading=heading)
            self.look_at(who)
            self.sleep(0.3)

    @command
    def approach(self, who: Who, distance: Distance = 1.1) -> None:
        """Go to a person and stop at a distance, face to face."""
        distance = max(self.manner.number("distance", distance), 0.5)
        x, y, _ = self.point_of(who)
        here, heading = self.here(), self.heading_to(x, y)
        if abs(math.dist((x, y), (here.x, here.y)) - distance) > 0.1:
            at = x - distance * math.cos(heading), y - distance * math.sin(heading)
            self.carry(self.base.drive, x=at[0], y=at[1], heading=heading, speed=self.pace(0.5))
        else:
            self.base.turn(heading=heading)
        self.look_at(who)

    @command
    def charge(self, until: Share = 0.9) -> float:
        """Go to the charging place and stay until the battery is as full as asked for."""
        self.rest()
        self.go_to("dock")
        told = 0.0
        while (battery := float(self.here().battery)) < until:
            if battery >= told + 0.01:  # a percent takes half a minute
                told = battery
                self.progress(battery, "charging")
            self.sleep(2.0)
        return battery

    # -- hands

    @command(effect="repeat")
    def reach(self, x: X, y: Y, z: Z) -> Hand:
        """Bring a hand to a point of the flat, the one that is nearer; the base stays."""
        ahead, aside, _ = self.in_body(x, y, z)
        side: Hand = "left" if aside >= 0.0 else "right"
        self.hand(side).reach(x=ahead, y=aside, z=z, speed=BRISK)
        return side

    @command
    def take(self, what: Thing) -> Hand:
        """Go to a thing, take it, lift it, and step back."""
        side = self.empty_hand()
        hand, sign = self.hand(side), 1.0 if side == "left" else -1.0
        self.stand_before(what, sign)
        x, y, z = self.point_of(what)
        ahead, aside, _ = self.in_body(x, y, z)
        hand.grip(action="open")
        hand.reach(x=ahead - 0.12, y=aside, z=z + 0.02, hand="forward", speed=BRISK)
        hand.reach(x=ahead, y=aside, z=z + 0.01, hand="forward", speed=GENTLE)
        self.carried[side] = what  # also if the act is ended before the next line
        hand.grip(action="close")
        if not self.holds(side):
            del self.carried[side]
            hand.grip(action="open")
            hand.reach(x=ahead - 0.12, y=aside, z=z + 0.05, hand="forward", speed=GENTLE)
            self.step_back(0.35)
            raise self.failed(f"the {what} is not between the fingers; look where it is")
        self.moved[what] = "away", self.now()
        self.carry(hand.reach, x=ahead, y=aside, z=z + 0.12, hand="forward", speed=GENTLE)
        self.step_back(0.35)
        self.carry(hand.posture, **CARRY, speed=BRISK)
        return side

    @command
    def give(self, who: Who) -> None:
        """Offer what a hand holds, set it on the person's open palm, and let go once the palm carries it."""
        side = self.full_hand()
        hand, sign = self.hand(side), 1.0 if side == "left" else -1.0
        self.approach(who, 1.15)
        self.carry(hand.reach, x=AHEAD - 0.05, y=sign * (ASIDE + BESIDE), z=1.08, hand="forward", speed=BRISK)
        palm = self.palm_of(who)
        self.stand_at(palm[0], palm[1], sign, heading=self.heading_to(*self.point_of(who)[:2]))
        x, y, z = self.palm_of(who)
        ahead, aside, _ = self.in_body(x, y, z)
        cup = self.set_down(side, ahead, aside, z + 0.012)
        self.progress(0.9, "it stands on the palm")
        if self.holds(side):
            self.carried[side] = cup
            raise self.failed(f"{who} has not taken it; it is still in the {side} hand")
        self.moved[cup] = who, self.now()  # also if the act is ended before the next line
        hand.reach(x=ahead - 0.12, y=aside, z=z + 0.10, hand="forward", speed=GENTLE)
        self.step_back(0.25)
        hand.posture(**REST, speed=BRISK)
        if self.fell(cup):
            raise self.failed(f"{who} has let it fall")

    @command
    def put(self, place: Where = "table") -> None:
        """Put what a hand holds down on the table, away from all that stands there."""
        side = self.full_hand()
        hand, sign = self.hand(side), 1.0 if side == "left" else -1.0
        self.go_to(place)
        self.look_at(place)
        self.sleep(0.3)
        x, y, z = self.room_on(place)
        self.stand_at(x, y, sign, heading=PLACES[place].heading)
        ahead, aside, _ = self.in_body(x, y, z)
        self.carry(hand.reach, x=ahead - 0.10, y=aside, z=z + 0.20, hand="forward", speed=BRISK)
        self.moved[self.set_down(side, ahead, aside, 0.72)] = place, self.now()
        hand.reach(x=ahead - 0.12, y=aside, z=z + 0.10, hand="forward", speed=GENTLE)
        self.step_back(0.35)
        hand.posture(**REST, speed=BRISK)

    @command(effect="read")
    def holding(self) -> Literal["nothing", "left", "right", "both"]:
        """Tell which hands hold something."""
        held = [side for side in ("left", "right") if self.holds(side)]
        return "both" if len(held) == 2 else held[0] if held else "nothing"  # type: ignore[return-value]

    @command(effect="read")
    def where(self, what: Thing) -> str:
        """Tell where a thing is: left or right (hand), table, floor, who has it, away (else), or unseen."""
        for side, thing in self.carried.items():
            if thing == what and self.holds(side):
                return side
        left, when = self.moved.get(what, ("unseen", -math.inf))
        tag = self.head.see(tag=THINGS[what])
        if not tag.seen or tag.age > self.now() - when:
            return left
        if tag.z < LOW:
            return "floor"
        x, y, _ = PLACES["table"].at
        if math.dist((tag.x, tag.y), (x, y)) < NEAR:
            return "table"
        for who, number in PEOPLE.items():
            person = self.head.see(tag=number)
            if person.seen and math.dist((tag.x, tag.y), (person.x, person.y)) < NEAR:
                return who
        return "away"

    # -- what the actions are made of

    def hand(self, side: str) -> Any:
        """One of the arms."""
        return self.left if side == "left" else self.right

    def carry(self, movement: Any, **arguments: Any) -> None:
        """Carry out a movement; if meanwhile something slips out of a hand, it ends at once and says so."""
        under_way, missed = movement.start(**arguments), 0
        while True:
            try:
                under_way.result(GLANCE)
            except TimeoutError:
                lost = [side for side in self.carried if not self.holds(side)]
            else:
                return
            missed = missed + 1 if lost else 0
            if missed == 2:
                under_way.cancel()
                raise self.slipped(lost[0])

    def slipped(self, side: str) -> CommandFailed:
        """What to raise when a hand has lost what it carried."""
        return self.failed(f"the {self.carried.pop(side)} has slipped out of the {side} hand")

    def holds(self, side: str) -> bool:
        """Whether something is between the fingers of a hand."""
        info = self.hand(side).get_info()
        return bool(info.holding) and info.width > HOLDS

    def empty_hand(self) -> Hand:
        """The hand that is free, the left one first."""
        return "right" if self.holds("left") else "left"

    def full_hand(self) -> Hand:
        """The hand that holds something."""
        if self.holds("left"):
            return "left"
        if self.holds("right"):
            return "right"
        for side in self.carried:
            raise self.slipped(side)
        raise self.failed("both hands are empty; take something first")

    def fell(self, thing: str) -> bool:
        """Look whether a thing lies on the floor."""
        if thing not in TAGS:
            return False
        here = self.here()
        ahead = here.x + 0.9 * math.cos(here.heading), here.y + 0.9 * math.sin(here.heading)
        for height in (1.0, 0.1):
            self.look_towards(*ahead, height)
            self.sleep(0.3)
        tag = self.head.see(tag=TAGS[thing])
        return bool(tag.seen and tag.z < LOW)

    def room_on(self, place: PlaceName) -> tuple[float, float, float]:
        """Where a cup stands farthest from the others that were seen on a table [m, flat]."""
        x, y, z = PLACES[place].at
        tags = [self.head.see(tag=THINGS[thing]) for thing in THINGS if thing not in self.carried.values()]
        others = [(tag.x, tag.y) for tag in tags if tag.seen and tag.z > LOW]
        spots = [(x - INWARD, y + along) for along in ALONG]
        return *max(spots, key=lambda spot: min((math.dist(spot, at) for at in others), default=math.inf)), z

    def set_down(self, side: str, ahead: float, aside: float, top: float) -> str:
        """Lower a cup on what is `top` [m] high until that carries it, and let go; returns its name."""
        hand, grip = self.hand(side), 0.01
        rim = top + CUP / 2 + grip
        self.carry(hand.reach, x=ahead, y=aside, z=rim + 0.05, hand="forward", speed=GENTLE)
        weight = hand.get_info().fz
        for lower in (0.004, 0.0, -0.004, -0.008, -0.012):
            hand.reach(x=ahead, y=aside, z=rim + lower, hand="forward", speed=0.05)
            if hand.get_info().fz - weight > 1.2:
                hand.grip(action="open")
                return self.carried.pop(side, "")
        raise self.failed("nothing carries it; it is still in the hand")

    def palm_of(self, who: str) -> tuple[float, float, float]:
        """Wait until a person holds out the hand, and tell where it is [m, flat]."""
        for _ in range(20):
            self.look_at(who)
            x, y, z = self.point_of(who)
            self.look_towards(x, y, z - 0.25)
            self.sleep(0.25)
            palm = self.head.see(tag=TAGS[who.lower()] + PALM)
            if palm.seen and palm.age < 0.5:
                return palm.x, palm.y, palm.z
        raise self.failed(f"{who} holds out no hand")

    def stand_before(self, what: str, sign: float) -> None:
        """Stand so that a thing on the table is where a hand works best."""
        x, y, _ = self.point_of(what)
        self.stand_at(x, y, sign, heading=PLACES["table"].heading)
        self.look_at(what)
        self.sleep(0.3)

    def stand_at(self, x: float, y: float, sign: float, heading: float) -> None:
        """Drive so that a point of the flat is before the left (1) or the right (-1) hand."""
        c, s = math.cos(heading), math.sin(heading)
        aside = sign * ASIDE
        at = x - c * AHEAD + s * aside, y - s * AHEAD - c * aside
        self.carry(self.base.drive, x=at[0], y=at[1], heading=heading, speed=min(self.pace(0.5), 0.3))

    def step_back(self, length: float) -> None:
        """Drive backward."""
        heading = self.here().heading
        self.carry(self.base.move, x=-length * math.cos(heading), y=-length * math.sin(heading), speed=0.25)

    def pace(self, speed: float) -> float:
        """The speed of the role, within its limit [m/s]."""
        return min(max(self.manner.number("speed", speed), 0.05), 0.8)

    def look_towards(self, x: float, y: float, z: float) -> None:
        """Turn the head to a point of the flat [m]."""
        ahead, aside, _ = self.in_body(x, y, z)
        pan = min(max(math.atan2(aside, ahead), -1.6), 1.6)
        tilt = min(max(math.atan2(EYES - z, math.hypot(ahead, aside)), -0.5), 0.75)
        self.head.look(pan=pan, tilt=tilt)

    def in_body(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A point of the flat in the body's frame [m]."""
        here = self.here()
        dx, dy = x - here.x, y - here.y
        c, s = math.cos(here.heading), math.sin(here.heading)
        return c * dx + s * dy, c * dy - s * dx, z

    def here(self) -> Any:
        """What the base tells of itself: its place, its heading, its battery."""
        info = self.base.get_info()
        self.battery = float(info.battery)
        return info

    def heading_to(self, x: float, y: float) -> float:
        """[rad] from the base to a point of the flat."""
        here = self.here()
        return math.atan2(y - here.y, x - here.x)

    def point_of(self, what: str) -> tuple[float, float, float]:
        """Where something is [m, flat]: a place by the table, a tag as it was seen last."""
        if what in PLACES:
            return PLACES[what].at
        what = what.lower()
        if what not in TAGS:
            raise self.failed(f"nothing is called {what!r}; known: {', '.join([*PLACES, *TAGS])}")
        tag = self.head.see(tag=TAGS[what])
        if not tag.seen:
            raise self.failed(f"{what} was not seen yet; look around, or go where it is")
        return tag.x, tag.y, tag.z

    def failed(self, why: str) -> CommandFailed:
        """What to raise when the running command cannot go on."""
        return CommandFailed(robot=self.name, command=self.context.command, detail=why)
