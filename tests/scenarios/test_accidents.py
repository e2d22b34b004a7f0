"""What goes wrong on an ordinary day, with real processes: nothing else may suffer from it."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.processes.crew import Crew
from robotree.vr.supervision.realm_client import RealmClient
from tests.command_line import ROBOTREE, within_realm

pytestmark = pytest.mark.e2e

REALM = "faults"
AUTHOR = '''
"""Talkative: prints more than a pipe holds, then waits."""
from robotree.vr import VirtualRobot, command

class Talkative(VirtualRobot):
    """Talks."""

    @command
    def talk(self) -> int:
        """Print three megabytes."""
        for _ in range(3000):
            print("x" * 1000)
        return 3000

    @command
    def wait(self) -> None:
        """Wait for a minute."""
        self.progress(0.5, "waiting")
        self.sleep(60)
'''


async def start(*words: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *(*ROBOTREE, *words, "--realm", REALM),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )


async def robotree(*words: str) -> tuple[int, str]:
    code, out, _ = await within_realm(REALM)(*words)
    return code, out


@pytest.fixture
async def crew(place: Path) -> AsyncIterator[Crew]:
    """A lookup service, and a host with a talkative robot."""
    source = place / "talkative.py"
    source.write_text(AUTHOR)
    async with Crew(REALM, place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        assert await robotree("create", str(source), "as", "talker") == (
            exit_codes.DONE,
            "talker (Talkative) runs on host-1\n",
        )
        yield crew


@pytest.fixture
async def realm_client(crew: Crew) -> AsyncIterator[RealmClient]:
    """One who looks on: a process of its own for each look would cost most of these tests' time."""
    del crew  # there before it, and longer
    async with joined(REALM) as realm_client:
        yield realm_client


@pytest.mark.usefixtures("crew")
async def test_an_author_who_prints_does_not_block_the_host() -> None:
    code, out = await robotree("call", "talker.talk", "--json")
    assert (code, json.loads(out)) == (exit_codes.DONE, 3000)


async def until_busy(
    realm_client: RealmClient, command: str, caller: asyncio.subprocess.Process | None = None
) -> None:
    """Wait until the robot carries a command out, or none; well before it would end by itself."""
    async with asyncio.timeout(60):
        while (await realm_client.describe("talker")).busy != command:
            if caller is not None and caller.returncode is not None:
                pytest.fail(f"its caller has ended: {await caller.communicate()}")
            await asyncio.sleep(0.02)


async def test_a_verb_that_is_told_to_end_takes_its_command_with_it(realm_client: RealmClient) -> None:
    call = await start("call", "talker.wait")
    await until_busy(realm_client, "wait", call)
    call.terminate()
    assert await asyncio.wait_for(call.wait(), 60) == exit_codes.INTERRUPTED
    assert not (await realm_client.describe("talker")).busy


async def test_a_killed_verb_takes_its_command_with_it_unless_it_was_detached(
    realm_client: RealmClient, place: Path
) -> None:
    script = place / "a.session"
    script.write_text("call talker.wait\n")
    for words in (("call", "talker.wait"), ("run", str(script))):
        caller = await start(*words)
        await until_busy(realm_client, "wait", caller)
        caller.kill()
        await caller.wait()
        await until_busy(realm_client, "")
    code, out = await robotree("call", "talker.wait", "--detach")
    assert (code, out.split(";")[0]) == (exit_codes.DONE, "talker.wait has begun and goes on by itself")
    await until_busy(realm_client, "wait")
    await robotree("cancel", "talker")
    await until_busy(realm_client, "")
