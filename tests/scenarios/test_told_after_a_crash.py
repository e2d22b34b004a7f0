"""Real processes: what people are told of a crash that a command has survived, and of a question it asks."""

from __future__ import annotations

import asyncio
import json
import os
import signal
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from tests.command_line import within_realm
from tests.waiting import until

pytestmark = pytest.mark.e2e

TEAM = """
from robotree.vr import VirtualRobot, command, state


class Walker(VirtualRobot):
    taken: int = state(0)

    @command
    def walk(self, steps: int) -> int:
        "Walk."
        for _ in range(steps):
            self.sleep(0.1)
            self.taken += 1
        return self.taken

    @command(resume="ask")
    def careful(self) -> int:
        "Walk, and ask after a crash."
        return self.walk(steps=30)
"""


async def under_way(realm: str, command: str) -> None:
    """Wait until the walker has taken its first steps."""
    async with joined(realm) as realm_client:

        async def walks() -> bool:
            found = await realm_client.describe("walker")
            return found.busy == command and found.kept["taken"] >= 2

        await until(walks, f"{command} is under way")


async def kill(crew: Crew, pid: int, wait: asyncio.subprocess.Process) -> None:
    os.kill(pid, signal.SIGKILL)
    await wait.wait()
    await crew.start("host", "h1")


async def test_history_and_log_tell_of_the_crash_and_of_no_second_beginning(place: Path) -> None:
    run = within_realm("told")
    (place / "walker.py").write_text(TEAM)
    async with Crew("told", place) as crew:
        await crew.start("lookup", "l1")
        host = await crew.start("host", "h1")
        await run("create", str(place / "walker.py"), "as", "walker")
        call = asyncio.ensure_future(run("call", "walker.walk", "steps=30", "--json"))
        await under_way("told", "walk")
        await kill(crew, host.pid, host.process)
        code, out, complaints = await call
        assert (code, json.loads(out)) == (0, 30), complaints

        code, log, _ = await run("log", "walker")
        assert code == 0
        assert log.count("is back after") == 1
        assert "walk goes on" in log
        assert log.count("walk begins") <= 1, log
        _, history, _ = await run("history", "walker")
        assert "host h1 ended at" in history
        assert "came back" in history
        for since in ("10min", "00:00", "2026-01-01T00:00", "2026-01-01"):
            assert (await run("history", "walker", "--since", since))[1], since
        code, _, complaints = await run("history", "walker", "--since", "noon")
        assert (code, "write for example 10min, 14:30" in complaints) == (exit_codes.USAGE, True), complaints
        _, why, _ = await run("why", "walker")
        assert "came back" in why
        assert "as they were written" in (await run("history", "walker", "--verify"))[1]


async def test_a_question_stands_in_the_list_until_it_is_answered(place: Path) -> None:
    run = within_realm("asks")
    (place / "walker.py").write_text(TEAM)
    async with Crew("asks", place) as crew:
        await crew.start("lookup", "l1")
        host = await crew.start("host", "h1")
        await run("create", str(place / "walker.py"), "as", "walker")
        call = asyncio.ensure_future(run("call", "walker.careful"))
        await under_way("asks", "careful")
        await kill(crew, host.pid, host.process)
        listed = ""

        async def asks() -> bool:
            nonlocal listed
            listed = "".join((await run("ls"))[1:])
            return "ASKS (decide walker)" in listed

        await until(asks, "the question is in the list")
        assert "walker.careful was interrupted" in listed
        assert (await run("decide", "walker", "again"))[0] == 0
        code, _, complaints = await call
        assert code == 0, complaints
        assert "decide walker" in complaints, complaints + " is what the caller sees"
        assert "ASKS" not in "".join((await run("ls"))[1:])
