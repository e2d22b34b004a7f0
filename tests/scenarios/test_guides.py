"""The lines of docs/orders.md and docs/travel.md, typed by a person."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import pytest

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew
from tests.architecture.test_documents import blocks
from tests.command_line import PATIENCE, robotree

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300)]

ROOT = Path(__file__).parents[2]
ORDERS = [line for block in blocks(ROOT / "docs" / "orders.md", "sh") for line in block.splitlines()]
TRAVEL = re.findall(r"^robotree .*$", (ROOT / "docs" / "travel.md").read_text(), re.MULTILINE)
SESSION = """\
migrate patrol to h1
expect patrol on h1 within 30s
migrate patrol to h2
expect patrol on h2 within 30s
"""


@pytest.fixture(autouse=True)
def at_the_clone(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sit where the guides' files are, in a realm of the test."""
    del place  # there before it, and longer
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("ROBOTREE_REALM", "guide")


async def say(line: str, code: int = 0) -> Any:
    done = await asyncio.to_thread(robotree, *line.split()[1:], "--json")
    assert done.returncode == code, (line, done.stdout, done.stderr)
    return json.loads(done.stdout)


async def _remembered() -> None:
    """Wait until the directory knows what the rover has answered."""
    async with joined("guide") as realm_client, asyncio.timeout(PATIENCE):
        while not ((known := await realm_client.orders.robot("rover-1")) and "get_info" in known.answers):  # noqa: ASYNC110
            await asyncio.sleep(0.1)


async def test_each_line_of_the_guide_of_orders_can_be_typed() -> None:  # a case for each line
    ticket = ""

    async def until(line: str, holds: Any) -> Any:
        async with asyncio.timeout(PATIENCE):
            while not holds(data := await say(line)):  # noqa: ASYNC110 # other processes
                await asyncio.sleep(0.1)
        return data

    async with Crew("guide", key="none") as crew:
        sim, _ = await crew.start_all(
            ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none"),
            tuple(ORDERS[0].split()[1:]),
        )
        words = ("proxy", "rover", "rover-1", "--connect", sim.address)
        proxy = await crew.start(*words)
        await until("robotree show rover-1", lambda robot: "x" in robot["readings"])
        await until("robotree ls", lambda robots: [one["state"] for one in robots] == ["free"])
        await _remembered()
        crew.members.remove(proxy)
        await proxy.stop()
        for line in ORDERS[1:]:
            data = await say(line.replace("TICKET", ticket))
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


async def test_each_line_of_the_guide_of_travelling_can_be_typed(tmp_path: Path) -> None:
    async def where() -> dict[str, list[str]]:
        return {host["name"]: host["robots"] for host in await say("robotree ls --hosts")}

    hosts = [line for line in TRAVEL if line.split()[1] == "host"]
    async with Crew("guide", key="none") as crew:
        await crew.start_all(("lookup", "l1"), *(tuple(line.split()[1:]) for line in hosts))
        for line in TRAVEL:
            if line not in hosts:
                await say(line)
        assert await where() == {"h1": [], "h2": ["patrol"]}
        session = tmp_path / "a.session"
        session.write_text(SESSION)
        assert (await say(f"robotree run {session}"))["ok"]
        await say("robotree drain h2")
        assert await where() == {"h1": ["patrol"], "h2": []}
