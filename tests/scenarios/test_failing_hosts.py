"""Hosts that freeze, end, or run code that does not end: the output of the command line."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew, Member
from tests.command_line import within_realm

pytestmark = pytest.mark.e2e

REALM = "failing"
robotree = within_realm(REALM)
AUTHOR = '''
"""Clerk: counts, and can be asked to ignore everybody."""
import contextlib
import time
from robotree.vr import VirtualRobot, command

class Clerk(VirtualRobot):
    """Counts."""

    @command
    def count(self) -> int:
        """Return a number."""
        return 1

    @command
    def defy(self) -> None:
        """Swallow every exception, for ever."""
        while True:
            with contextlib.suppress(BaseException):
                while True:
                    with contextlib.suppress(BaseException):
                        time.sleep(0.02)
'''


async def show(name: str) -> dict[str, Any]:
    code, out, complaints = await robotree("show", name, "--json")
    assert code == exit_codes.DONE, complaints
    return json.loads(out)  # type: ignore[no-any-return]


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    """A lookup service, a host, and a clerk on it."""
    (place / "clerk.py").write_text(AUTHOR)
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        await hire(place)
        yield crew


async def hire(folder: Path) -> None:
    code, _, complaints = await robotree("create", str(folder / "clerk.py"), "as", "clerk")
    assert code == exit_codes.DONE, complaints


def host(crew: Crew) -> Member:
    return next(member for member in crew.members if member.words[0] == "host")


async def test_a_stop_that_cannot_reach_a_frozen_host_is_no_success(crew: Crew) -> None:
    pid = host(crew).pid
    os.kill(pid, signal.SIGSTOP)
    try:
        code, out, complaints = await robotree("stop")
        assert (code, out) == (exit_codes.NOBODY, "")
        assert f"NOT by clerk (in process {pid}, which hangs); press the emergency stop" in complaints
        assert f"`kill -CONT {pid}` wakes it, `kill -9 {pid}` ends it" in complaints
        code, out, complaints = await robotree("show", "clerk")
        assert (code, out) == (exit_codes.NOBODY, "")
        assert f"is in process {pid}, which hangs and does not answer" in complaints
    finally:
        os.kill(pid, signal.SIGCONT)
    code, out, _ = await robotree("stop")
    assert (code, out) == (exit_codes.DONE, "stopped: clerk\n")


async def test_a_command_that_ignores_its_cancel_is_shown(crew: Crew) -> None:
    code, _, complaints = await robotree("call", "clerk.defy", "--within", "1 s")
    assert code == exit_codes.REFUSED
    assert "was not done within its deadline" in complaints
    assert (await show("clerk"))["abandoned"] == ["defy"]
    assert "ABANDONED: defy still runs" in (await robotree("show", "clerk"))[1]
    code, _, complaints = await robotree("call", "clerk.count")
    assert code == exit_codes.REFUSED
    assert "its defy was ended but still runs" in complaints
    assert "clerk.defy is abandoned: it ignores every cancel and still runs" in host(crew).log
    code, out, _ = await robotree("delete", "clerk")
    assert (code, out) == (
        exit_codes.DONE,
        "clerk is deleted, but its defy ignores every cancel and still runs; restart host host-1\n",
    )
