"""What stands around the devices: floor, table, light, cameras; and the two cells composed from it.

World frame W: x forward, y left, z up. In the arm's cell its origin is the arm's foot on the table top, in
the rover's cell the middle of the floor.
"""

import math
from typing import Final

from robotree.sim.engine import mujoco
from robotree.sim.models import arm, lever, rover

LEVER_FOOT: Final = (0.42, 0.045, 0.0)
"""[m] in W: where the lever's stand is bolted to the table."""
TABLE_HEIGHT: Final = 0.72
"""[m] of the table top above the floor."""
ARENA: Final = 1.5
"""[m] the rover's centre may go this far from the origin along x and y."""
CRATE: Final = (0.80, -0.90)
"""[m] x, y of a crate in the rover's arena."""

_WOOD: Final = (0.80, 0.68, 0.52, 1.0)
_STEEL: Final = (0.42, 0.45, 0.50, 1.0)
_FLOOR: Final = (0.70, 0.73, 0.77, 1.0)
_WALL: Final = (0.33, 0.37, 0.44, 1.0)
_CRATE: Final = (0.85, 0.58, 0.20, 1.0)
_BIN: Final = (0.20, 0.42, 0.66, 1.0)
_DOCK: Final = (0.20, 0.60, 0.42, 1.0)


def arm_cell() -> mujoco.MjSpec:
    """A table with the arm, and the lever within its reach."""
    cell = _floor(height=-TABLE_HEIGHT)
    _table(cell)
    _attach(cell, arm.spec(), arm.PREFIX, (0.0, 0.0, 0.0))
    _attach(cell, lever.spec(), lever.PREFIX, LEVER_FOOT)
    _camera(cell, eye=(1.42, -1.22, 0.80), target=(0.17, 0.03, 0.27), fovy=36.0)
    return cell


def rover_cell() -> mujoco.MjSpec:
    """A walled floor with the rover in the middle and a crate."""
    cell = _floor(height=0.0)
    reach = ARENA + 0.2
    for name, x, y in (("east", 1, 0), ("west", -1, 0), ("north", 0, 1), ("south", 0, -1)):
        _box(
            cell,
            f"wall_{name}",
            (x * reach, y * reach, 0.06),
            (0.02 if x else reach, 0.02 if y else reach, 0.06),
            _WALL,
        )
    _box(cell, "crate", (*CRATE, 0.12), (0.14, 0.14, 0.12), _CRATE)
    _box(cell, "bin", (-0.95, 1.05, 0.16), (0.18, 0.12, 0.16), _BIN)
    _box(cell, "dock", (0.0, 0.0, 0.001), (0.19, 0.19, 0.001), _DOCK)
    _attach(cell, rover.spec(), rover.PREFIX, (0.0, 0.0, 0.0))
    _camera(cell, eye=(-2.3, -2.3, 2.1), target=(0.05, 0.05, -0.12), fovy=42.0)
    return cell


def _floor(height: float) -> mujoco.MjSpec:
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


def _table(cell: mujoco.MjSpec) -> None:
    _box(cell, "table", (0.26, 0.0, -0.02), (0.52, 0.48, 0.02), _WOOD)
    _box(cell, "apron", (0.26, 0.0, -0.065), (0.47, 0.43, 0.025), _STEEL)
    for name, x, y in (("fl", 1, 1), ("fr", 1, -1), ("rl", -1, 1), ("rr", -1, -1)):
        half = (TABLE_HEIGHT - 0.04) / 2
        _box(cell, f"leg_{name}", (0.26 + 0.45 * x, 0.41 * y, -0.04 - half), (0.03, 0.03, half), _STEEL)


def _box(
    cell: mujoco.MjSpec,
    name: str,
    at: tuple[float, float, float],
    half: tuple[float, float, float],
    rgba: tuple[float, float, float, float],
) -> None:
    cell.worldbody.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_BOX, pos=at, size=half, rgba=rgba)


def _attach(cell: mujoco.MjSpec, device: mujoco.MjSpec, prefix: str, at: tuple[float, float, float]) -> None:
    cell.attach(device, prefix=prefix, frame=cell.worldbody.add_frame(pos=at))


def _camera(
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
    camera = cell.worldbody.add_camera(name="cell", pos=eye, fovy=fovy)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_XYAXES
    camera.alt.xyaxes = [c / flat for c in right] + [c / length for c in up]
