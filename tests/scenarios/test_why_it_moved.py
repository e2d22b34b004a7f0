"""Real processes: who had a robot move is told across hosts, also when one of them was killed."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.processes.crew import Crew
from robotree.tui.processes.state_files import history_files
from tests.command_line import within_realm
from tests.waiting import PATIENCE

pytestmark = pytest.mark.e2e

ARM = """
from robotree.vr import VirtualRobot, command


class Arm(VirtualRobot):
    @command
    def grip(self, force: float) -> float:
        "Grip."
        return force
"""
TEAM = """
from robotree.vr import Child, VirtualRobot, command


class Team(VirtualRobot):
    arm = Child("Arm")

    @command
    def fetch(self) -> None:
        "Fetch."
        self.arm.grip(force=1.5)
        self.arm.grip(force=2.5)
"""
LINE = TEAM.splitlines().index("        self.arm.grip(force=2.5)") + 1


async def test_the_last_motion_is_told_up_to_the_person_and_outlives_its_host(place: Path) -> None:
    run = within_realm("why")
    for name, page in (("arm", ARM), ("team", TEAM)):
        (place / f"{name}.py").write_text(page)

    async def lines(*words: str, code: int = 0) -> str:
        found, out, complaints = await run(*words)
        assert found == code, complaints
        return out + complaints

    async def why(name: str) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(await lines("why", name, "--json"))
        return answer

    async with Crew("why", place) as crew:
        await crew.start("lookup", "l1")
        below, above = await crew.start("host", "below"), await crew.start("host", "above")
        await lines("create", str(place / "arm.py"), "as", "arm", "on", "below")
        await lines("create", str(place / "team.py"), "as", "team", "on", "above")
        assert "nothing is kept of arm" in await lines("why", "arm", code=1)
        await lines("enslave", "team.arm", "arm")
        await lines("call", "team.fetch")

        told = await why("arm")
        arm, team = told["links"]
        assert told["person"] == team["call"]["person"] != ""
        assert (arm["source"], team["source"]) == ("host below", "host above")
        assert (arm["call"]["arguments"], arm["call"]["caller"], arm["step"]) == ({"force": 2.5}, "team", "2")
        assert (arm["call"]["line"], len(team["call"]["page"])) == (LINE, 64)
        assert arm["call"]["epoch"] > 0
        times = [team["call"]["unix"], arm["call"]["unix"], arm["ended"]["began"], arm["ended"]["unix"]]
        assert times == sorted(times)
        assert arm["ended"]["unix"] <= arm["answered"]["unix"] + 0.05
        assert await why(arm["call"]["key"]) == told, "a key is explained as its robot is"

        os.kill(below.pid, signal.SIGKILL)
        await below.process.wait()
        assert await why("arm") == told, "its file tells the same"
        assert "as they were written" in await lines("history", "arm", "--verify")
        again = await crew.start("host", "below")
        await lines("call", "team.fetch")
        later = await why("arm")
        assert later["links"][0]["call"]["unix"] > arm["call"]["unix"]
        assert (await lines("history", "arm")).count("arm.grip force=2.5") == 2

        os.kill(again.pid, signal.SIGKILL)
        await again.process.wait()
        async with asyncio.timeout(PATIENCE):
            while "child" in json.loads(await lines("show", "team", "--json"))["slots"][0]:
                pass
        steps = json.loads(await lines("where", "team", "--json"))["steps"]
        assert [(one["robot"], one["value"]) for one in steps] == [("arm", 1.5), ("arm", 2.5)]

        with closing(sqlite3.connect(history_files("why")["host", "below"])) as file, file:
            file.execute("UPDATE event SET robot = 'somebody' WHERE number = 2")
        assert "host below: event 2 was changed" in await lines("history", "arm", "--verify", code=1)
        assert above.process.returncode is None
