"""A person who does not operate robots, at a real terminal of 40 by 20 characters."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from robotree.tui.processes.crew import Crew
from tests.terminal import CTRL_R, ENTER, Person

pytestmark = [pytest.mark.e2e]

REALM = "user"


@pytest.mark.timeout(300)
async def test_a_rover_is_moved_by_who_knows_nothing_of_robots(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    async with Crew(REALM, key="none") as crew:
        sim, _ = await crew.start_all(
            ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none"), ("lookup", "lookup-1")
        )
        await crew.start("proxy", "rover", "rover-1", "--connect", sim.address)
        person = Person(REALM, "user", columns=40, lines=20)
        try:
            await asyncio.to_thread(person.shows, b"Move by a distance")
            for keys, sees in (
                (ENTER, "by rover-1"),
                (f"0.2{ENTER}0{ENTER}", "typed"),
                (CTRL_R, "Results"),
                (" ", "go on?"),
            ):
                await asyncio.to_thread(person.types, keys, sees=sees)
            assert b"Traceback" not in person.shown
        finally:
            await asyncio.to_thread(person.leave)
