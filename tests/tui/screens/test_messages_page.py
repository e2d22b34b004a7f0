"""The messages of a wire on the screen: a field is ticked, and what is no number is not."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING

from robotree.tui.processes.wire_watch import WireMessage
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.messages import MessagesPage
from robotree.tui.screen.pages.readings import ReadingsPage

if TYPE_CHECKING:
    import pytest
    from screens.conftest import Operate
    from tui.conftest import Realm

TOLD = (
    WireMessage(1, 1, "GOAL_STATUS", 7, 10.0, 0.1, {"progress": 0.25, "name": "x", "args": [1.0, 2.0]}),
    WireMessage(1, 1, "HEARTBEAT", 3, 1.0, 0.4, {"type": 27}),
)


async def test_a_field_is_ticked_and_its_plot_is_a_key_away(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with operate(realm.realm_client, size=(120, 34)) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        operator.app.choose("arm-1")
        watch = SimpleNamespace(messages=TOLD, note="")
        monkeypatch.setattr(
            operator.app, "watch_wire", lambda robot: operator.app.wires.setdefault(robot, watch)
        )
        await operator.press("Q")
        await operator.at(MessagesPage)
        await operator.sees(
            "1/1 GOAL_STATUS", "10.0/s", "0.1 s", "□ args[0]  1", "□ progress  0.25", "name  x"
        )
        await operator.press("enter", "end", "enter")
        await operator.sees("name is no number")
        await operator.press("home", "enter")
        await operator.sees("■ progress")
        operator.app._heard_wire("arm-1", TOLD)
        await operator.press("U")
        await operator.at(ReadingsPage)
        await operator.sees("■ arm-1.GOAL_STATUS.progress  0.25")
        await operator.press("escape")
        await operator.at(MessagesPage)
        monkeypatch.setattr(operator.app, "leave_wire", operator.app.wires.pop)
        await operator.press("escape")
        await operator.at(MainPage)
