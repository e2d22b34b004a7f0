"""On the screen `z` shows where a robot is in its page, `W` who had it move, `H` what it did."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace

from robotree.tui.screen.pages.dialogs import Reading
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.where import WherePage
from robotree.vr.base.history_event import HistoryEvent, NumberedEvent
from robotree.vr.base.requests import EventsRead, ReadEvents

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

    from robotree.vr.base.description import RobotDescription


GOAL = {"x": 0.3, "y": 0.0, "z": 0.3, "twist": 0.0}


async def test_the_page_shows_line_and_calls_and_pauses_steps_and_continues(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    kept = [
        HistoryEvent(kind="accepted", unix=time.time(), robot="mover", key="k", command="move"),
        HistoryEvent(
            kind="accepted", unix=time.time(), robot="arm-1", key="k/2", command="go_to", line=4,
            arguments=GOAL,
        ),
    ]  # fmt: skip

    async def read_events(request: ReadEvents) -> dict[str, EventsRead]:
        found = [one for one in kept if one.robot == request.robot]
        return {"host h1": EventsRead(events=tuple(NumberedEvent(*one) for one in enumerate(found, 1)))}

    describe = realm.realm_client.describe

    async def describe_busy(name: str) -> RobotDescription:
        return replace(await describe(name), busy="move" if name == "mover" else "")

    monkeypatch.setattr(realm.realm_client, "read_events", read_events)
    monkeypatch.setattr(realm.realm_client, "describe", describe_busy)
    async with operate(realm.realm_client, size=(160, 45)) as operator:
        await operator.until(lambda: "mover" in operator.app.store.descriptions)
        operator.app.choose("mover")
        await operator.press("z")
        await operator.at(WherePage)
        await operator.sees("mover.move has run for", "▸ 2     arm-1.go_to", "→   4", "time for each call")
        await operator.press("b")
        moving = asyncio.create_task(realm.realm_client.call("mover", "move", GOAL))
        await operator.sees("mover.move is paused before step 1: arm.get_info()")
        await operator.press("greater_than_sign")
        await operator.sees("is paused before step 2: arm.go_to(")
        await operator.press("B")
        await moving
        await operator.press("escape")
        await operator.at(MainPage)


TEAM = HistoryEvent(
    kind="accepted", unix=1.0, robot="team", key="k", command="fetch", person="anna@pts/3", process=7
)
ARM = HistoryEvent(
    kind="accepted", unix=2.0, robot="arm-1", key="k/2", command="go_to", caller="team", line=12, epoch=7,
    arguments={"x": 0.3},
)  # fmt: skip


async def test_w_tells_who_had_the_selected_robot_move_and_h_what_it_did(
    realm: Realm, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def read_events(request: ReadEvents) -> dict[str, EventsRead]:
        found = [ARM, ARM] if request.robot and not (request.last or request.key) else [TEAM, ARM]
        return {"host h1": EventsRead(events=tuple(NumberedEvent(*one) for one in enumerate(found, 1)))}

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
