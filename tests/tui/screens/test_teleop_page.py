"""Tele-operation by key: bounded steps, one movement at a time, forces and picture beside it."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

import pytest

from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.place import Place
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.picture import PictureView
from robotree.vr.supervision.fleet import Fleet

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


async def sit_at(operator: Operator, name: str = "arm-1") -> TeleopPage:
    await operator.until(lambda: name in operator.app.store.descriptions, name)
    await operator.until(lambda: "x" in operator.app.store.readings(name), "readings")
    operator.app.open_teleoperation(operator.app.store.descriptions[name])
    return await operator.at(TeleopPage)


async def moved(operator: Operator, page: TeleopPage) -> None:
    await operator.until(
        lambda: not page.jog.moving and page.jog.wish == page.jog.fulfilled, "it has arrived"
    )


async def test_every_axis_is_jogged_by_its_keys_in_both_directions(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
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


async def test_the_step_can_be_changed_within_bounds(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
        page = await sit_at(operator)
        await operator.sees("step 10 mm · 10°")
        await operator.press("plus", "plus", "plus", "plus")
        await operator.sees("step 50 mm · 30°")
        await operator.press("up")
        await moved(operator, page)
        assert realm.arm.pose["x"] == pytest.approx(0.40)
        await operator.press(*["minus"] * 9)
        await operator.sees("step 1 mm · 1°")


async def test_hasty_keys_become_few_movements_on_a_leash(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
        page = await sit_at(operator)
        realm.arm.pace = 0.05
        await operator.press(*["up"] * 12)
        await moved(operator, page)
        assert realm.arm.pose["x"] <= 0.35 + 0.12 + 1e-9
        assert len(realm.arm.calls) <= 12


async def test_the_gripper_opens_and_closes(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
        await sit_at(operator)
        await operator.press("s")
        await operator.until(lambda: realm.arm.width == 0.0, "closed")
        await operator.press("o")
        await operator.until(lambda: realm.arm.width == 0.08, "open")


async def test_buttons_do_what_their_keys_do(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
        page = await sit_at(operator)
        await operator.click(".jog")
        await moved(operator, page)
        assert realm.arm.pose["x"] == pytest.approx(0.36)


async def test_forces_place_and_picture_stand_beside_the_keys(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
        await sit_at(operator)
        await operator.sees("+0.3500 m", "fz", "-20.0 N", "█", "width", "0.0800 m", "cell / cell", "▀▀▀")
        await operator.press("v")
        await operator.sees("cell / wrist")
        assert operator.one(Cameras).at == 1
        await operator.until(
            lambda: "wrist" in realm.cell.looks and operator.one(PictureView).frames > 1, "pictures"
        )


async def test_a_refusal_is_shown_and_the_next_step_starts_where_the_arm_is(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.fleet) as operator:
        page = await sit_at(operator)
        await operator.press("space")
        await operator.sees("PROTECTIVE STOP")
        await operator.press("up")
        await operator.until(lambda: bool(page._refusal), "a refusal")
        assert page.jog.wish is None
        await realm.fleet.resume(None)
        await operator.press("up")
        await operator.until(lambda: realm.arm.pose["x"] == pytest.approx(0.36), "it moves again")
        assert page._refusal == ""


async def test_a_virtual_robot_that_exposes_an_arm_is_tele_operated_through_it(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("teleop.py", "teleop")
    await realm.fleet.enslave("teleop", "arm", "arm-1")
    async with operate(realm.fleet) as operator:
        page = await sit_at(operator, "teleop")
        await operator.press("up")
        await moved(operator, page)
        assert realm.arm.pose["x"] == pytest.approx(0.36)


async def test_a_robot_that_vanishes_under_the_keys_is_told_and_breaks_nothing(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.fleet) as operator:
        page = await sit_at(operator)
        realm.network.kill(realm.members["arm-1"])
        await operator.press("up", "s", "pageup")
        await operator.until(lambda: bool(page._refusal), "a sentence")
        await operator.press("escape")
        await operator.at(MainPage)


async def test_only_robots_that_can_be_tele_operated_are(realm: Realm, operate: Operate) -> None:
    async with operate(realm.fleet) as operator:
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
    async with operate(realm.fleet) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.open_teleoperation(operator.app.store.descriptions["arm-1"])
        page = await operator.at(TeleopPage)
        await operator.sees("no readings yet")
        await operator.press("up")
        await moved(operator, page)
        assert realm.arm.pose["x"] == pytest.approx(0.36)
        assert isinstance(operator.app.fleet, Fleet)
