"""Chapter 4.2 of the thesis, "A Running Scenario": a test for each of its figures 4.2 to 4.25, in order.

One operator at one keyboard, over real processes; each figure begins where the one before ended.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button

from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.widgets.cameras import PictureView

AXLE_X, AXLE_Z, RADIUS = 0.42, 0.08, 0.20
"""[m] The lever's axle and the length to its handle (docs/cell.md)."""

if TYPE_CHECKING:
    from conftest import Stage

pytestmark = [
    pytest.mark.e2e,
    pytest.mark.story,
    pytest.mark.asyncio(loop_scope="module"),
    pytest.mark.timeout(600),
]


async def test_figure_4_2_the_supervisor_starts_and_proxy_and_view_are_running(stage: Stage) -> None:
    await stage.sees("robotree", "thesis", "1 view", "2 lookups", "1 host")


async def test_figure_4_3_it_has_found_them_through_the_lookup_services(stage: Stage) -> None:
    await stage.sees("arm-1", "Arm", "free")
    assert "cell" in stage.app.store.views


async def test_figure_4_4_a_file_of_a_virtual_robot_is_selected(stage: Stage) -> None:
    await stage.choose_file("teleop.py")
    await stage.sees("teleop.py", "TeleOp", "slot arm: Arm")


async def test_figure_4_5_it_is_named_and_appears_by_itself(stage: Stage) -> None:
    await stage.name_it("teleop")
    await stage.main_page()
    await stage.sees("teleop", "TeleOp", "host-1")


async def test_figure_4_6_it_enslaves_the_proxy_chosen_among_the_right_kind(stage: Stage) -> None:
    await stage.select("teleop")
    await stage.press("e")
    await stage.sees("teleop.arm", "takes Arm", "arm-1")
    offered = stage.app.screen.query_one("#children")
    assert "rover-1" in stage.listed
    assert [option.id for option in offered.options] == ["arm-1"], "a rover does not fit"
    await stage.press("enter")
    await stage.until(lambda: "arm-1" not in stage.listed)


async def test_figure_4_7_the_proxy_is_hidden_and_the_panel_is_asked_for(stage: Stage) -> None:
    await stage.panel("teleop")
    await stage.sees("teleop", "jog", "get_info")
    assert "arm-1" not in stage.listed


async def test_figure_4_8_the_panel_moves_twists_grips_and_shows_forces_on_every_axis(stage: Stage) -> None:
    await stage.press("x")
    await stage.until(lambda: isinstance(stage.app.screen, TeleopPage))
    await stage.sees("+x", "-x", "+y", "-y", "+z", "-z", "step", "fx", "fy", "fz", "tx", "ty", "tz", "grip")


async def test_figure_4_9_the_workspace_view_is_asked_for(stage: Stage) -> None:
    await stage.main_page()
    await stage.press("v")
    await stage.sees("cell / cell", "cell / wrist", "lever")


async def test_figure_4_10_the_view_shows_the_workspace(stage: Stage) -> None:
    picture = stage.app.screen.query_one(PictureView)
    await stage.until(lambda: bool(picture._rows))
    colours = {cell for row in picture._rows for cell in row}
    assert len(colours) > 20, "a picture of a cell has many colours"


async def test_figure_4_11_the_arm_moves_in_the_horizontal_plane(stage: Stage) -> None:
    await stage.panel("teleop")
    await stage.press("x")
    await stage.until(lambda: isinstance(stage.app.screen, TeleopPage) and "z" in stage.readings("teleop"))
    before = dict(stage.readings("teleop"))
    await stage.press("plus", "plus")  # 50 mm a step
    await stage.jog("up", "left", "left")
    await stage.until(lambda: stage.readings("teleop")["y"] > before["y"] + 0.09)
    after = stage.readings("teleop")
    assert after["x"] == pytest.approx(before["x"] + 0.05, abs=0.005)
    assert after["z"] == pytest.approx(before["z"], abs=0.005)


async def test_figure_4_12_the_gripper_twists(stage: Stage) -> None:
    await stage.jog("comma", "comma", "comma")
    await stage.until(lambda: abs(stage.readings("teleop")["twist"] - math.pi / 2) < 0.02)


async def test_figure_4_13_it_descends_and_catches_the_handle(stage: Stage) -> None:
    await stage.jog("up", *("pagedown",) * 5)
    await stage.press("minus")  # 20 mm a step
    await stage.jog("down", "pagedown")
    await stage.press("O")
    await stage.until(lambda: stage.readings("teleop")["width"] < 0.05)
    assert stage.readings("teleop")["width"] > 0.015, "the handle is between the fingers"


async def test_figure_4_14_the_lever_is_closed_by_hand(stage: Stage) -> None:
    assert await stage.lever() < -0.75
    for _ in range(50):
        angle = await stage.lever()
        if angle > 0.6:
            break
        at, ahead = stage.target(), angle + 0.15
        forth = AXLE_X + RADIUS * math.sin(ahead) - at["x"]
        rise = AXLE_Z + RADIUS * math.cos(ahead) - at["z"]
        vertically = "pageup" if rise > 0 else "pagedown"
        await stage.jog("up" if forth > abs(rise) else vertically)
    assert await stage.lever() > 0.5, "led past the middle"
    await stage.press("o")
    await stage.until(lambda: stage.readings("teleop")["width"] > 0.07)
    assert await stage.lever() > 0.75, "and let go, it snaps to its stop"
    await stage.press("plus")
    await stage.jog("pageup", "pageup")


async def test_figure_4_15_teleop_is_deleted(stage: Stage) -> None:
    await stage.select("teleop")
    await stage.press("d")
    await stage.sees("Cancel")
    assert isinstance(stage.app.focused, Button)
    assert stage.app.focused.id == "no", "the harmless answer has the focus"
    await stage.press("right", "enter")
    await stage.until(lambda: "teleop" not in stage.listed)


async def test_figure_4_16_the_proxy_is_back_in_the_lookup(stage: Stage) -> None:
    await stage.until(lambda: "arm-1" in stage.listed)
    await stage.sees("arm-1", "free")


async def test_figure_4_17_move_to_is_created(stage: Stage) -> None:
    await stage.choose_file("move_to.py")
    await stage.sees("MoveTo", "slot arm: Arm")


async def test_figure_4_18_and_named(stage: Stage) -> None:
    await stage.name_it("mover")
    assert "mover" in stage.listed


async def test_figure_4_19_open_close_lever_is_created(stage: Stage) -> None:
    await stage.choose_file("open_close_lever.py")
    await stage.sees("OpenCloseLever", "slot mover: MoveTo")


async def test_figure_4_20_and_named(stage: Stage) -> None:
    await stage.name_it("lever")
    assert "lever" in stage.listed


async def test_figure_4_21_the_mover_enslaves_the_proxy(stage: Stage) -> None:
    await stage.enslave("mover", "arm-1")
    assert {"mover", "lever"} <= stage.listed


async def test_figure_4_22_the_lever_enslaves_the_mover(stage: Stage) -> None:
    await stage.enslave("lever", "mover")
    assert "lever" in stage.listed
    assert not {"mover", "arm-1"} & stage.listed


async def test_figure_4_23_the_panel_of_the_lever_is_asked_for(stage: Stage) -> None:
    await stage.panel("lever")
    await stage.sees("close", "open", "Close the lever")


async def test_figure_4_24_one_press_of_a_button_works_the_lever(stage: Stage) -> None:
    page = stage.app.screen
    await stage.run_command(page, "open", within=200)
    assert await stage.lever() < -0.75
    await stage.run_command(page, "close", within=200)


async def test_figure_4_25_the_lever_is_closed(stage: Stage) -> None:
    readings = (await stage.realm_client.describe_view("cell")).readings
    assert readings["lever"] > 0.75
    assert readings["peak_force"] < 35
    assert not stage.app.errors, "the error boundary had nothing to hold back"
