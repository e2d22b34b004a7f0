"""The lines of docs/travel.md, typed by a person in a realm of two hosts; then a session, and `drain`."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.processes.crew import Crew
from tests.command_line import robotree

pytestmark = [pytest.mark.e2e]

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "travel.md").read_text(encoding="utf-8")
LINES = re.findall(r"^robotree .*$", GUIDE, re.MULTILINE)
SESSION = """\
migrate patrol to h1
expect patrol on h1 within 30s
migrate patrol to h2
expect patrol on h2 within 30s
"""


@pytest.mark.timeout(300)
async def test_each_line_of_the_guide_can_be_typed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("ROBOTREE_REALM", "guide")

    async def say(line: str) -> Any:
        done = await asyncio.to_thread(robotree, *line.split()[1:], "--json")
        assert done.returncode == 0, (line, done.stdout, done.stderr)
        return json.loads(done.stdout)

    async def where() -> dict[str, list[str]]:
        return {host["name"]: host["robots"] for host in await say("robotree ls --hosts")}

    hosts = [line for line in LINES if line.split()[1] == "host"]
    async with Crew("guide", key="none") as crew:
        await crew.start_all(("lookup", "l1"), *(tuple(line.split()[1:]) for line in hosts))
        for line in LINES:
            if line not in hosts:
                await say(line)
        assert await where() == {"h1": [], "h2": ["patrol"]}
        session = tmp_path / "a.session"
        session.write_text(SESSION)
        assert (await say(f"robotree run {session}"))["ok"]
        await say("robotree drain h2")
        assert await where() == {"h1": ["patrol"], "h2": []}
