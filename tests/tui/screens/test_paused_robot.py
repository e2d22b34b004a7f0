"""A paused robot on the screen: keys that pause, let one step pass and go on, and what is shown meanwhile."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.robot_table import RobotTable

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

GOAL = {"x": 0.3, "y": 0.0, "z": 0.3, "twist": 0.0}


async def on_mover(operator: Operator) -> None:
    """Move the cursor to the mover."""
    await operator.until(lambda: "mover" in operator.app.store.descriptions)
    await operator.until(lambda: operator.one(RobotTable).selected == "mover", "mover is first")


async def test_keys_pause_let_one_step_pass_and_go_on(realm: Realm, operate: Operate) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    async with operate(realm.realm_client, size=(160, 45)) as operator:
        await on_mover(operator)
        await operator.press("b")
        await operator.sees("mover: paused by", "‖ paused")
        moving = asyncio.create_task(realm.realm_client.call("mover", "move", GOAL))
        await operator.sees("paused before step 1: arm.get_info()")
        await operator.press("greater_than_sign")
        await operator.sees("mover takes step 1: arm.get_info()")
        await operator.sees("paused before step 2: arm.go_to(")
        assert realm.arm.calls == []
        await operator.press("greater_than_sign")
        await operator.sees("paused before step 3: arm.get_info()")
        assert realm.arm.calls == ["go_to"]
        await operator.press("enter")
        await operator.at(PanelPage)
        await operator.sees("paused before step 3: arm.get_info()")
        await operator.press("escape")
        await operator.press("B")
        await operator.sees("mover: goes on")
        await moving
        await operator.until(lambda: not operator.app.store.descriptions["mover"].paused, "no pause is shown")


async def test_a_robot_without_steps_is_not_paused(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        await operator.press("b")
        await operator.sees("it has no steps; pause its parent, or stop it")
    assert realm.arm.calls == []
