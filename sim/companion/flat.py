"""The flat: walls, a table with cups, a shelf, a charging place, and visitors, as MuJoCo reads them.

World frame W: the middle of the floor, x forward, y left, z up [m]. What stands here is written once, as
data: the scenery is built from it, the robot's map of the flat is made of it, and tests read it.

The companion's ports in the compiled flat are views into the live `MjData`: reading is measuring, writing is
commanding.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from robotree.sim.arm.model import HandPorts, bind_hand
from robotree.sim.companion.figure import JOINT_NAMES, SIDES, XML
from robotree.sim.physics import scenery
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.scenery import PREFIX as MARKER
from robotree.sim.physics.vectors import Vector

PREFIX: Final = "companion/"


class Box(NamedTuple):
    """A piece of furniture: its middle and half its sides [m, W], and its colour."""

    name: str
    at: tuple[float, float, float]
    half: tuple[float, float, float]
    rgba: tuple[float, float, float, float]


_WOOD: Final = (0.80, 0.68, 0.52, 1.0)
_PAINT: Final = (0.86, 0.84, 0.80, 1.0)
_CLOTH: Final = (0.36, 0.50, 0.62, 1.0)
_STEEL: Final = (0.42, 0.45, 0.50, 1.0)

ROOM: Final = (-3.0, 3.0, -2.4, 2.4)
"""[m] of the floor between the walls: least x, greatest x, least y, greatest y."""
TABLE_TOP: Final = 0.72
"""[m] height."""
TABLE: Final = Box("table", (1.75, 0.9, TABLE_TOP - 0.02), (0.40, 0.60, 0.02), _WOOD)
FURNITURE: Final = (
    TABLE,
    *(
        Box(f"table_leg_{i}", (1.75 + 0.34 * x, 0.9 + 0.54 * y, 0.34), (0.025, 0.025, 0.34), _STEEL)
        for i, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1)))
    ),
    Box("shelf", (2.80, -1.2, 0.55), (0.16, 0.60, 0.55), _PAINT),
    Box("sofa", (0.9, -2.0, 0.22), (0.85, 0.35, 0.22), _CLOTH),
    Box("sofa_back", (0.9, -2.28, 0.45), (0.85, 0.09, 0.45), _CLOTH),
)
WALLS: Final = (
    Box("wall_east", (3.05, 0.0, 0.5), (0.05, 2.5, 0.5), _PAINT),
    Box("wall_north", (0.0, 2.45, 0.5), (3.1, 0.05, 0.5), _PAINT),
    Box("wall_west", (-3.05, 0.6, 0.1), (0.05, 1.8, 0.1), _PAINT),
    Box("wall_south", (0.0, -2.45, 0.1), (3.1, 0.05, 0.1), _PAINT),
)
DOCK: Final = (-2.45, 1.8)
"""[m] x, y of the charging place."""
DOOR: Final = (-2.8, -1.6)
"""[m] where visitors come in."""
START: Final = (-2.45, 1.8, 0.0)
"""x, y [m] and heading [rad] where the companion is switched on: at its charging place."""


@dataclass(frozen=True, slots=True)
class Cup:
    """A cup: its `tag`, and where it stands at first [m]."""

    tag: int
    at: tuple[float, float]


CUP_RADIUS, CUP_HEIGHT, CUP_MASS = 0.031, 0.11, 0.18
"""[m, m, kg] of each cup, filled."""
CUPS: Final = (Cup(1, (1.48, 0.60)), Cup(2, (1.48, 0.90)), Cup(3, (1.48, 1.20)))
CUP_COLOURS: Final = ((0.85, 0.20, 0.18, 1.0), (0.20, 0.55, 0.30, 1.0), (0.20, 0.35, 0.75, 1.0))


@dataclass(frozen=True, slots=True)
class Figurine:
    """A visitor's looks: its `tag`, `name`, `height` [m], and the colour of its clothes."""

    tag: int
    name: str
    height: float
    rgba: tuple[float, float, float, float]


VISITORS: Final = (
    Figurine(11, "anna", 1.68, (0.78, 0.30, 0.36, 1.0)),
    Figurine(12, "bela", 1.82, (0.28, 0.40, 0.62, 1.0)),
    Figurine(13, "cleo", 1.25, (0.90, 0.66, 0.20, 1.0)),
)
OUTSIDE: Final = (-4.2, -1.6)
"""[m] where visitors wait before they come in, one behind the other."""
WAIST: Final = 0.13
"""[m] radius of a visitor."""
PALM: Final = 0.055
"""[m] radius of a visitor's open hand."""
TAG_UP: Final = 0.68
"""Share of a visitor's height at which the middle of the tag is worn."""
CUP_TAG, BODY_TAG, TAG_THICK = 0.042, 0.07, 0.002
"""[m] half the side of a printed tag on a cup and on a chest, and half of its thickness."""
_SKIN: Final = (0.92, 0.76, 0.64, 1.0)


def spec() -> mujoco.MjSpec:
    """The flat with everything in it."""
    cell = scenery.floor(height=0.0)
    cell.option.timestep = 0.002
    for box in (*FURNITURE, *WALLS):
        scenery.box(cell, box.name, box.at, box.half, box.rgba)
    scenery.box(cell, "dock", (*DOCK, 0.001), (0.28, 0.28, 0.001), (0.20, 0.60, 0.42, 1.0))
    cell.geom("dock").contype = cell.geom("dock").conaffinity = 0
    companion = mujoco.MjSpec.from_file(str(XML))
    companion.body("base").add_freejoint(name="root")
    scenery.attach(cell, companion, PREFIX, (0.0, 0.0, 0.0))
    for cup, colour in zip(CUPS, CUP_COLOURS, strict=True):
        _cup(cell, cup, colour)
    for place, figurine in enumerate(VISITORS):
        _visitor(cell, place, figurine)
    scenery.camera(cell, eye=(-2.9, -3.6, 3.3), target=(0.15, 0.2, 0.35), fovy=52.0)
    return cell


def _cup(cell: mujoco.MjSpec, cup: Cup, colour: tuple[float, float, float, float]) -> None:
    body = cell.worldbody.add_body(name=f"cup_{cup.tag}", pos=(*cup.at, TABLE_TOP + CUP_HEIGHT / 2))
    body.add_freejoint(name=f"cup_{cup.tag}")
    body.add_geom(
        name=f"cup_{cup.tag}",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(CUP_RADIUS, CUP_HEIGHT / 2, 0),
        mass=CUP_MASS,
        condim=4,
        friction=(0.9, 0.01, 0.001),
        solref=(0.008, 1),
        rgba=colour,
    )
    body.add_geom(
        name=f"cup_{cup.tag}_band",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(CUP_RADIUS + 0.0006, 0.012, 0),
        pos=(0, 0, CUP_HEIGHT / 2 - 0.014),
        contype=0,
        conaffinity=0,
        mass=0,
        group=2,
        rgba=(0.97, 0.97, 0.95, 1),
    )
    # Towards the robot when it stands before the table.
    _tag(body, cup.tag, (-CUP_RADIUS - TAG_THICK, 0.0, -0.008), CUP_TAG, quat=(0.0, 0.0, 0.0, 1.0))


def _tag(
    body: mujoco.MjsBody,
    number: int,
    at: tuple[float, float, float],
    half: float,
    quat: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
) -> None:
    """A plate with a marker, towards x of the body unless turned; it weighs nothing and touches nothing."""
    body.add_geom(
        name=f"{MARKER}{number}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=at,
        quat=quat,
        size=(TAG_THICK, half, half),
        contype=0,
        conaffinity=0,
        mass=0,
        group=2,
        rgba=(0.98, 0.98, 0.98, 1),
    )


def _visitor(cell: mujoco.MjSpec, place: int, figurine: Figurine) -> None:
    """A person as a moved figure, and apart from it the open hand that it holds out."""
    tall, capsule = figurine.height, mujoco.mjtGeom.mjGEOM_CAPSULE
    at = (OUTSIDE[0] - 0.9 * place, OUTSIDE[1], 0.0)
    body = cell.worldbody.add_body(name=figurine.name, pos=at, mocap=True)
    for name, side in (("l", 0.07), ("r", -0.07)):
        body.add_geom(
            name=f"{figurine.name}_leg_{name}",
            type=capsule,
            fromto=(0, side, 0.06, 0, side, 0.48 * tall),
            size=(0.055, 0, 0),
            rgba=(0.25, 0.27, 0.33, 1),
        )
    body.add_geom(
        name=f"{figurine.name}_body",
        type=capsule,
        fromto=(0, 0, 0.52 * tall, 0, 0, 0.76 * tall),
        size=(WAIST, 0, 0),
        rgba=figurine.rgba,
    )
    body.add_geom(
        name=f"{figurine.name}_head",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=(0, 0, 0.925 * tall),
        size=(0.072 * tall, 0, 0),
        rgba=_SKIN,
    )
    _tag(body, figurine.tag, (WAIST + TAG_THICK, 0.0, TAG_UP * tall), BODY_TAG)
    hand = cell.worldbody.add_body(name=f"{figurine.name}_hand", pos=(at[0], at[1], 0.5 * tall), mocap=True)
    hand.add_geom(
        name=f"{figurine.name}_hand",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=(PALM, 0.012, 0),
        condim=4,
        friction=(1.0, 0.01, 0.001),
        solref=(0.010, 1),
        rgba=_SKIN,
    )
    for cup in CUPS:
        cell.add_equality(
            name=f"{figurine.name}_holds_{cup.tag}",
            type=mujoco.mjtEq.mjEQ_WELD,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            name1=f"{figurine.name}_hand",
            name2=f"cup_{cup.tag}",
            active=False,
            solref=(0.02, 1),
        )


@dataclass(frozen=True, slots=True)
class BodyPorts:
    """Of the whole body.

    Attributes:
        qpos: of the flat; `at` (15,) are the places of the figure's joints in it.
        qvel: likewise, `rate_at` (15,).
        root: (7,) position [m] and quaternion w, x, y, z of the base in W.
        root_rate: (6,) its linear velocity in W [m/s], angular in B [rad/s].
        drive: (3,) force along x, y of B [N] and torque about z [N m] asked for.
        waist: (1,) torque asked for [N m].
        neck: (2,) torques asked for [N m].
        hands: left and right.
    """

    qpos: Vector
    at: NDArray[np.intp]
    qvel: Vector
    rate_at: NDArray[np.intp]
    root: Vector
    root_rate: Vector
    drive: Vector
    waist: Vector
    neck: Vector
    hands: tuple[HandPorts, HandPorts]


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> BodyPorts:
    """Find the ports; `data` must be forwarded once, with the fingers centred."""

    def control(name: str, count: int) -> Vector:
        first = int(model.actuator_ctrladr[model.actuator(prefix + name).id])
        return data.ctrl[first : first + count]

    joints = [model.joint(prefix + name) for name in JOINT_NAMES]
    root = model.joint(prefix + "root")
    place, rate = int(root.qposadr[0]), int(root.dofadr[0])
    left, right = (bind_hand(model, data, f"{prefix}{side}_") for side in SIDES)
    return BodyPorts(
        qpos=data.qpos,
        at=np.array([int(joint.qposadr[0]) for joint in joints]),
        qvel=data.qvel,
        rate_at=np.array([int(joint.dofadr[0]) for joint in joints]),
        root=data.qpos[place : place + 7],
        root_rate=data.qvel[rate : rate + 6],
        drive=control("drive_x", 3),
        waist=control("lean", 1),
        neck=control("pan", 2),
        hands=(left, right),
    )
