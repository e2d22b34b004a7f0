"""A hostile robot in the full screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.place import Place
from robotree.tui.terminal import STEERING

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Hostile, Realm


async def test_no_page_lets_a_robot_steer_the_terminal(
    realm: Realm, hostile: Hostile, operate: Operate
) -> None:
    await realm.robot(hostile)
    async with operate(realm.realm_client) as operator:
        app = operator.app
        await operator.until(lambda: "evil" in app.store.descriptions and app.store.state("evil") is not None)
        for key in ("l", "home", "t", "home", "g"):
            await operator.press(key)
            await operator.sees("evil" if key != "g" else "log")
            assert STEERING.search(operator.text.replace("\n", "")) is None
        await operator.obey("call evil.stumble")
        await operator.sees("seen robotree: all is")
        app.ask_for("panel", Place("evil"))
        await operator.at(PanelPage)
        await operator.sees("[2J", "seen")
        assert STEERING.search(operator.text) is None
