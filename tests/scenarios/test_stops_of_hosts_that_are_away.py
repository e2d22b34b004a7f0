"""Real processes: a stop of everything concerns robots, too, whose host hangs and never wakes."""

from __future__ import annotations

import asyncio
import os
import signal
from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm
from tests.waiting import until

pytestmark = pytest.mark.e2e

PAGE = """
from pathlib import Path
from robotree.vr import VirtualRobot, command


class Solo(VirtualRobot):
    @command
    def go(self, steps: int) -> None:
        "Go."
        for step in range(steps):
            self.sleep(0.1)
            with open({effects!r}, "a") as file:
                file.write(f"{{step}}\\n")
"""


async def test_a_robot_begins_stopped_whose_host_was_frozen_and_killed_later(place: Path) -> None:
    effects = place / "effects"
    effects.write_text("")
    (place / "solo.py").write_text(PAGE.format(effects=str(effects)))
    run = within_realm("away")
    async with Crew("away", place) as crew:
        await crew.start("lookup", "l1")
        host = await crew.start("host", "h1")
        await run("create", str(place / "solo.py"), "as", "solo")
        going = await run("call", "solo.go", "steps=600", "--detach", "--within", "90 s")
        assert going[0] == exit_codes.DONE
        await until(lambda: effects.stat().st_size > 0, "it goes")
        os.kill(host.pid, signal.SIGSTOP)
        code, _, complaints = await run("stop")
        assert "solo will be stopped when host h1 is back" in complaints
        assert code == exit_codes.NOBODY, complaints
        os.kill(host.pid, signal.SIGKILL)
        await host.process.wait()
        again = await crew.start("host", "h1")

        async def listed_as_stopped() -> bool:
            return "STOPPED" in (await run("ls"))[1]

        await until(listed_as_stopped, "it is stopped")
        done = effects.read_text()
        await asyncio.sleep(1.0)
        assert effects.read_text() == done, "it goes on though everything was stopped"
        code, listed, _ = await run("ls")
        assert "STOPPED" in listed
        assert (await run("resume"))[0] == exit_codes.DONE
        assert (await run("call", "solo.go", "steps=1"))[0] == exit_codes.DONE

        os.kill(again.pid, signal.SIGKILL)
        await again.process.wait()
        await crew.start("host", "h1")
        assert "STOPPED" not in (await run("ls"))[1], "the stop is over"
