"""The companion in its flat: compiled, put in its first place, and everything that acts in it.

World frame W: the middle of the floor, x forward, y left, z up.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from robotree.protocol.messages import (
    BaseState,
    Joints,
    LocalPositionNed,
    Message,
    NamedValueFloat,
    Speech,
    Tags,
)
from robotree.sim.arm.world import hand_streams, padded
from robotree.sim.companion.battery import Battery
from robotree.sim.companion.body import Body
from robotree.sim.companion.figure import ARMS, SIDES
from robotree.sim.companion.flat import (
    CUP_MASS,
    CUPS,
    DOCK,
    OUTSIDE,
    PREFIX,
    START,
    TAG_UP,
    VISITORS,
    BodyPorts,
    bind,
    spec,
)
from robotree.sim.companion.guard import GRAVITY, Person
from robotree.sim.companion.limb import Limb
from robotree.sim.companion.planner import REST
from robotree.sim.companion.visitors import EVENING, Notice, Play, Visitor
from robotree.sim.firmware import Gauges
from robotree.sim.firmware.telemetry import HOT, WARM, Stream
from robotree.sim.physics.cell import Cell
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

FINGERS_AT_FIRST: Final = 0.03
"""[m] slide of each finger."""
LIVELY: Final = 0.02
"""[s] between two looks of the visitors."""
SEE_EVERY: Final = 0.1
"""[s] between two looks of the cameras for tags."""
FAR, NARROW = 5.0, (0.65, 0.50)
"""[m] and tangents, to the side and up, of what the cameras can read a tag in."""
HIDDEN: Final = 0.2
"""[m] by which something must be nearer than a tag to hide it: a tag lies on a body."""
AT_DOCK: Final = 0.15
"""[m] from the charging place."""


class Sight(NamedTuple):
    """A tag that was seen: where [m, W], and when, in the world's time [s]."""

    at: tuple[float, float, float]
    seen: float


class Heard(NamedTuple):
    """Something that a visitor said: its number, whose tag, the text, and when [ms]."""

    number: int
    speaker: int
    text: str
    at: int


class Flat:
    """The actors of the flat before each step: the robot, the visitors, the battery, the cameras' eyes."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, plays: Sequence[Play]) -> None:
        self._model, self._data = model, data
        self._ports = bind(model, data)
        self.visitors = tuple(
            Visitor(looks, OUTSIDE[0] - 0.9 * i, OUTSIDE[1]) for i, looks in enumerate(VISITORS)
        )
        for visitor, play in zip(self.visitors, plays, strict=False):
            visitor.perform(play)
        self.spoken: list[str] = []
        """The sentences that the robot has said aloud."""
        self.heard = Heard(0, 0, "", 0)
        """The latest that a visitor said."""
        self.battery = Battery()
        self.body = Body(self._ports, self.people, self.spoken.append, len(VISITORS), self.battery)
        self.sights: dict[int, Sight] = {}
        """The sights of the cameras, by tag."""
        self._time = self._lively_in = self._see_in = 0.0
        self._bind()
        self._draw()

    @property
    def now(self) -> float:
        """The world's time [s]."""
        return self._time

    def people(self) -> Sequence[Person]:
        """The people and their places."""
        return [Person(each.looks.name, (each.x, each.y), each.looks.height) for each in self.visitors]

    def cup(self, tag: int) -> Vector:
        """(3,) where the middle of a cup is [m, W]."""
        return np.array(self._data.xpos[self._cup_bodies[tag]])

    def control(self, dt: float) -> None:
        """One step [s] of everything."""
        self._time += dt
        self.body.control(dt)
        self._lively_in -= dt
        if self._lively_in <= 0.0:
            self._lively_in = LIVELY
            self._live()
        self._see_in -= dt
        if self._see_in <= 0.0:
            self._see_in = SEE_EVERY
            self._see()

    # -- inside

    def _bind(self) -> None:
        model = self._model
        self._cup_bodies = {cup.tag: model.body(f"cup_{cup.tag}").id for cup in CUPS}
        self._cup_of = {model.geom(f"cup_{cup.tag}").id: cup.tag for cup in CUPS}
        self._palm_of = {model.geom(f"{each.name}_hand").id: i for i, each in enumerate(VISITORS)}
        names = [f"{PREFIX}{side}_pad_{end}" for side in SIDES for end in "lr"]
        self._pads = {model.geom(name).id for name in names}
        self._mocaps = [
            (int(model.body(each.name).mocapid[0]), int(model.body(f"{each.name}_hand").mocapid[0]))
            for each in VISITORS
        ]
        self._grasps = {
            (i, cup.tag): model.equality(f"{each.name}_holds_{cup.tag}").id
            for i, each in enumerate(VISITORS)
            for cup in CUPS
        }
        self._tools = [model.site(f"{PREFIX}{side}_tcp").id for side in SIDES]
        self._eye = model.camera(PREFIX + "eye_left").id
        self._head = model.body(PREFIX + "head").id
        self._touched_by_fingers: frozenset[int] = frozenset()
        self._palms: dict[int, tuple[float, int]] = {}

    def _live(self) -> None:
        """The visitors go on, and the battery."""
        self._feel()
        place, base = self.body.place, self.body.base.look()
        still = not self.body.base.moving and float(np.abs(base.rate).max()) < 0.05
        hands = [_point(self._data.site_xpos[tool]) for tool in self._tools]
        cups = {tag: _point(self.cup(tag)) for tag in self._cup_bodies}
        for i, visitor in enumerate(self.visitors):
            felt = self._palms.get(i, (0.0, 0))
            before = visitor.holding
            alone = not any(each.inside for each in self.visitors if each is not visitor)
            spoken, held = len(self.spoken), self._touched_by_fingers
            seen = Notice((place.x, place.y), still, spoken, cups, held, hands, alone, felt)
            visitor.advance(LIVELY, seen)
            if visitor.holding and not before:
                self._grasp(i, visitor.holding)
            while visitor.words:
                text = visitor.words.pop(0)
                number = self.heard.number + 1
                self.heard = Heard(number, visitor.looks.tag, text, round(1000 * self._time))
        self._draw()
        docked = math.dist((place.x, place.y), DOCK) < AT_DOCK and still
        effort = float(np.abs(self._data.actuator_force * self._data.actuator_velocity).sum())
        self.battery.advance(LIVELY, effort, docked=docked)

    def _feel(self) -> None:
        """Note the things on the visitors' palms, and those that the robot's fingers touch."""
        data, touched = self._data, set[int]()
        self._palms = {}
        force = np.zeros(6)
        pairs = data.contact.geom
        for i in range(data.ncon):
            a, b = int(pairs[i, 0]), int(pairs[i, 1])
            tag = self._cup_of.get(a) or self._cup_of.get(b)
            if tag is None:
                continue
            other = b if a in self._cup_of else a
            if other in self._pads:
                touched.add(tag)
            elif (palm := self._palm_of.get(other)) is not None:
                mujoco.mj_contactForce(self._model, data, i, force)
                share = float(force[0]) / (CUP_MASS * GRAVITY)
                self._palms[palm] = (self._palms.get(palm, (0.0, 0))[0] + share, tag)
        self._touched_by_fingers = frozenset(touched)

    def _grasp(self, visitor: int, tag: int) -> None:
        """Fix a cup in a visitor's hand, where it stands on the palm now."""
        weld = self._grasps[visitor, tag]
        hand = self._data.body(f"{VISITORS[visitor].name}_hand")
        cup = self._data.body(f"cup_{tag}")
        inverse, turned, moved = np.zeros(4), np.zeros(4), np.zeros(3)
        mujoco.mju_negQuat(inverse, hand.xquat)
        mujoco.mju_mulQuat(turned, inverse, cup.xquat)
        mujoco.mju_rotVecQuat(moved, cup.xpos - hand.xpos, inverse)
        self._model.eq_data[weld, 0:3] = 0.0
        self._model.eq_data[weld, 3:6] = moved
        self._model.eq_data[weld, 6:10] = turned
        self._data.eq_active[weld] = 1

    def _draw(self) -> None:
        """Put the visitors' figures where they are."""
        data = self._data
        for visitor, (body, hand) in zip(self.visitors, self._mocaps, strict=True):
            data.mocap_pos[body] = visitor.x, visitor.y, 0.0
            turned = math.cos(visitor.heading / 2), 0.0, 0.0, math.sin(visitor.heading / 2)
            data.mocap_quat[body] = data.mocap_quat[hand] = turned
            data.mocap_pos[hand] = visitor.hand

    def _tags(self) -> Mapping[int, tuple[float, float, float]]:
        """Where every tag really is: on cups, on visitors' chests, and on hands that are held out."""
        tags: dict[int, tuple[float, float, float]] = {}
        for tag in self._cup_bodies:
            tags[tag] = _point(self.cup(tag))
        for visitor in self.visitors:
            tags[visitor.looks.tag] = (visitor.x, visitor.y, TAG_UP * visitor.looks.height)
            if visitor.offers:
                tags[visitor.looks.tag + 10] = visitor.hand
        return tags

    def _see(self) -> None:
        """Note the tags that the cameras see now."""
        eye = np.array(self._data.cam_xpos[self._eye])
        axes = self._data.cam_xmat[self._eye].reshape(3, 3)
        tags = self._tags()
        for tag in [each for each in self.sights if each not in tags]:
            del self.sights[tag]  # a hand that is no longer held out is none
        for tag, at in tags.items():
            right, up, back = (axes.T @ (np.array(at) - eye)).tolist()
            ahead = -back
            if not 0.1 < ahead < FAR or abs(right) > NARROW[0] * ahead or abs(up) > NARROW[1] * ahead:
                continue
            if self._sees(eye, np.array(at)):
                self.sights[tag] = Sight(at, self._time)

    def _sees(self, eye: Vector, at: Vector) -> bool:
        ray = at - eye
        length = float(np.linalg.norm(ray))
        geom = np.zeros(1, np.int32)
        hit = mujoco.mj_ray(self._model, self._data, eye, ray / length, None, 1, self._head, geom, None)
        return hit < 0.0 or hit > length - HIDDEN


@dataclass(frozen=True, slots=True)
class CompanionWorld:
    """The companion in its flat."""

    cell: Cell
    flat: Flat
    ports: BodyPorts
    gauges: Gauges

    @property
    def body(self) -> Body:
        """The robot."""
        return self.flat.body


def build(plays: Sequence[Play] = EVENING, start: tuple[float, float, float] = START) -> CompanionWorld:
    """Build the flat: the companion at its charging place, the cups on the table, the visitors outside.

    Args:
        plays: what the visitors do; none: they stay outside.
        start: x, y [m] and heading [rad] of the companion.
    """
    model = spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ports = bind(model, data)
    x, y, heading = start
    ports.root[:] = x, y, 0.0, math.cos(heading / 2), 0.0, 0.0, math.sin(heading / 2)
    for arm in ARMS:
        ports.qpos[ports.at[arm]] = REST
    for side in SIDES:
        for end in "lr":
            data.qpos[model.joint(f"{PREFIX}{side}_slide_{end}").qposadr[0]] = FINGERS_AT_FIRST
    for hand in ports.hands:
        hand.finger_target[:] = FINGERS_AT_FIRST
    mujoco.mj_forward(model, data)
    flat = Flat(model, data, plays)
    return CompanionWorld(Cell(model, data, flat), flat, ports, Gauges(flat.battery))


def _point(at: Vector) -> tuple[float, float, float]:
    x, y, z = at.tolist()
    return x, y, z


TOLD_AGAIN: Final = 500
"""[ms] between two repetitions of the latest that was heard."""
PLACES: Final = 12
"""Tags in one message."""
LONGEST_AGO: Final = 0xFFFF


def limb_streams(limb: Limb) -> tuple[Stream, ...]:
    """Those of its hand, in B; `peak_f` (N) less often."""

    def values(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        return (NamedValueFloat(now, "peak_f", limb.state().peak_force),)

    return (*hand_streams(limb), Stream(NamedValueFloat, WARM, values))


def head_streams(world: CompanionWorld) -> tuple[Stream, ...]:
    """JOINTS of the neck often; TAGS that were seen and the latest SPEECH that was heard less so."""
    flat = world.flat

    def joints(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        return (Joints(time_boot_ms=now, position=padded(flat.body.head.q), count=2),)

    def tags(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        seen = sorted(flat.sights.items(), key=lambda each: -each[1].seen)[:PLACES]
        blank = (0.0,) * (PLACES - len(seen))
        x, y, z = ((*(sight.at[axis] for _, sight in seen), *blank) for axis in range(3))
        ages = [min(round(100 * (flat.now - sight.seen)), LONGEST_AGO) for _, sight in seen]
        none = (0,) * (PLACES - len(seen))
        return (Tags(now, x, y, z, (*ages, *none), bytes((*(tag for tag, _ in seen), *none)), len(seen)),)

    def heard(_: int, __: bool) -> Sequence[Message]:  # noqa: FBT001
        latest = flat.heard
        return (Speech(latest.at, latest.number, 0, 0, latest.speaker, latest.text),) if latest.number else ()

    return (
        Stream(Joints, HOT, joints),
        Stream(Tags, WARM, tags),
        Stream(Speech, TOLD_AGAIN, heard),
    )


def base_streams(world: CompanionWorld) -> tuple[Stream, ...]:
    """LOCAL_POSITION_NED and BASE often; SYS_STATUS, which every controller sends, has the battery."""
    flat = world.flat

    def pose(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        look = flat.body.base.look()
        (x, y, _heading), (vx, vy, _turning) = look.place.tolist(), look.rate.tolist()
        return (LocalPositionNed(now, x, -y, 0.0, vx, -vy, 0.0),)

    def base(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        look, body = flat.body.base.look(), flat.body
        x, y, heading = look.place.tolist()
        vx, vy, turning = look.rate.tolist()
        charging = int(flat.battery.charging)
        nearest = min(body.nearest, 100.0)
        return (BaseState(now, x, y, heading, vx, vy, turning, look.lean, body.balance(), nearest, charging),)

    return (Stream(LocalPositionNed, HOT, pose), Stream(BaseState, WARM, base))
