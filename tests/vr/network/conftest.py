"""Realms for tests: members in this process, and in processes of their own, and what is done to them."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import pytest

from robotree.vr.base.transport import Transport
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.world.network import MemoryNetwork

Enter = Callable[[], Awaitable[LocalTransport]]


@pytest.fixture
async def join_realm(place: Path) -> AsyncIterator[Enter]:
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


class Process:
    """A member of a realm in a process of its own."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process

    async def ready(self) -> None:
        assert self.process.stdout is not None
        async with asyncio.timeout(60):
            line = await self.process.stdout.readline()
        assert line.strip() == b"ready", (await self.end())[1]

    def signal(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    async def freeze(self) -> None:
        """Stop it; returns when all its threads have stopped, which a busy machine takes its time for."""
        self.signal(signal.SIGSTOP)
        async with asyncio.timeout(10):
            while not _has_stopped(self.process.pid):  # noqa: ASYNC110 # the kernel tells nobody
                await asyncio.sleep(0.001)

    async def end(self, within: float = 60) -> tuple[int, str]:
        """Let it end, and return its exit code and what it complained of."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        async with asyncio.timeout(within):
            _, complaints = await self.process.communicate()
        assert self.process.returncode is not None
        return self.process.returncode, complaints.decode()


def _has_stopped(pid: int) -> bool:
    """Whether all threads of a process are in the state T: proc_pid_stat(5)."""
    stats = [task / "stat" for task in Path(f"/proc/{pid}/task").iterdir()]
    return all(stat.read_text().rpartition(")")[2].split()[0] == "T" for stat in stats)


Start = Callable[..., Awaitable[Process]]


async def start_all(start: Start, *members: tuple[str, str]) -> list[Process]:
    """Start members and wait until all are ready; for each one its role in `member.py`, and its name."""
    started = [await start(*member) for member in members]
    await asyncio.gather(*(member.ready() for member in started))
    return started


def remove(folder: Path) -> None:
    """Remove a folder in one step: its processes look for their names all the time, and make them again."""
    aside = folder.with_name("removed")
    folder.rename(aside)
    shutil.rmtree(aside)
