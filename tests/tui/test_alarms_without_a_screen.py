"""`alarms watch`: a threshold that is passed while nobody looks is kept until a person acknowledges it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.tui.line import alarming
from robotree.tui.line.carrying import Silent
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome
from robotree.tui.processes.alarm_file import alarms_of
from tests.waiting import until

if TYPE_CHECKING:
    from tui.conftest import Realm


class Heard(Silent):
    """Keeps what is told."""

    def __init__(self) -> None:
        self.outcomes: list[Outcome] = []

    def outcome(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)


async def test_an_alarm_is_raised_kept_and_over_while_no_screen_runs(
    realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    client, heard, file = realm.realm_client, Heard(), alarms_of("hall")
    client.realm = "hall"

    def states() -> list[str]:
        return [alarm.state for alarm in file.all()]

    async def go_to(x: float) -> None:
        await client.call("arm-1", "go_to", {"x": x, "y": 0.0, "z": 0.4, "twist": 0.0})

    await until(lambda: client.find("arm-1") is not None, "the arm is there")
    line = Line("alarm above", {"ROBOT.READING": "arm-1.x", "LIMIT": "0.5"})
    await alarming.alarm_above(client, line, heard)
    watching = asyncio.create_task(alarming.watch(client, Line("alarms watch", {}), heard))
    try:
        await go_to(0.6)
        await until(lambda: states() == ["raised"], "it is raised")
        await go_to(0.3)
        await until(lambda: states() == ["over"], "it is over, and waits for a person")
        await alarming.alarm_ack(client, Line("alarm ack", {}), heard)
        await until(lambda: states() == ["calm"], "it was acknowledged")
        assert [outcome.data["state"] for outcome in heard.outcomes] == ["raised", "over"]
        assert not watching.done()
    finally:
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)
