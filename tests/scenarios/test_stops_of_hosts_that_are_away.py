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
            print(f"step {step}")
"""


async def test_robots_begin_stopped_whose_host_was_frozen_and_killed_later(place: Path) -> None:
    (place / "solo.py").write_text(PAGE)
    run = within_realm("away")

    async def steps() -> list[int]:
        return [(await run("log", robot))[1].count("step ") for robot in ("solo", "apart")]

    async def both_go() -> bool:
        return all(await steps())

    async with Crew("away", place) as crew:
        await crew.start("lookup", "l1")
        host = await crew.start("host", "h1")
        await run("create", str(place / "solo.py"), "as", "solo")
        await run("create", str(place / "solo.py"), "as", "apart", "--isolate", "process")
        for robot in ("solo", "apart"):
            going = await run("call", f"{robot}.go", "steps=600", "--detach", "--within", "90 s")
            assert going[0] == exit_codes.DONE
        await until(both_go, "both go")
        os.kill(host.pid, signal.SIGSTOP)
        code, _, complaints = await run("stop")
        for robot in ("solo", "apart"):
            assert f"{robot} will be stopped when host h1 is back" in complaints
        assert code == exit_codes.NOBODY, complaints
        os.kill(host.pid, signal.SIGKILL)
        await host.process.wait()
        again = await crew.start("host", "h1")

        async def listed_as_stopped() -> bool:
            return (await run("ls"))[1].count("STOPPED") == 2

        await until(listed_as_stopped, "both are stopped")
        done = await steps()
        await asyncio.sleep(1.0)
        assert await steps() == done, "they go on though everything was stopped"
        assert await listed_as_stopped()
        assert (await run("resume"))[0] == exit_codes.DONE
        for robot in ("solo", "apart"):
            assert (await run("call", f"{robot}.go", "steps=1"))[0] == exit_codes.DONE

        os.kill(again.pid, signal.SIGKILL)
        await again.process.wait()
        await crew.start("host", "h1")
        assert "STOPPED" not in (await run("ls"))[1], "the stop is over"
