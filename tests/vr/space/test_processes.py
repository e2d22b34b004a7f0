"""Spaces, their users and their database as real processes, which are killed."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import resource
import signal
import subprocess
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.errors import SpaceError, SpaceLost, VrError
from robotree.vr.base.requests import EntriesFound, EntryLeased, FindEntries, WriteEntry
from robotree.vr.exchange.asking import ask
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.space.postgres import PostgresStore
from robotree.vr.world.examine_space import job
from tests.command_line import NO_BYTECODE, ROBOTREE, robotree
from tests.vr.space.postgres import server
from tests.waiting import PATIENCE

pytestmark = pytest.mark.e2e
KEY = "caller/test"


@contextlib.contextmanager
def space(*words: str | Path, limit: int = 0) -> Iterator[subprocess.Popen[str]]:
    """Have the space `jobs` for the time of a block.

    Args:
        *words: options.
        limit: [bytes] of its largest file; 0: none.
    """

    def narrow() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    line = [*ROBOTREE, "space", "serve", "jobs", *map(str, words)]
    with subprocess.Popen(
        line,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **NO_BYTECODE},
        preexec_fn=narrow if limit else None,  # noqa: PLW1509
    ) as process:
        try:
            assert process.stdout
            assert process.stdout.readline().startswith("ready space/jobs/")
            yield process
        finally:
            process.kill()


class User:
    """A program that asks the space that runs."""

    def __init__(self, transport: LocalTransport) -> None:
        self.transport = transport
        self.key = ""
        """Of the space that was asked last."""

    async def ask(self, request: Any, answer: type[Any]) -> Any:
        if self.key not in self.transport.presence.keys("space/jobs/*"):
            assert await self.transport.presence.until("space/jobs/*", there=True, within=PATIENCE)
            (self.key,) = self.transport.presence.keys("space/jobs/*")
        key = self.key
        return await ask(self.transport, key, request, answer, timeout=PATIENCE, sender=KEY)

    async def write(self, number: int, **fields: Any) -> None:
        await self.ask(WriteEntry(entry=job(number, **fields)), EntryLeased)

    async def take(self, within: float = 0.0, most: int = 1000) -> list[int]:
        request = FindEntries(kind="Job", take=True, within=within, most=most)
        found = await self.ask(request, EntriesFound)
        return [entry.fields["number"] for _, entry in found.entries]


@pytest.fixture
async def user(place: Path) -> AsyncIterator[User]:  # noqa: ARG001 # where they meet
    transport = await join()
    await transport.announce(KEY)
    yield User(transport)
    await transport.close()


async def test_what_an_owner_that_is_killed_has_answered_is_there(user: User, tmp_path: Path) -> None:
    acknowledged: list[int] = []
    number = 0
    for _ in range(2):
        with space("--store", tmp_path / "s.db") as owner:
            for _ in range(100):
                number += 1
                await user.write(number)
                acknowledged.append(number)
            writing = [asyncio.create_task(user.write(number + more + 1)) for more in range(50)]
            await asyncio.sleep(0.003)  # some of these are done, one is under way
            owner.kill()
            ended = await asyncio.gather(*writing, return_exceptions=True)
            acknowledged += [number + more + 1 for more, error in enumerate(ended) if error is None]
            assert all(error is None or isinstance(error, VrError) for error in ended)
            number += 50
            assert await user.transport.presence.until("space/jobs/*", there=False, within=PATIENCE)
    with space("--store", tmp_path / "s.db"):
        found = await user.take()
    assert found == sorted(found)
    assert set(acknowledged) <= set(found), "each that was answered is there"


async def test_a_disk_that_takes_no_more_is_one_sentence_and_the_space_goes_on(
    user: User, tmp_path: Path
) -> None:
    with space("--store", tmp_path / "s.db", limit=600_000):
        written = 0
        told = ""
        while not told and written < 100:
            try:
                await user.write(written, note="x" * 20_000)
            except SpaceError as error:
                told = str(error)
            else:
                written += 1
        assert written > 3
        assert "cannot be written or read (disk I/O error); nothing was changed" in told
        assert "\n" not in told
        listed = json.loads(robotree("space", "ls", "--json").stdout)
        assert listed[0]["counts"] == {"Job": written}, "nothing of the last one was kept"
    with space("--store", tmp_path / "s.db"):
        assert await user.take() == list(range(written))


async def test_people_look_into_a_space(user: User) -> None:
    with space():
        assert "no space 'other' runs in this realm" in robotree("space", "ls", "other").stderr
        await user.write(1, place="hall")
        listed = robotree("space", "ls").stdout.splitlines()
        assert listed[0].split() == ["SPACE", "ENTRIES", "TRANSACTIONS", "WAITING", "SURVIVES", "STORE"]
        assert listed[1].split()[:5] == ["jobs", "1", "0", "0", "process"]
        shown = robotree("space", "ls", "jobs", "Job").stdout
        assert "number=1 place='hall'" in shown
        assert "for ever" in shown


async def test_a_database_that_restarts_is_connected_to_again() -> None:
    with server("fsync=off") as database:
        store = await asyncio.to_thread(PostgresStore, "jobs", database.url)
        store.write(job(1), 60.0, "", "")
        database.stop()
        with pytest.raises(SpaceLost, match="nobody knows if that was done"):
            store.write(job(2), 60.0, "", "")
        with pytest.raises(SpaceError, match="cannot be used") as caught:
            store.find("Job", {}, "", take=False, most=9)
        assert "\n" not in str(caught.value)
        database.start()
        found = store.find("Job", {}, "", take=True, most=9)
        assert [row.entry.fields["number"] for row in found] == [1]
        store.close()
