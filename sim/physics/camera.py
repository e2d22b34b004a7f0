"""Pictures of a cell by casting rays: no OpenGL, no window, the same picture on every machine.

MuJoCo intersects the rays (`mj_multiRay`, 0.2 microseconds each); numpy shades: light from the lamp with its
shadow, a gloss, a sky, a chequered floor that fades into the distance. Pixels in which the surface changes
are cast four more times, so edges are smooth at a fraction of the cost of casting everything more often.

A renderer has its own `MjData`: it is set to a published state of the cell, so the physics thread is not
disturbed. A picture of 640 x 360 takes a seventh of a second of one core, one of 320 x 180 a quarter of that.
"""

import io
import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robotree.sim.physics.cell import STATE
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.scenery import ACROSS, number_of, printed
from robotree.sim.physics.vectors import Matrix, Picture, Vector

LARGEST: Final = 1920 * 1080
"""Most pixels of a picture; a larger one is scaled down to them at the same aspect ratio."""
SMALLEST: Final = 16
"""Pixels of the shorter side."""
FAR: Final = 40.0
"""[m] where the world ends."""

Planes: TypeAlias = NDArray[np.float32]
"""One plane per component, one entry per ray."""
_ZENITH: Final = np.array(((0.42,), (0.55,), (0.72,)), np.float32)
_HORIZON: Final = np.array(((0.84,), (0.88,), (0.92,)), np.float32)
_AMBIENT: Final = 0.46
_DIFFUSE: Final = 0.62
_GLOSS: Final = 0.22
_SHARPNESS: Final = 5
"""The highlight falls with the 2^(1 + this)th power of the cosine."""
_SQUARE: Final = 0.4
_INK: Final = 0.04
"""Share of the light that black ink gives back."""
_INKED: Final = 0.6
"""Added to the number of a geom where ink is seen: more than what counts as a change."""
_FADE: Final = (3.0, 16.0)
_CORNERS: Final = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


_OPTICAL: Final = np.array((1.0, -1.0, -1.0))
"""From MuJoCo's camera frame (x right, y up, z backward) to the optical one, by the columns of a rotation."""


class CameraSeat(NamedTuple):
    """Where a camera is.

    Its frame is the optical one of ROS REP 103: x to the right of the picture, y down, z along the view.

    Attributes:
        eye: (3,) in W [m].
        rotation: (4,) its orientation in W as a unit quaternion w, x, y, z.
        fovy: vertical field of view [rad]; pixels are square, the middle of the picture is on the axis.
    """

    eye: tuple[float, float, float]
    rotation: tuple[float, ...]
    fovy: float


def fit(width: int, height: int) -> tuple[int, int]:
    """The size that is drawn when `width` x `height` pixels are asked for: that, or one of its shape.

    A camera shows more to the sides the wider its picture is, so another shape would be another view. Only
    where both bounds above cannot be kept at once is the longer side cut.
    """
    sides = max(width, 1), max(height, 1)
    scale = min(max(1.0, SMALLEST / min(sides)), math.sqrt(LARGEST / (sides[0] * sides[1])))
    drawn = tuple(max(int(side * scale), SMALLEST) for side in sides)
    longest = LARGEST // min(drawn)
    return min(drawn[0], longest), min(drawn[1], longest)


def jpeg(picture: Picture, quality: int) -> bytes:
    """Compress; `quality` is 1 to 100, what lies outside counts as the nearest."""
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "JPEG", quality=min(max(quality, 1), 95))
    return out.getvalue()


class Renderer:
    """Renders one world. Belongs to one thread.

    Args:
        model: the world's model; it is only read.
        shadows: whether the lamp casts shadows, at 1.7 times the cost.
    """

    def __init__(self, model: mujoco.MjModel, *, shadows: bool = True) -> None:
        self._model, self._shadows = model, shadows
        self._data = mujoco.MjData(model)
        # One entry more than there are geoms: what a ray that hits nothing (-1) sees.
        self._albedo: Planes = np.vstack((model.geom_rgba[:, :3], np.zeros(3))).T.astype(np.float32)
        floors = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._is_floor: Planes = np.append(floors, 0).astype(np.float32)
        self._lamp: Vector = np.array(model.light_pos[0])
        self._markers = {
            geom: printed(number)
            for geom in range(model.ngeom)
            if (number := number_of(model.geom(geom).name)) is not None
        }

    def picture(self, state: Vector, camera: str, width: int, height: int) -> Picture:
        """Draw.

        Args:
            state: a published state of the cell.
            camera: its name in the model.
            width: [px].
            height: [px].

        Returns:
            (height, width, 3) red, green, blue.
        """
        model, data = self._model, self._data
        mujoco.mj_setState(model, data, state, STATE)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        view = model.camera(camera).id
        lens = _Lens(np.array(data.cam_xpos[view]), data.cam_xmat[view].reshape(3, 3), model.cam_fovy[view])
        columns: Vector = np.tile(np.linspace(0.5, width - 0.5, width), height)
        rows: Vector = np.repeat(np.linspace(0.5, height - 0.5, height), width)
        colours, surface = self._trace(lens.eye, lens.rays(columns, rows, width, height))
        edges = np.flatnonzero(_edges(surface.reshape(4, height, width)))
        if edges.size:
            across = np.concatenate([columns[edges] + dx for dx, _ in _CORNERS])
            down = np.concatenate([rows[edges] + dy for _, dy in _CORNERS])
            fine, _ = self._trace(lens.eye, lens.rays(across, down, width, height))
            fine = fine.reshape(3, len(_CORNERS), -1).sum(axis=1)
            colours[:, edges] = (colours[:, edges] + fine) / (1 + len(_CORNERS))
        pixels = np.clip(255.0 * colours, 0.0, 255.0).astype(np.uint8)
        return np.ascontiguousarray(pixels.T).reshape(height, width, 3)

    def pose(self, camera: str) -> CameraSeat:
        """Where a camera was in the picture that was drawn last."""
        model, data = self._model, self._data
        view = model.camera(camera).id
        quaternion = np.empty(4)
        optical = data.cam_xmat[view].reshape(3, 3) * _OPTICAL
        mujoco.mju_mat2Quat(quaternion, optical.ravel())
        x, y, z = data.cam_xpos[view].tolist()
        return CameraSeat((x, y, z), tuple(quaternion.tolist()), math.radians(float(model.cam_fovy[view])))

    def _trace(self, eye: Vector, rays: Matrix) -> tuple[Planes, Planes]:
        """Colours (3, n) seen along `rays` (n, 3), and (4, n) normal and identity of what is seen."""
        geoms, distances, normals = self._cast(eye, rays)
        towards = _planes(rays)
        points = _planes(eye + rays * distances[:, None])
        printing = self._printing(points, geoms)
        colours = self._shade(points, towards, normals, geoms, printing)
        sky = _HORIZON + (_ZENITH - _HORIZON) * np.sqrt(np.maximum(towards[2], 0.0))
        haze = self._haze(points, geoms)
        colours += (sky - colours) * haze
        # Where a printed module ends, the surface changes as where a geom ends.
        seen: Planes = geoms.astype(np.float32)
        seen += _INKED * (1.0 - printing)
        return colours, np.vstack((normals, seen))

    def _cast(self, origin: Vector, rays: Matrix) -> tuple[NDArray[np.int32], Vector, Planes]:
        """The hits of `rays` (n, 3) from `origin`: geoms (n,) or -1, distances (n,), normals (3, n)."""
        count = len(rays)
        geoms, distances, normals = np.empty(count, np.int32), np.empty(count), np.zeros(3 * count)
        mujoco.mj_multiRay(
            self._model, self._data, origin, rays.ravel(), None, 1, -1, geoms, distances, normals, count, FAR
        )
        return geoms, distances, _planes(normals.reshape(-1, 3))

    def _printing(self, points: Planes, geoms: NDArray[np.int32]) -> Planes:
        """(n,) 0 where black ink of a marker is seen, else 1."""
        light = np.ones(geoms.size, np.float32)
        for geom, white in self._markers.items():
            seen = np.flatnonzero(geoms == geom)
            if not seen.size:
                continue
            at = (points[:, seen].T - self._data.geom_xpos[geom]) @ self._data.geom_xmat[geom].reshape(3, 3)
            thick, wide, high = self._model.geom_size[geom]
            column = np.clip((at[:, 1] / wide + 1.0) / 2.0 * ACROSS, 0, ACROSS - 1).astype(int)
            row = np.clip((1.0 - at[:, 2] / high) / 2.0 * ACROSS, 0, ACROSS - 1).astype(int)
            light[seen] = np.where(at[:, 0] > thick / 2.0, white[row, column], True)
        return light

    def _shade(
        self, points: Planes, rays: Planes, normals: Planes, geoms: NDArray[np.int32], printing: Planes
    ) -> Planes:
        colours = self._albedo[:, geoms] * (_INK + (1.0 - _INK) * printing)
        floor = self._is_floor[geoms]
        squares = np.floor(points[0] / _SQUARE) + np.floor(points[1] / _SQUARE)
        colours *= 1.0 - 0.12 * (floor * (squares % 2.0))
        lamp = self._lamp[:, None].astype(np.float32) - points
        away = np.sqrt(_dot(lamp, lamp))
        lamp /= away
        facing = np.maximum(_dot(normals, lamp), 0.0)
        if self._shadows:
            facing *= self._lit(points, normals, facing, away)
        half = lamp - rays
        gloss = _dot(normals, half) / np.sqrt(_dot(half, half))
        gloss = np.maximum(gloss, 0.0) ** 2
        for _ in range(_SHARPNESS):
            gloss *= gloss
        gloss *= _GLOSS * ((facing > 0.0) & (floor == 0.0))
        colours *= _AMBIENT * (0.85 + 0.15 * normals[2]) + _DIFFUSE * facing
        colours += gloss
        return colours

    def _haze(self, points: Planes, geoms: NDArray[np.int32]) -> Planes:
        """(n,) how much of the sky hides what is seen: all where nothing is, some where the floor is far."""
        near, far = _FADE
        reach = np.sqrt(_dot(points, points))
        haze: Planes = np.clip((reach - near) / (far - near), 0.0, 1.0, dtype=np.float32)
        haze *= self._is_floor[geoms]
        haze[geoms < 0] = 1.0
        return haze

    def _lit(self, points: Planes, normals: Planes, facing: Planes, away: Planes) -> Planes:
        """(n,) 1 where the lamp shines on the point, 0 in the shadow."""
        lit = np.ones(facing.size, np.float32)
        turned = np.flatnonzero(facing > 0.0)
        rays = (points[:, turned] + 2e-3 * normals[:, turned]).T - self._lamp
        rays /= np.sqrt(np.einsum("ij,ij->i", rays, rays))[:, None]
        _, distances, _ = self._cast(self._lamp, rays)
        lit[turned[(distances >= 0.0) & (distances < away[turned] - 6e-3)]] = 0.0
        return lit


class _Lens(NamedTuple):
    """A camera: where it is (3,) [m], its axes (3, 3) in W, and its vertical field of view [deg]."""

    eye: Vector
    axes: Matrix
    fovy: float

    def rays(self, columns: Vector, rows: Vector, width: int, height: int) -> Matrix:
        """(n, 3) unit rays in W through the points (`columns`, `rows`) of a picture [px]."""
        scale = 2.0 * math.tan(math.radians(self.fovy) / 2.0) / height
        x, y = (columns - width / 2.0) * scale, (height / 2.0 - rows) * scale
        rays = np.stack((x, y, np.full_like(x, -1.0)), axis=1) / np.sqrt(x * x + y * y + 1.0)[:, None]
        return rays @ self.axes.T


def _planes(rows: Matrix) -> Planes:
    """(n, 3) as three contiguous planes (3, n): numpy is thrice as fast along the long side."""
    return np.ascontiguousarray(rows.T, np.float32)


def _dot(a: Planes, b: Planes) -> Planes:
    """(n,) the products of the vectors (3, n)."""
    product: Planes = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


def _edges(surface: Planes) -> NDArray[np.bool_]:
    """(height, width) whether the surface (4, height, width) changes towards a neighbour."""
    edges = np.zeros(surface.shape[1:], np.bool_)
    for axis in (0, 1):
        step = np.abs(np.diff(surface, axis=axis + 1))
        change = (step[3] > 0.5) | (step[:3].max(axis=0) > 0.3)
        front = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        behind = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        edges[front] |= change
        edges[behind] |= change
    return edges
