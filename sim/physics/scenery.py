"""The things around the devices: floor, light, boxes, cameras, markers, as MuJoCo reads them.

World frame W: x forward, y left, z up; each robot's `world` says where its origin is.

Cameras recognise square markers of ArUco's original dictionary. A marker is a black frame around five rows of
five modules. Each row is a word of a Hamming code that stands for two bits of the marker's number, the most
significant first (Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial
markers under occlusion", 2014; OpenCV's `DICT_ARUCO_ORIGINAL`).
"""

import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from robotree.sim.physics.engine import mujoco

_FLOOR: Final = (0.70, 0.73, 0.77, 1.0)


def floor(height: float) -> mujoco.MjSpec:
    """An empty cell: physics options, a floor at `height` [m], one light."""
    cell = mujoco.MjSpec()
    cell.option.timestep = 0.001
    cell.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    cell.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    cell.option.impratio = 10
    cell.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, pos=(0, 0, height), size=(0, 0, 0.05), rgba=_FLOOR
    )
    cell.worldbody.add_light(name="lamp", pos=(1.0, -1.6, 2.6), dir=(-0.30, 0.55, -1.0))
    return cell


def box(
    cell: mujoco.MjSpec,
    name: str,
    at: tuple[float, float, float],
    half: tuple[float, float, float],
    rgba: tuple[float, float, float, float],
) -> None:
    """Put a box, with its middle `at` [m, W] and `half` its sides [m]."""
    cell.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=at, size=half, rgba=rgba)


def attach(cell: mujoco.MjSpec, device: mujoco.MjSpec, prefix: str, at: tuple[float, float, float]) -> None:
    """Put a device with its foot `at` [m, W]; its names begin with `prefix`."""
    cell.attach(device, prefix=prefix, frame=cell.worldbody.add_frame(pos=at))


def camera(
    cell: mujoco.MjSpec, eye: tuple[float, float, float], target: tuple[float, float, float], fovy: float
) -> None:
    """Look from `eye` at `target` [m, W], horizon level; `fovy` is the vertical field of view [deg]."""
    back = tuple(e - t for e, t in zip(eye, target, strict=True))
    right = (-back[1], back[0], 0.0)
    up = (
        back[1] * right[2] - back[2] * right[1],
        back[2] * right[0] - back[0] * right[2],
        back[0] * right[1] - back[1] * right[0],
    )
    flat, length = math.hypot(*right), math.hypot(*up)
    placed = cell.worldbody.add_camera(name="cell", pos=eye, fovy=fovy)
    placed.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    placed.alt.xyaxes = [c / flat for c in right] + [c / length for c in up]


Modules: TypeAlias = NDArray[np.bool_]
NUMBERS: Final = 1024
"""Markers of the dictionary, from 0 on."""
PREFIX: Final = "tag_"
"""A geom of this name and a number shows that marker on its side towards its x, upright along its z."""
ACROSS: Final = 9
"""Modules across a printed marker: five, the black frame, and the white rim that a detector needs."""
MARKED: Final = 7 / ACROSS
"""Share of a plate's side that the marker takes; the rest is rim."""
_WORDS: Final = ("10000", "10111", "01001", "01110")


def printed(number: int) -> Modules:
    """(9, 9) whether each module is white, from the upper left one on.

    Raises:
        ValueError: there is no such marker.
    """
    if not 0 <= number < NUMBERS:
        raise ValueError(f"there is no marker {number}; there are 0 to {NUMBERS - 1}")
    white = np.ones((ACROSS, ACROSS), np.bool_)
    white[1:-1, 1:-1] = False
    for row in range(5):
        word = _WORDS[number >> 2 * (4 - row) & 3]
        white[2 + row, 2:-2] = [bit == "1" for bit in word]
    return white


def number_of(name: str) -> int | None:
    """The marker that a geom of this name shows; None: it shows none."""
    digits = name.removeprefix(PREFIX)
    return int(digits) if digits != name and digits.isdigit() else None
