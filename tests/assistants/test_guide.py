"""The five minutes of docs/assistants.md, line by line, and the rehearsal, with the protocol's own client."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcp import Client
from mcp.client.stdio import StdioServerParameters

from tests.assistants.conftest import ME, text
from tests.command_line import ROBOTREE, robotree
from tests.waiting import wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(600)]
ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "assistants.md").read_text()
FIVE = GUIDE.partition("## Connect your assistant")[2].partition("\n## ")[0]
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", FIVE, re.DOTALL)
PATIENT = 200.0


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="rt-") as name:
        folder = Path(name)
        for variable, part in (("XDG_RUNTIME_DIR", "run"), ("XDG_STATE_HOME", "state")):
            (folder / part).mkdir(mode=0o700)
            monkeypatch.setenv(variable, str(folder / part))
        monkeypatch.delenv("ROBOTREE_REALM", raising=False)
        monkeypatch.chdir(folder)
        shutil.copy(ROOT / "examples" / "cell.realm.yaml", folder)
        (folder / "nothing.yaml").write_text("lookups: []\n")
        yield folder
        assert robotree("apply", "nothing.yaml", "--prune", "--yes", within=PATIENT).returncode == 0
        wait_until(lambda: not processes_of(folder), "no process of the cell is left")


def processes_of(folder: Path) -> list[str]:
    """Return the processes that were started with this folder in their environment."""
    found: list[str] = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it has ended, or is somebody else's
            if f"{folder}/".encode() in (process / "environ").read_bytes():
                found.append((process / "cmdline").read_bytes().replace(b"\0", b" ").decode())
    return found


def said(line: str, **blanks: str) -> str:
    """Type a line of the guide; return what it prints."""
    words = [blanks.get(word, word) for word in line.split()[1:]]
    done = robotree(*words, within=PATIENT)
    assert done.returncode == 0, (line, done.stdout, done.stderr)
    return done.stdout.strip()


async def test_the_five_minutes_are_as_they_are_written(home: Path) -> None:
    kinds = [kind for kind, _ in BLOCKS]
    assert kinds == ["sh", "yaml", "sh", "json", "sh", "sh"], "the guide has other steps: walk these"
    (cell,), (rules, invite), (listed,), (allow, why) = (
        block.strip().splitlines() for kind, block in BLOCKS if kind == "sh"
    )
    said(cell)
    (home / "assistant.yaml").write_text(BLOCKS[1][1].replace("anna", ME))
    said(rules)
    assert any("proxy" in each for each in processes_of(home)), "the cell runs in processes of its own"
    key = said(invite)
    entry: Any = json.loads(BLOCKS[3][1])["mcpServers"]["robotree"]
    assert entry["command"] == "robotree"
    assert entry["env"] == {"ROBOTREE_MCP_KEY": "THE KEY"}
    env = {**os.environ, "ROBOTREE_MCP_KEY": key}
    server = StdioServerParameters(command=ROBOTREE[0], args=[*ROBOTREE[1:], *entry["args"]], env=env)
    half = {"x": 0.5, "y": 0, "_why": "I was asked to drive forward by half a metre"}
    # a rehearsal in the twin: the real rover stays where it is
    twin = StdioServerParameters(command=ROBOTREE[0], args=[*server.args, "--rehearse"], env=env)
    async with Client(twin, read_timeout_seconds=PATIENT) as client:
        tried = await client.call_tool("rover-1__move", half)
        assert not tried.is_error, text(tried)
        assert json.loads(text(tried))["observed"]["x"] == pytest.approx(0.5, abs=0.05)
    async with Client(server, read_timeout_seconds=PATIENT) as client:
        before = await client.call_tool("rover-1__get_info", {"_why": "where it is"})
        assert json.loads(text(before))["result"]["x"] == pytest.approx(0, abs=0.02)
        asked = await client.call_tool("rover-1__move", half)
        permit = str((asked.structured_content or {})["permit"])
        shown = said(listed)
        assert shown.startswith(permit)
        for part in (
            "rover-1.move(x=0.5 m",
            "claude asks",
            half["_why"],
            "rehearsed in the twin",
            "picture: ",
        ):
            assert str(part) in shown
        said(allow, PERMIT=permit)
        done = await client.call_tool("robotree_permit", {"permit": permit})
        assert not done.is_error, text(done)
        after = await client.call_tool("rover-1__get_info", {"_why": "where it is"})
        assert json.loads(text(after))["result"]["x"] == pytest.approx(0.5, abs=0.05)
    told = said(why)
    for part in ("asked by claude@mcp", str(half["_why"]), "said yes"):
        assert part in told
