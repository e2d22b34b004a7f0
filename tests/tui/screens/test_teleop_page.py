"""Tele-operation by key: bounded steps, one movement at a time, forces and picture beside it."""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button

from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import Cameras, PictureView
from robotree.tui.seen.selection import Place
from robotree.vr.supervision.realm_client import RealmClient

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


UP = "\x1b[A"


async def sit_at(operator: Operator, name: str = "arm-1") -> TeleopPage:
    await operator.until(lambda: name in operator.app.store.descriptions, name)
    await operator.until(lambda: "x" in operator.app.store.readings(name), "readings")
    operator.app.open_teleoperation(operator.app.store.descriptions[name])
    return await operator.at(TeleopPage)


def state_line(page: TeleopPage) -> str:
    return str(page.query_one("#state", CachedText).render())


async def moved(operator: Operator, page: TeleopPage) -> None:
    await operator.until(
        lambda: not page.jog.moving and page.jog.target == page.jog.fulfilled, "it has arrived"
    )


async def test_every_axis_is_jogged_by_its_keys_in_both_directions(realm: Realm, operator: Operator) -> None:
    page = await sit_at(operator)
    for keys, axis, change in (
        (("up", "up"), "x", 0.02),
        (("down",), "x", -0.01),
        (("left",), "y", 0.01),
        (("right", "right"), "y", -0.02),
        (("pageup",), "z", 0.01),
        (("pagedown", "pagedown"), "z", -0.02),
        (("comma",), "twist", radians(10)),
        (("full_stop", "full_stop"), "twist", -radians(20)),
    ):
        before = realm.arm.pose[axis]
        await operator.press(*keys)
        await moved(operator, page)
        assert realm.arm.pose[axis] == pytest.approx(before + change), keys
    x = realm.arm.pose["x"]
    await operator.click(".jog")  # its button does what a key does
    await moved(operator, page)
    assert realm.arm.pose["x"] == pytest.approx(x + 0.01)


async def test_what_quick_jogs_drop_is_told(realm: Realm, operator: Operator) -> None:
    page = await sit_at(operator)
    realm.arm.under_way = True
    operator.burst(UP * 8)
    await operator.sees("! 20 mm of x dropped", "◐ moving", "mm to go")
    await operator.hears("20 mm of x dropped: arm-1 is as far behind as it may be")
    realm.arm.under_way = False
    await moved(operator, page)
    assert realm.arm.pose["x"] == pytest.approx(0.41)
    await operator.until(lambda: "dropped" not in state_line(page), "it is told in the log from then on")


async def test_the_state_stands_on_top_and_a_robot_that_is_held_back_says_how_short_it_is(
    realm: Realm, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    readings = realm.arm.readings
    page = await sit_at(operator)
    assert page.query_one("#state").region.y <= 1
    assert page.query_one("#state").region.width == 120, "the whole width"
    assert page.query_one("#state").styles.text_style.bold
    monkeypatch.setattr(realm.arm, "readings", lambda: {**readings(), "x": 0.35})
    await operator.press("up", "up", "up", "up")
    await moved(operator, page)
    await operator.until(lambda: "✗ 40 mm short  ✗ 20 N" in state_line(page), "held back")
    monkeypatch.setattr(realm.arm, "readings", lambda: {**readings(), "fz": 0.0})
    await operator.until(lambda: state_line(page).strip().startswith("● holds"), "it holds there")


async def test_a_pressed_key_is_lit_for_a_moment_and_the_step_is_remembered(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = await sit_at(operator)
    ends = list[Callable[[], object]]()
    monkeypatch.setattr(page, "set_timer", lambda _seconds, end: ends.append(end))
    await operator.press("minus", "left")
    lit = [str(result.label) for result in page.query(".-lit").results(Button)]
    assert lit == ["← +y"]
    for end in ends:
        end()
    assert not page.query(".-lit"), "they go out"
    await operator.press("escape")
    await operator.at(MainPage)
    await sit_at(operator)
    await operator.sees("step 5 mm · 5°")


async def test_forces_place_and_picture_stand_beside_the_keys(realm: Realm, operator: Operator) -> None:
    await sit_at(operator)
    await operator.sees("x 0.350", "fz", "-20.0 N", "█", "grip    80 mm", "cell / cell", "▀▀▀")
    await operator.press("v")
    await operator.sees("cell / wrist")
    assert operator.one(Cameras).at == 1
    await operator.until(
        lambda: "wrist" in realm.cell.looks and operator.one(PictureView).frames > 1, "pictures"
    )


async def test_a_refusal_is_shown_the_next_step_starts_where_the_arm_is_and_one_that_vanishes_is_told(
    realm: Realm, operator: Operator
) -> None:
    page = await sit_at(operator)
    await operator.press("space")
    await operator.sees("PROTECTIVE STOP")
    await operator.press("up")
    await operator.until(lambda: bool(page._refusal), "a refusal")
    assert page.jog.target is None
    await realm.realm_client.resume(None)
    await operator.press("up")
    await operator.until(lambda: realm.arm.pose["x"] == pytest.approx(0.36), "it moves again")
    await operator.until(lambda: not page._refusal, "the refusal is over")
    realm.network.kill(realm.members["arm-1"])
    await operator.press("up", "O", "pageup")
    await operator.until(lambda: bool(page._refusal), "a sentence, and nothing breaks")
    await operator.press("escape")
    await operator.at(MainPage)


async def test_only_robots_that_can_be_tele_operated_are(operator: Operator) -> None:
    await operator.until(lambda: "rover-1" in operator.app.store.descriptions)
    operator.app.ask_for("panel", Place("rover-1"))
    await operator.at(PanelPage)
    await operator.press("x")
    assert isinstance(operator.app.screen, PanelPage)
    operator.app.open_teleoperation(operator.app.store.descriptions["rover-1"])
    await operator.sees("rover-1 cannot be tele-operated")


async def test_without_readings_the_arm_is_asked_where_it_is(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(realm.arm), "readings", lambda _: {})
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.open_teleoperation(operator.app.store.descriptions["arm-1"])
        page = await operator.at(TeleopPage)
        await operator.sees("no readings yet")
        await operator.press("up")
        await moved(operator, page)
        assert realm.arm.pose["x"] == pytest.approx(0.36)
        assert isinstance(operator.app.realm_client, RealmClient)
