"""The lines of docs/orders.md, typed by a person, with a rover that is switched off and on again."""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew
from tests.command_line import PATIENCE, ROBOTREE, robotree

pytestmark = [pytest.mark.e2e]

GUIDE = (Path(__file__).parents[2] / "docs" / "orders.md").read_text(encoding="utf-8")
NBSA = (Path(__file__).parents[2] / "docs" / "nbsa.md").read_text(encoding="utf-8")
LINES = [line for block in re.findall(r"```sh\n(.*?)```", GUIDE, re.DOTALL) for line in block.splitlines()]


def test_the_table_of_the_paper_names_tests_that_there_are() -> None:
    root = Path(__file__).parents[2]
    paths = [root / path for path in re.findall(r"`(tests/[\w/.]+)`", NBSA)]
    assert [path for path in paths if not path.exists()] == []
    named = "".join(path.read_text(encoding="utf-8") for path in paths if path.is_file())
    assert [test for test in re.findall(r"`(test_\w+)`", NBSA) if f"def {test}(" not in named] == []


async def _remembered() -> None:
    """Wait until the directory knows what the rover has answered."""
    async with joined("guide") as realm_client, asyncio.timeout(PATIENCE):
        while not ((known := await realm_client.orders.robot("rover-1")) and "get_info" in known.answers):  # noqa: ASYNC110
            await asyncio.sleep(0.1)


@pytest.mark.timeout(300)
async def test_each_line_of_the_guide_can_be_typed(  # noqa: C901, PLR0915 # a case for each line
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("ROBOTREE_REALM", "guide")
    ticket = ""

    async def say(line: str, code: int = 0) -> Any:
        words = line.replace("TICKET", ticket).split()[1:]
        done = await asyncio.to_thread(robotree, *words, "--json")
        assert done.returncode == code, (line, done.stdout, done.stderr)
        return json.loads(done.stdout)

    async def until(line: str, holds: Any) -> Any:
        async with asyncio.timeout(PATIENCE):
            while not holds(data := await say(line)):  # noqa: ASYNC110 # other processes
                await asyncio.sleep(0.1)
        return data

    async with Crew("guide", key="none") as crew:
        sim, _ = await crew.start_all(
            ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none"),
            tuple(LINES[0].split()[1:]),
        )
        words = ("proxy", "rover", "rover-1", "--connect", sim.address)
        proxy = await crew.start(*words)
        await until("robotree show rover-1", lambda robot: "x" in robot["readings"])
        await until("robotree ls", lambda robots: [one["state"] for one in robots] == ["free"])
        await _remembered()
        crew.members.remove(proxy)
        await proxy.stop()
        for line in LINES[1:]:
            data = await say(line)
            match line.split()[1]:
                case "ls":
                    assert data[0]["state"].startswith("away since")
                case "show":
                    assert data["state"].startswith("away since")
                    assert data["readings"]
                case "call" if "--queue" in line:
                    assert data["state"] == "waiting"
                    ticket = data["ticket"]
                case "orders":
                    assert [one["ticket"] for one in data["orders"]] == [ticket]
                case "stop":
                    assert data["held"] == ["rover-1"]
                    holds, listed = (await say("robotree orders"))["holds"], await say("robotree ls")
                    assert holds
                    assert "held by" in listed[0]["state"]
                case "resume":
                    assert not (await say("robotree orders"))["holds"]
                case _:
                    pass
        assert (await say("robotree orders"))["orders"][0]["state"] == "cancelled"
        await say("robotree call rover-1.move x=9 y=0 --queue", code=1)
        refused = await say("robotree call rover-1.move x=0.2 y=0", code=1)
        assert refused["error"] == "RobotAbsent"
        await say("robotree call rover-1.move x=0.2 y=0 --queue")
        await crew.start(*words)
        results = await until("robotree inbox", bool)
        assert [one["shown"] for one in results] == ["done"]
        assert not await say("robotree inbox")


@pytest.mark.timeout(300)
def test_the_demo_of_a_rover_that_is_away_ends_well(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir(mode=0o700)
    home = {"XDG_RUNTIME_DIR": str(tmp_path / "run"), "XDG_STATE_HOME": str(tmp_path / "state")}
    words = (*ROBOTREE, "demo", "away", "--headless")
    played = subprocess.run(
        words, env={**os.environ, **home}, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert played.returncode == 0, played.stdout + played.stderr
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert verdict["ok"]
    assert (verdict["orders_away"], verdict["twice"], verdict["doubts"], verdict["kills"]) == (3, 0, 0, 1)
