"""A paused robot on the screen: keys that pause, let one step pass and go on, and what is shown meanwhile."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_a_robot_without_steps_is_not_paused(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        await operator.press("b")
        await operator.sees("it has no steps; pause its parent, or stop it")
    assert realm.arm.calls == []
