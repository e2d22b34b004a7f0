"""The backup of docs/lab.md: what is restored is there again, with its state, and begins stopped."""

from __future__ import annotations

import json
import os
import shutil
import tarfile
from pathlib import Path
from typing import Any

import pytest

from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm

pytestmark = pytest.mark.e2e

REALM = "backup"
robotree = within_realm(REALM)
COUNTER = """
from robotree.vr import VirtualRobot, command, state

class Counter(VirtualRobot):
    count: int = state(0)

    @command
    def add(self) -> int:
        self.count += 1
        return self.count
"""


async def say(*words: str) -> Any:
    code, out, err = await robotree(*words, "--json")
    assert code == exit_codes.DONE, (words, out, err)
    return json.loads(out or "null")


async def test_what_is_restored_has_its_state_and_begins_stopped(place: Path, tmp_path: Path) -> None:
    page = tmp_path / "counter.py"
    page.write_text(COUNTER)
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        await say("create", str(page), "as", "counter")
        assert await say("call", "counter.add") == 1
        assert (await say("stop"))["stopped"] == ["counter"]
    state = Path(os.environ["XDG_STATE_HOME"], "robotree")
    with tarfile.open(tmp_path / "lab.tgz", "w:gz") as archive:
        archive.add(state, "robotree")
    shutil.rmtree(state)
    with tarfile.open(tmp_path / "lab.tgz") as archive:
        archive.extractall(state.parent, filter="data")
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        code, _, said = await robotree("call", "counter.add")
        assert code == exit_codes.REFUSED
        assert "counter is stopped" in said
        assert await say("history", "counter", "--verify")
        assert (await say("resume"))["resumed"] == ["counter"]
        assert await say("call", "counter.add") == 2
