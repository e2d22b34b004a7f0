"""What is advised of the place of a robot: a mark in its row, and a key that shows and obeys it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.dialogs import Choosing
from robotree.tui.screen.pages.main import MainPage
from tests.tui.conftest import EXAMPLES

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_a_robot_that_would_be_better_off_elsewhere_is_marked_and_a_key_carries_that_out(
    realm: Realm, operate: Operate
) -> None:
    host = await realm.host("host-9")
    await realm.realm_client.create(str(EXAMPLES / "move_to.py"), "mover", "host-9")
    runtime = host.agents["mover"].runtime
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "mover" in operator.app.store.descriptions, "its description")
        operator.app.choose("mover")
        await operator.press("f")
        await operator.at(Choosing)
        await operator.sees("mover is on", "nobody has looked yet", "manual", "people alone move it (now)")
        await operator.press("down", "enter")
        await operator.at(MainPage)
        await operator.until(lambda: runtime.placement == "advise", "it is placed by advice")
        runtime.advice, runtime.advised = "host-2 is nearer than host-1", "host-2"
        runtime.changed()
        await operator.sees("better off on host-2")
        await operator.until(
            lambda: operator.app.store.descriptions["mover"].advice == runtime.advice, "the advice"
        )
        await operator.press("f")
        await operator.at(Choosing)
        await operator.sees(
            "host-2 is nearer than host-1", "move to host-2 now", "where it would be better off (now)"
        )
        await operator.press("enter")
        await operator.at(MainPage)
        await operator.sees(
            "no host named 'host-2' is running"
        )  # it was obeyed: only the host is missing here
        operator.app.choose("arm-1")
        await operator.press("f")
        await operator.sees("arm-1 is a proxy, and stays where its controller is")
