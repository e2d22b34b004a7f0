"""The plan from above and pictures: what stands where, in characters and behind a pixel."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.sim.physics.camera import FAR, Renderer
from robotree.sim.physics.engine import mujoco
from robotree.sim.testing import ArmBench, RoverBench
from robotree.tui.seen.frames import ground_of, on_plane, ray, seen_at
from robotree.tui.seen.plan import (
    CURSOR,
    GOAL,
    REFUSED,
    STEP,
    Mark,
    PlanScene,
    Window,
    carried,
    drawn,
    fitting,
)
from robotree.tui.seen.plan import heading_sign as sign
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.requests import CameraLens

metres = st.floats(-50.0, 50.0)


def text(scene: PlanScene, window: Window, cursor: tuple[int, int] | None = None) -> list[str]:
    return ["".join(words for _, words in row) for row in drawn(scene, window, cursor)]


@given(
    points=st.lists(st.tuples(metres, metres), max_size=9),
    columns=st.integers(8, 200),
    rows=st.integers(4, 80),
)
def test_all_is_seen_and_lines_fill_the_field(
    points: list[tuple[float, float]], columns: int, rows: int
) -> None:
    window = fitting(points, columns, rows)
    assert all(window.holds(point) for point in points)
    scene = PlanScene(tuple(Mark(x, y, "●", "success", "name") for x, y in points))
    lines = text(scene, window, (0, 0))
    assert [len(line) for line in lines] == [columns] * rows
    assert lines[0][0] == CURSOR


@given(column=st.integers(0, 79), row=st.integers(0, 23))
def test_a_cell_is_its_own_point(column: int, row: int) -> None:
    window = Window(0.3, -0.2, 0.05, 80, 24)
    assert window.cell(window.point(column, row)) == (column, row)


def test_x_is_up_and_y_is_left() -> None:
    window = Window(0.0, 0.0, 0.1, 40, 20)
    (column, row), (ahead, up), (left, same) = (window.cell(p) for p in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5)))
    assert (ahead, up) == (column, row - 5)
    assert (left, same) == (column - 10, row)
    assert [sign(turn * math.pi / 2) for turn in range(4)] == ["↑", "←", "↓", "→"]


@pytest.mark.parametrize("rows", range(16, 44))
def test_the_points_of_the_grid_are_equally_far_apart(rows: int) -> None:
    window = fitting([(0.196, 0.0), (0.35, 0.25)], 120, rows)
    lines = text(PlanScene(), window)
    marked = [at for at, line in enumerate(lines[:-1]) if re.match(r"-?\d", line)]
    assert len({after - before for before, after in pairwise(marked)}) <= 1, lines


@pytest.mark.parametrize("rows", range(16, 44))
def test_the_distances_of_both_edges_never_cover_each_other(rows: int) -> None:
    for columns in range(60, 100):
        last = text(PlanScene(), Window(0.0, 0.0, 0.05, columns, rows))[-1]
        across = [float(label) for label in re.findall(r"-?\d[\d.]*", last)]
        assert all(abs(before - after - 0.2) < 1e-6 for before, after in pairwise(across)), last


def test_the_way_leads_to_its_goal_and_a_refused_goal_looks_different() -> None:
    window = Window(0.0, 0.0, 0.1, 40, 20)
    scene = PlanScene((Mark(0.0, 0.0, "●", "success", "arm-1"),), ((0.0, 0.0), (0.5, 0.5)), (0.5, 0.5))
    lines = text(scene, window)
    assert "●arm-1" in lines[window.cell((0.0, 0.0))[1]]
    assert sum(line.count(STEP) for line in lines) >= 5
    assert lines[window.cell((0.5, 0.5))[1]][window.cell((0.5, 0.5))[0]] == GOAL
    refused = drawn(scene._replace(refused=True), window)
    assert any(tone == "error" and REFUSED in words for row in refused for tone, words in row)


def test_names_never_cover_signs_or_each_other() -> None:
    window = Window(0.0, 0.0, 0.1, 30, 9)
    marks = tuple(Mark(0.0, -0.05 * i, "●", "success", "robot") for i in range(4))
    line = text(PlanScene(marks), window)[window.cell((0.0, 0.0))[1]]
    assert line.count("●") == 4
    assert line.count("robot") == 2, "one to the left of the first, one to the right of the last"


def test_a_virtual_robot_is_on_the_plan_of_those_that_it_commands() -> None:
    arm, square = Address("robot", "arm-1", "1"), Address("robot", "square", "2")
    robots = {
        "arm-1": RobotDescription(address=arm, kinds=("Arm",), attributes={"controller": "tcp://cell:1"}),
        "square": RobotDescription(
            address=square, kinds=("Square",), slots=(SlotSpec(name="arm", kind="Arm", child=arm),)
        ),
    }
    assert ground_of(robots["square"], robots) == "tcp://cell:1"


def test_what_a_body_carries_turns_with_it() -> None:
    assert carried(1.0, 0.0, {"x": 2.0, "y": 3.0, "heading": math.pi / 2}) == pytest.approx((2.0, 4.0))
    assert carried(1.0, 0.0, {"x": 2.0, "y": 3.0}) is None


# -- what is clicked in a picture is the point that MuJoCo sees there: its rays are the truth ------

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
