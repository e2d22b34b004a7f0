"""Pictures without OpenGL, and cameras that answer ground stations; the skeleton is where MuJoCo has it."""

from __future__ import annotations

import io
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from PIL import Image
from pymavlink.dialects.v20 import common

from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    CommandAck,
    CommandLong,
    MavCmd,
    MavResult,
    Mode,
    ModeKind,
    Skeleton,
    Verb,
)
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


CELL, WRIST = 100, 101


def ask(arm: ArmBench, component: int, command: int, first: float) -> list[Any]:
    """Command one component; what the controller says to it, as pymavlink reads the bytes."""
    arm.operator.wait(0.05)
    arm.operator.order(MavCmd.REQUEST_PROTOCOL_VERSION)  # nothing of it is from a camera
    arm.operator.say(CommandLong(1, component, command, 0, first, *(0.0,) * 6))
    arm.operator.carry()
    reader = common.MAVLink(None)
    said = [each for _ in range(5) for each in arm.controller.advance() if each.component in {CELL, WRIST}]
    frames = [encode(each.message, sequence=0, system=1, component=each.component) for each in said]
    return [message for raw in frames for message in reader.parse_buffer(bytearray(raw))]


@pytest.mark.parametrize(("component", "name"), [(CELL, b"cell"), (WRIST, b"arm/wrist")])
def test_a_camera_says_which_it_is(arm: ArmBench, component: int, name: bytes) -> None:
    ack, told = ask(arm, component, MavCmd.REQUEST_MESSAGE, 259)
    assert (ack.get_type(), ack.command, ack.result) == ("COMMAND_ACK", 512, MavResult.ACCEPTED)
    assert (told.get_type(), told.get_srcComponent()) == ("CAMERA_INFORMATION", component)
    assert bytes(told.model_name) == name.ljust(32, b"\0")
    assert bytes(told.vendor_name).rstrip(b"\0") == b"robotree"
    assert (told.flags, told.resolution_h, told.cam_definition_uri) == (0, 0, "")
    assert told.focal_length != told.focal_length, "NaN: unknown"


def test_a_camera_says_that_it_is_there(arm: ArmBench) -> None:
    ack, told = ask(arm, WRIST, MavCmd.REQUEST_MESSAGE, 0)
    assert ack.result == MavResult.ACCEPTED
    assert (told.type, told.autopilot) == (common.MAV_TYPE_CAMERA, common.MAV_AUTOPILOT_INVALID)


def test_a_camera_denies_a_message_that_it_does_not_have(arm: ArmBench) -> None:
    (ack,) = ask(arm, WRIST, MavCmd.REQUEST_MESSAGE, 148)
    assert ack.result == MavResult.DENIED


def test_a_command_to_a_camera_moves_nothing_and_stops_nothing(arm: ArmBench) -> None:
    (ack,) = ask(arm, WRIST, MavCmd.COMPONENT_ARM_DISARM, 0)
    assert ack.result == MavResult.UNSUPPORTED
    arm.operator.wait(0.6)
    assert arm.operator.latest(Mode).mode == ModeKind.READY


def test_the_autopilot_alone_answers_for_all_components(arm: ArmBench) -> None:
    assert ask(arm, 0, MavCmd.REQUEST_MESSAGE, 0) == []
    assert ask(arm, 99, MavCmd.REQUEST_MESSAGE, 0) == []
    assert all(ack.result == MavResult.ACCEPTED for ack in arm.operator.all(CommandAck))


def test_the_joints_are_where_mujoco_has_them(arm: ArmBench) -> None:
    arm.operator.succeed(Verb.GO_TO, 0.35, 0.15, 0.3, 0.5, 0.25)
    assert arm.operator.all(Skeleton) == [], "nobody has asked"
    arm.operator.command(MavCmd.SET_MESSAGE_INTERVAL, Skeleton.codec.definition.id, 100_000)
    arm.operator.wait(0.5)
    told = arm.operator.latest(Skeleton)
    assert told.count == 8
    places = np.array((told.x, told.y, told.z)).T[: told.count]
    model, data = arm.world.cell.model, arm.world.cell.data
    joints = [joint for joint in range(model.njnt) if model.joint(joint).name.startswith("arm/")][:6]
    np.testing.assert_allclose(places[1:-1], data.xanchor[joints], atol=2e-3)
    np.testing.assert_allclose(places[-1], arm.world.arm.state().position, atol=1e-3)
    assert places[0].tolist() == [0.0, 0.0, 0.0]
