"""Pictures of a cell by casting rays: no OpenGL, no window, the same picture on every machine.

MuJoCo intersects the rays (`mj_multiRay`, 0.2 microseconds each); numpy shades: light from the lamp with its
shadow, a gloss, a sky, a chequered floor that fades into the distance. Pixels in which the surface changes
are cast four more times, so edges are smooth at a fraction of the cost of casting everything more often.

A studio has its own `MjData`: it is set to a published state of the cell, so the physics thread is not
disturbed. A picture of 640 x 360 takes a quarter of a second of one core, one of 320 x 180 a sixteenth.
"""

import io
import math
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from robotree.sim.cell import STATE
from robotree.sim.engine import mujoco
from robotree.sim.vectors import Matrix, Picture, Vector

LARGEST: Final = 1920 * 1080
"""Pixels of a picture; a larger one is asked for in vain and gets this many at the same aspect."""
SMALLEST: Final = 16
"""Pixels of the shorter side."""
FAR: Final = 40.0
"""[m] where the world ends."""

Colours: TypeAlias = NDArray[np.float32]
_ZENITH: Final = np.array((0.42, 0.55, 0.72), np.float32)
_HORIZON: Final = np.array((0.84, 0.88, 0.92), np.float32)
_AMBIENT: Final = 0.46
_DIFFUSE: Final = 0.62
_GLOSS: Final = 0.22
_SHARPNESS: Final = 48.0
_SQUARE: Final = 0.4
_FADE: Final = (3.0, 16.0)
_CORNERS: Final = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


def fit(width: int, height: int) -> tuple[int, int]:
    """The size that is drawn when `width` x `height` pixels are asked for: that, within the bounds above."""
    width, height = max(width, SMALLEST), max(height, SMALLEST)
    scale = min(1.0, math.sqrt(LARGEST / (width * height)))
    return max(int(width * scale), SMALLEST), max(int(height * scale), SMALLEST)


def jpeg(picture: Picture, quality: int) -> bytes:
    """Compress; `quality` is 1 to 100, what lies outside counts as the nearest."""
    out = io.BytesIO()
    Image.fromarray(picture).save(out, "JPEG", quality=min(max(quality, 1), 95))
    return out.getvalue()


class Studio:
    """Draws one world. Belongs to one thread.

    Args:
        model: the world's model; it is only read.
        shadows: whether the lamp casts shadows, at 1.7 times the cost.
    """

    def __init__(self, model: mujoco.MjModel, *, shadows: bool = True) -> None:
        self._model, self._shadows = model, shadows
        self._data = mujoco.MjData(model)
        self._albedo: Colours = np.ascontiguousarray(model.geom_rgba[:, :3], np.float32)
        self._planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
        self._lamp: Vector = np.array(model.light_pos[0])

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
        eye, axes = np.array(data.cam_xpos[view]), data.cam_xmat[view].reshape(3, 3)
        fovy = float(model.cam_fovy[view])
        pixels: Matrix = np.empty((height, width, 2))
        pixels[..., 0] = np.arange(width) + 0.5
        pixels[..., 1] = (np.arange(height) + 0.5)[:, None]
        pixels = pixels.reshape(-1, 2)
        colours, surface = self._trace(eye, _rays(pixels, axes, fovy, width, height))
        edges = _edges(surface.reshape(height, width, -1)).ravel()
        if edges.any():
            fine = colours[edges]
            for corner in _CORNERS:
                fine += self._trace(eye, _rays(pixels[edges] + corner, axes, fovy, width, height))[0]
            colours[edges] = fine / (1 + len(_CORNERS))
        return np.asarray(np.clip(255.0 * colours, 0.0, 255.0), np.uint8).reshape(height, width, 3)

    def _trace(self, eye: Vector, rays: Matrix) -> tuple[Colours, Colours]:
        """Colours (n, 3) seen along `rays` (n, 3), and (n, 4) normal and identity of what is seen."""
        geoms, distances, normals = self._cast(eye, rays)
        hit = geoms >= 0
        colours = _sky(rays)
        points = eye + rays[hit] * distances[hit, None]
        colours[hit] = self._shade(points, rays[hit], normals[hit], geoms[hit], colours[hit])
        return colours, np.column_stack((normals, geoms.astype(np.float32)))

    def _cast(self, origin: Vector, rays: Matrix) -> tuple[NDArray[np.int32], Vector, Colours]:
        count = len(rays)
        geoms, distances, normals = np.empty(count, np.int32), np.empty(count), np.zeros(3 * count)
        mujoco.mj_multiRay(
            self._model, self._data, origin, rays.ravel(), None, 1, -1, geoms, distances, normals, count, FAR
        )
        return geoms, distances, normals.reshape(-1, 3).astype(np.float32)

    def _shade(
        self, points: Matrix, rays: Matrix, normals: Colours, geoms: NDArray[np.int32], sky: Colours
    ) -> Colours:
        colours = self._albedo[geoms]
        floor = np.isin(geoms, self._planes)
        if floor.any():
            squares = np.floor(points[floor, :2] / _SQUARE).sum(axis=1) % 2
            colours[floor] *= (0.88 + 0.12 * squares[:, None]).astype(np.float32)
        towards = (self._lamp - points).astype(np.float32)
        away = np.linalg.norm(towards, axis=1, keepdims=True)
        towards /= away
        facing = np.clip(np.einsum("ij,ij->i", normals, towards), 0.0, 1.0)
        half = towards - rays.astype(np.float32)
        half /= np.linalg.norm(half, axis=1, keepdims=True)
        gloss = _GLOSS * np.clip(np.einsum("ij,ij->i", normals, half), 0.0, 1.0) ** _SHARPNESS
        gloss[floor] = 0.0
        if self._shadows:
            lit = self._lit(points, normals, facing, away[:, 0])
            facing, gloss = facing * lit, gloss * lit
        shade = _AMBIENT * (0.85 + 0.15 * normals[:, 2]) + _DIFFUSE * facing
        colours = colours * shade[:, None] + gloss[:, None]
        near, far = _FADE
        reach = np.linalg.norm(points, axis=1)
        haze = np.clip((reach - near) / (far - near), 0.0, 1.0).astype(np.float32) * floor
        return np.asarray(colours + (sky - colours) * haze[:, None], np.float32)

    def _lit(self, points: Matrix, normals: Colours, facing: Colours, away: Colours) -> Colours:
        """(n,) 1 where the lamp shines on the point, 0 in the shadow."""
        lit = np.ones(len(points), np.float32)
        turned = np.flatnonzero(facing > 0.0)
        rays = points[turned] + 2e-3 * normals[turned] - self._lamp
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        _, distances, _ = self._cast(self._lamp, rays)
        lit[turned[(distances >= 0.0) & (distances < away[turned] - 6e-3)]] = 0.0
        return lit


def _rays(pixels: Matrix, axes: Matrix, fovy: float, width: int, height: int) -> Matrix:
    """(n, 3) unit rays in W through `pixels` (n, 2), for a camera with `axes` (3, 3) in W."""
    scale = 2.0 * math.tan(math.radians(fovy) / 2.0) / height
    rays = np.empty((len(pixels), 3))
    rays[:, 0] = (pixels[:, 0] - width / 2.0) * scale
    rays[:, 1] = (height / 2.0 - pixels[:, 1]) * scale
    rays[:, 2] = -1.0
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    return rays @ axes.T


def _sky(rays: Matrix) -> Colours:
    up = np.clip(rays[:, 2:3], 0.0, 1.0) ** 0.6
    return np.asarray(_HORIZON + (_ZENITH - _HORIZON) * up, np.float32)


def _edges(surface: Colours) -> NDArray[np.bool_]:
    """(height, width) whether the surface (height, width, 4) changes towards a neighbour."""
    edges = np.zeros(surface.shape[:2], np.bool_)
    for axis in (0, 1):
        step = np.abs(np.diff(surface, axis=axis))
        change = (step[..., 3] > 0.5) | (step[..., :3].max(axis=2) > 0.3)
        front = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        behind = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        edges[front] |= change
        edges[behind] |= change
    return edges
