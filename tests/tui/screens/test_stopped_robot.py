"""A robot that tells of a stop which nobody ordered here: the screen must not show it as free."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.dialogs import Confirm
from robotree.vr import Robot

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm

REASON = "its brakes are shut"


class Braked(Robot):
    """Has brakes of its own."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.halted = REASON

    def resume(self) -> None:
        """Open the brakes."""
        self.halted = ""


async def test_a_stop_of_the_robots_own_is_on_every_page_until_it_is_released(
    realm: Realm, operate: Operate
) -> None:
    agent = await realm.robot(Braked("a-braked-one"))
    async with operate(realm.realm_client) as operator:
        await operator.sees("PROTECTIVE STOP: a-braked-one", "■ stopped", REASON)
        await operator.press("t")
        await operator.sees("■ stopped")
        await operator.press("home", "R")
        await operator.at(Confirm)
        await operator.press("right", "enter")
        await operator.until(lambda: operator.app.store.stopped == (), "it is released")
        agent.robot.halted = REASON
        agent.notify()
        await operator.until(lambda: operator.app.store.stopped == ("a-braked-one",), "it is told")
        await operator.press("g")
        await operator.sees(f"a-braked-one is in protective stop: {REASON}")
