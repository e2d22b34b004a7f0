"""Real processes: a realm is recorded, and what persons asked for is played again as a test."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path

import pytest

from robotree.tui.processes.crew import Crew
from tests.command_line import ROBOTREE, within_realm

pytestmark = pytest.mark.e2e

ARM = """
from robotree.vr import CommandFailed, VirtualRobot, command


class Arm(VirtualRobot):
    @command
    def grip(self, force: float) -> float:
        "Grip."
        if force > 5:
            raise CommandFailed(robot=self.name, command="grip", detail="too much")
        return force
"""
TEAM = """
from robotree.vr import Child, VirtualRobot, command


class Team(VirtualRobot):
    arm = Child("Arm")

    @command
    def fetch(self, word: str) -> None:
        "Fetch."
        self.arm.grip(force=1.5)

    @command
    def linger(self) -> None:
        "Wait long."
        self.sleep(60.0)
"""


class Recording:
    """`robotree record` as a process."""

    async def begin(self, file: Path) -> None:
        words = [*ROBOTREE, "record", str(file), "--realm", "taped"]
        self._process = await asyncio.create_subprocess_exec(*words, stderr=asyncio.subprocess.PIPE)
        assert self._process.stderr is not None
        assert "recording realm taped" in (await self._process.stderr.readline()).decode()

    async def end(self, sign: signal.Signals) -> int:
        self._process.send_signal(sign)
        return await self._process.wait()


async def test_a_recorded_session_is_played_again_and_holds(place: Path) -> None:
    run = within_realm("taped")
    for name, page in (("arm", ARM), ("team", TEAM)):
        (place / f"{name}.py").write_text(page)
    file, session = place / "it.mcap", place / "it.session"

    async def line(*words: str, code: int = 0) -> str:
        found, out, complaints = await run(*words)
        assert found == code, complaints
        return out + complaints

    async with Crew("taped", place) as crew:
        await crew.start("lookup", "l1")
        await crew.start("host", "h1")
        recording = Recording()
        await recording.begin(file)
        for name in ("arm", "team"):
            await line("create", str(place / f"{name}.py"), "as", name)
        await line("enslave", "team.arm", "arm")
        await line("call", "team.fetch", "word=it's a #1")
        lingering = asyncio.create_task(line("call", "team.linger", code=1))
        while "linger" not in await line("ls"):
            assert not lingering.done()
        await line("stop")
        await lingering
        await line("resume")
        await line("delete", "team")
        await line("stop", "arm")
        await line("resume", "arm")
        await line("call", "arm.grip", "force=9", code=1)
        assert await recording.end(signal.SIGINT) == 0, "Ctrl-C is how a recording ends"

        made = await line("export", "session", str(file), str(session))
        assert str(session) in made
        asked = [
            row for row in session.read_text().splitlines() if row and not row.startswith(("#", "sleep"))
        ]
        assert asked[:7] == [
            f"create {place}/arm.py as arm",
            f"create {place}/team.py as team",
            "enslave team.arm arm",
            r"call team.fetch word='it'\''s a #1'",
            "call team.linger --detach",
            "stop",
            "expect team idle within 30s",
        ]
        assert asked[-3:] == ["try call arm.grip force=9", "expect refused CommandFailed", "delete arm"]
        assert {"try release team.arm", "try delete team", "stop arm", "try resume arm"} <= set(asked[7:-3])

        await line("delete", "arm")
        for _ in range(2):  # it leaves nothing behind
            assert "held" in await line("run", str(session))
        assert "exists already" in await line("export", "session", str(file), str(session), code=1)
        assert "exists already" in await line("record", str(file), code=1)
        assert "commands, 0 differ" in await line("recording", "compare", str(file), str(file))
        assert "holds no readings" in await line("export", "lerobot", str(file), str(place / "a"), code=1)
