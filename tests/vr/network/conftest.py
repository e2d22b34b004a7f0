from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from robotree.vr.base.transport import Transport
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.world.network import MemoryNetwork
from tests.vr.network.processes import Process, Start


@pytest.fixture
async def join_realm(place: Path) -> AsyncIterator[Callable[[], Awaitable[LocalTransport]]]:
    """Enter a realm of this test alone; members that are still in it at the end are closed."""
    members: list[LocalTransport] = []

    async def enter() -> LocalTransport:
        members.append(await join("test", root=place / "robotree"))
        return members[-1]

    yield enter
    for member in members:
        await member.close()


@pytest.fixture
def join_memory() -> Callable[[], Awaitable[Transport]]:
    network = MemoryNetwork()

    async def enter() -> Transport:
        return network.join()

    return enter


@pytest.fixture
async def start(place: Path) -> AsyncIterator[Start]:
    """Start members of the test's realm; all are killed at the end."""
    started: list[Process] = []

    async def begin(word: str, name: str) -> Process:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, str(Path(__file__).with_name("member.py")), word, name),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            env={**os.environ, "XDG_RUNTIME_DIR": str(place), "ROBOTREE_REALM": "test"},
        )
        started.append(Process(process))
        return started[-1]

    try:
        yield begin
    finally:
        for member in started:
            with contextlib.suppress(ProcessLookupError):
                member.process.kill()
            await member.process.communicate()
