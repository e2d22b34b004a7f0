"""`alarms watch`: a threshold that is passed while nobody looks is kept until a person acknowledges it."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from robotree.tui.line import alarming
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome
from robotree.tui.processes.alarm_file import FILE, alarms_of
from robotree.tui.seen.watched import Alarm
from robotree.vr.network.realms import state_home
from tests.tui.test_verbs import Listener
from tests.waiting import until

if TYPE_CHECKING:
    from tui.conftest import Realm

    from robotree.vr.supervision.realm_client import RealmClient


@pytest.fixture
def hall(realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Hall:
    """A realm whose alarms are kept, and who watches them."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    realm.realm_client.realm = "hall"
    return Hall(realm.realm_client)


class Hall:
    """See `hall`."""

    def __init__(self, client: RealmClient) -> None:
        self.client, self.heard, self.file = client, Listener(), alarms_of("hall")
        self.path = state_home() / "hall" / FILE

    def states(self) -> list[str]:
        return [alarm.state for alarm in self.file.all()]

    async def go_to(self, x: float) -> None:
        await self.client.call("arm-1", "go_to", {"x": x, "y": 0.0, "z": 0.4, "twist": 0.0})

    @asynccontextmanager
    async def watching(self, limit: str) -> AsyncGenerator[asyncio.Task[Outcome]]:
        """Watch whether x is above a limit."""
        await until(lambda: self.client.find("arm-1") is not None, "the arm is there")
        line = Line("alarm above", {"ROBOT.READING": "arm-1.x", "LIMIT": limit})
        await alarming.alarm(self.client, line, self.heard)
        watching = asyncio.create_task(alarming.watch(self.client, Line("alarms watch", {}), self.heard))
        try:
            yield watching
        finally:
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)


async def test_an_alarm_is_raised_kept_and_over_while_no_screen_runs(hall: Hall) -> None:
    async with hall.watching("0.5") as watching:
        await hall.go_to(0.6)
        await until(lambda: hall.states() == ["raised"], "it is raised")
        await hall.go_to(0.3)
        await until(lambda: hall.states() == ["over"], "it is over, and waits for a person")
        await alarming.alarm_ack(hall.client, Line("alarm ack", {}), hall.heard)
        await until(lambda: hall.states() == ["calm"], "it was acknowledged")
        assert [outcome.data["state"] for outcome in hall.heard.outcomes] == ["raised", "over"]
        assert not watching.done()


async def test_a_file_that_is_damaged_for_a_moment_is_told_once_and_what_passes_meanwhile_is_kept(
    hall: Hall,
) -> None:
    async with hall.watching("0.5") as watching:
        await hall.go_to(0.3)
        good = hall.path.read_text()
        for damage in ("[{]", "[{", ""):
            hall.path.write_text(damage)
            await until(lambda: bool(hall.heard.warnings), "it is told")
            await hall.go_to(0.6)
        await asyncio.sleep(3 * alarming.PAUSE)
        assert not watching.done()
        assert hall.heard.outcomes == []
        hall.path.write_text(good)
        await until(lambda: hall.states() == ["raised"], "what has passed meanwhile")
        await until(lambda: len(hall.heard.outcomes) == 1, "it is printed")
        (told,) = hall.heard.warnings
        assert "alarms.json cannot be used" in told
        hall.path.write_text("[")
        await until(lambda: len(hall.heard.warnings) == 2, "the next damage is told again")


def test_a_row_shows_a_threshold_as_it_was_set_and_a_value_as_fine() -> None:
    fine = Alarm(robot="arm-1", reading="x", sign=">", limit=0.30004, unit="m", raised=1.0, value=0.3001)
    assert re.search(r"arm-1\.x is above 0\.30004 m; since .*, at 0\.30010 m$", alarming.row(fine))
    turn = Alarm(
        robot="arm-1", reading="j1", sign="<", limit=radians(44.75), unit="rad", raised=1.0, value=0.78
    )
    assert re.search(r"arm-1\.j1 is below 44\.75 °; since .*, at 44\.69 °$", alarming.row(turn))
