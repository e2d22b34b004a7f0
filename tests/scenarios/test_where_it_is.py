"""Real processes and a real terminal: where a robot is, its readings over time, an alarm, and a restart."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.processes.crew import Crew
from robotree.tui.processes.state_files import state_home
from tests.command_line import within_realm
from tests.terminal import ENTER, ESCAPE, Person

pytestmark = pytest.mark.e2e

ARM = """
from robotree.vr import VirtualRobot, command


class Arm(VirtualRobot):
    force = 0.0

    def readings(self):
        return {"fz": self.force}

    @command
    def press(self, force: float) -> float:
        "Press."
        self.force = force
        return force
"""
TEAM = """
from robotree.vr import Child, VirtualRobot, command


class Team(VirtualRobot):
    arm = Child("Arm")

    @command
    def press_twice(self) -> None:
        "Press."
        self.arm.press(force=1.5)
        self.arm.press(force=25.0)
"""
LINE = TEAM.splitlines().index("        self.arm.press(force=25.0)") + 1


async def test_an_operator_steps_a_robot_sees_its_line_and_acknowledges_an_alarm(place: Path) -> None:
    run = within_realm("where")
    for name, page in (("arm", ARM), ("team", TEAM)):
        (place / f"{name}.py").write_text(page)

    async def answer(*words: str) -> Any:
        code, out, complaints = await run(*words, "--json")
        assert code == 0, complaints
        return json.loads(out)

    async with Crew("where", place) as crew:
        await crew.start("lookup", "l1")
        await crew.start("host", "h1")
        await answer("create", str(place / "arm.py"), "as", "arm", "on", "h1")
        await answer("create", str(place / "team.py"), "as", "team", "on", "h1")
        await answer("enslave", "team.arm", "arm")
        await answer("pause", "team")
        calling = asyncio.create_task(run("call", "team.press_twice"))
        person = Person("where", columns=140, lines=44)
        try:
            await asyncio.to_thread(person.shows, b"paused before step 1")
            await asyncio.to_thread(person.types, "z", sees="is paused before step 1: arm.press(force=1.5)")
            await asyncio.to_thread(person.types, ">", sees="paused before step 2: arm.press(force=25.0)")
            standing = await answer("where", "team")
            assert (standing["line"], standing["runs"], len(standing["page"])) == (LINE, True, 64)
            (step,) = standing["steps"]
            assert (step["robot"], step["command"], step["value"]) == ("arm", "press", 1.5)
            assert standing["times"][0]["call"] == "arm.press"

            await answer("alarm", "above", "arm.fz", "20")
            assert [one["state"] for one in await answer("alarms")] == ["calm"]
            await asyncio.to_thread(person.types, "B", sees="nothing runs; the last was team.press_twice")
            assert (await calling)[0] == 0
            await asyncio.to_thread(person.types, ESCAPE, sees="ALARM: arm.fz was 25")
            await asyncio.to_thread(person.types, "U", sees="raised")
            await asyncio.to_thread(person.types, ENTER, sees="to 25")
            await asyncio.to_thread(person.types, "k", sees="acknowledged: arm.fz")
            (alarm,) = await answer("alarms")
            assert (alarm["state"], alarm["acknowledged_by"][-len(person.terminal) :]) == (
                "acknowledged",
                person.terminal,
            )
            assert await answer("alarm", "ack") == {"acknowledged": []}
            assert await answer("alarm", "clear", "arm.fz") == {"cleared": "arm.fz"}
            kept = (state_home() / "screen.yaml").read_text()
            assert "arm.fz" in kept
        finally:
            person.leave()
