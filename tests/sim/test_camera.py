"""Pictures without OpenGL: the right size, the same every time, and they show what there is to see."""

from __future__ import annotations

import io
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image

from robotree.sim.physics.camera import LARGEST, SMALLEST, Renderer, fit, jpeg
from robotree.sim.physics.vectors import Picture
from robotree.sim.testing import ArmBench, RoverBench

SIZE = (160, 90)


def draw(bench: ArmBench | RoverBench, camera: str, *, shadows: bool = True) -> Picture:
    studio = Renderer(bench.world.cell.model, shadows=shadows)
    return studio.picture(bench.world.cell.published, camera, *SIZE)


def count_red(picture: Picture) -> int:
    r, g, b = (picture[..., i].astype(int) for i in range(3))
    return int(((r > 90) & (r > 2 * g) & (r > 2 * b)).sum())


@pytest.mark.parametrize("camera", ["cell", "arm/wrist"])
def test_the_lever_is_seen(arm: ArmBench, camera: str) -> None:
    assert count_red(draw(arm, camera)) > 15


def test_the_picture_follows_the_world(arm: ArmBench) -> None:
    before = draw(arm, "cell")
    arm.world.lever[:] = 0.785
    arm.operator.wait(0.01)
    assert (np.abs(draw(arm, "cell").astype(int) - before) > 60).any(axis=2).sum() > 20


def test_the_same_state_gives_the_same_picture(rover: RoverBench) -> None:
    np.testing.assert_array_equal(draw(rover, "cell"), draw(rover, "cell"))


def test_drawing_does_not_disturb_the_world(arm: ArmBench) -> None:
    before = arm.world.cell.snapshot()
    draw(arm, "cell")
    np.testing.assert_array_equal(arm.world.cell.snapshot(), before)


def test_shadows_darken(arm: ArmBench) -> None:
    assert draw(arm, "cell").mean() < draw(arm, "cell", shadows=False).mean()


@given(width=st.integers(0, 10_000), height=st.integers(0, 10_000))
def test_any_size_is_brought_within_bounds(width: int, height: int) -> None:
    w, h = fit(width, height)
    assert w >= SMALLEST
    assert h >= SMALLEST
    assert w * h <= LARGEST
    if min(width, height) >= SMALLEST and width * height <= LARGEST:
        assert (w, h) == (width, height)


@given(width=st.integers(1, 8000), height=st.integers(1, 8000))
def test_whatever_size_is_asked_for_the_picture_keeps_its_shape(width: int, height: int) -> None:
    assume(max(width, height) * SMALLEST**2 <= min(width, height) * LARGEST)
    w, h = fit(width, height)
    assert abs(w * height - h * width) <= max(width, height), "no side is off by more than a pixel"


@given(width=st.integers(16, 90), height=st.integers(16, 60), quality=st.integers(-5, 300))
@settings(max_examples=10, deadline=None)
def test_a_jpeg_has_the_size_asked_for_at_any_quality(width: int, height: int, quality: int) -> None:
    studio = Renderer(WORLD.cell.model)
    data = jpeg(studio.picture(WORLD.cell.published, "rover/front", width, height), quality)
    with Image.open(io.BytesIO(data)) as picture:
        assert picture.format == "JPEG"
        assert picture.size == (width, height)


def test_no_opengl_is_asked_for_and_the_users_choice_is_left_alone() -> None:
    code = (
        "import os; os.environ['MUJOCO_GL'] = 'egl'\n"
        "from robotree.sim.testing import RoverBench; from robotree.sim.physics.camera import Renderer\n"
        "w = RoverBench().world; Renderer(w.cell.model).picture(w.cell.published, 'cell', 32, 18)\n"
        "import sys; print(os.environ['MUJOCO_GL'], any('OpenGL' in name for name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["egl", "False"]


WORLD = RoverBench().world
