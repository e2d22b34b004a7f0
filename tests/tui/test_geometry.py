"""What is clicked in a picture is the point that MuJoCo sees there: its rays are the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.sim.physics.camera import FAR, Renderer
from robotree.sim.physics.engine import mujoco
from robotree.sim.testing import ArmBench, RoverBench
from robotree.tui.seen.frames import on_plane, ray, seen_at
from robotree.vr.base.requests import CameraLens

WIDTH, HEIGHT = 64, 36
ASPECT = WIDTH / HEIGHT


def lens_of(bench: ArmBench | RoverBench, camera: str) -> CameraLens:
    """The lens of a picture that was really drawn."""
    renderer = Renderer(bench.world.cell.model, shadows=False)
    renderer.picture(bench.world.cell.published, camera, WIDTH, HEIGHT)
    (x, y, z), (qw, qx, qy, qz), fovy = renderer.pose(camera)
    return CameraLens(x=x, y=y, z=z, qw=qw, qx=qx, qy=qy, qz=qz, fovy=fovy)


def truth(bench: ArmBench | RoverBench, camera: str, column: int, row: int) -> tuple[str, np.ndarray]:
    """What MuJoCo sees through the middle of a pixel: the geom, and the point [m] in W."""
    model, data = bench.world.cell.model, bench.world.cell.data
    view = model.camera(camera).id
    scale = 2.0 * math.tan(math.radians(model.cam_fovy[view]) / 2.0) / HEIGHT
    local = np.array(((column + 0.5 - WIDTH / 2) * scale, (HEIGHT / 2 - row - 0.5) * scale, -1.0))
    direction = data.cam_xmat[view].reshape(3, 3) @ (local / np.linalg.norm(local))
    geom = np.array([-1], np.int32)
    distance = mujoco.mj_ray(model, data, data.cam_xpos[view], direction, None, 1, -1, geom)
    name = model.geom(int(geom[0])).name if 0 <= distance < FAR else ""
    return name, data.cam_xpos[view] + distance * direction


@pytest.mark.parametrize(
    ("kind", "camera", "surface"),
    [(ArmBench, "cell", "table"), (ArmBench, "arm/wrist", "table"), (RoverBench, "cell", "floor")],
)
def test_a_pixel_is_the_point_that_mujoco_sees_there(
    kind: type[ArmBench | RoverBench], camera: str, surface: str
) -> None:
    bench = kind()
    bench.operator.wait(0.01)
    lens, found = lens_of(bench, camera), 0
    for column in range(0, WIDTH, 5):
        for row in range(0, HEIGHT, 5):
            name, point = truth(bench, camera, column, row)
            if name != surface or abs(point[2]) > 1e-6:  # its upper side
                continue
            found += 1
            at = on_plane(lens, (column + 0.5) / WIDTH, (row + 0.5) / HEIGHT, ASPECT)
            assert at is not None
            np.testing.assert_allclose(at, point, atol=1e-6)
    assert found >= 10, "else nothing was compared"


def test_the_wrist_camera_is_where_the_arm_has_carried_it() -> None:
    arm = ArmBench()
    before = lens_of(arm, "arm/wrist")
    arm.operator.succeed(1, 0.35, 0.15, 0.3, 0.5, 0.25)
    after = lens_of(arm, "arm/wrist")
    assert math.dist((before.x, before.y, before.z), (after.x, after.y, after.z)) > 0.05
    tool = tuple(arm.world.arm.state().position)
    assert math.dist((after.x, after.y, after.z), tool) < 0.2


def test_a_pixel_above_the_horizon_is_no_point() -> None:
    lens = lens_of(ArmBench(), "cell")
    assert on_plane(lens, 0.5, -5.0, ASPECT) is None


@given(
    x=st.floats(-1.0, 1.0),
    y=st.floats(-1.0, 1.0),
    z=st.floats(-0.5, 0.8),
    turn=st.floats(-math.pi, math.pi),
    aspect=st.floats(0.5, 3.0),
)
def test_there_and_back_is_the_same_point(x: float, y: float, z: float, turn: float, aspect: float) -> None:
    """A camera 2 m above, looking down, turned about the vertical: half a turn about x, then the turn."""
    c, s = math.cos(turn / 2), math.sin(turn / 2)
    lens = CameraLens(x=0.1, y=-0.2, z=2.0, qw=0.0, qx=c, qy=s, qz=0.0, fovy=1.0)
    place = seen_at(lens, (x, y, z), aspect)
    assert place is not None
    back = on_plane(lens, *place, aspect, height=z)
    assert back == pytest.approx((x, y, z), abs=1e-9)
    assert ray(lens, 0.5, 0.5, aspect) == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)
