"""On the screen `W` shows who had the selected robot move, `H` what it did."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from robotree.tui.screen.pages.dialogs import Reading
from robotree.vr.base.history_event import HistoryEvent, NumberedEvent
from robotree.vr.base.requests import EventsRead, ReadEvents

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm

TEAM = HistoryEvent(
    kind="accepted", unix=1.0, robot="team", key="k", command="fetch", person="anna@pts/3", process=7
)
ARM = HistoryEvent(
    kind="accepted", unix=2.0, robot="arm-1", key="k/2", command="go_to", caller="team", line=12, epoch=7,
    arguments={"x": 0.3},
)  # fmt: skip


async def test_w_tells_who_had_the_selected_robot_move_and_h_what_it_did(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def read_events(request: ReadEvents) -> dict[str, EventsRead]:
        found = [ARM, ARM] if request.robot and not (request.last or request.key) else [TEAM, ARM]
        return {"host h1": EventsRead(events=tuple(NumberedEvent(*one) for one in enumerate(found, 1)))}

    async with operate(realm.realm_client) as operator:
        await operator.sees("arm-1")
        operator.app.choose("arm-1")
        await operator.press("W")
        await operator.sees("nothing is kept of arm-1")
        monkeypatch.setattr(realm.realm_client, "read_events", read_events)
        await operator.press("W")
        await operator.at(Reading)
        await operator.sees("arm-1.go_to x=0.3", "step 2 of team.fetch, line 12", "asked by anna@pts/3")
        await operator.press("escape", "H")
        await operator.at(Reading)
        await operator.sees("accepted", "go_to x=0.3")
