from __future__ import annotations

import asyncio
import os
import random
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from robotree.vr import Robot, command
from robotree.vr.errors import BrokenSpace
from robotree.vr.space import Space
from robotree.vr.space.memory import MemorySpace
from robotree.vr.space.sqlite import SqliteSpace
from robotree.vr.space.testing import check_space


class Rover(Robot):
    """A rover."""

    @command
    def move(self) -> None: ...


async def test_the_memory_space_keeps_its_promises() -> None:
    space = MemorySpace()

    async def open_space() -> Space:
        return space

    await check_space(open_space, durable=True)


async def test_the_file_keeps_its_promises(tmp_path: Path) -> None:
    async def open_space() -> Space:
        return SqliteSpace(tmp_path / "new" / "space.db")

    await check_space(open_space, durable=True)


async def test_several_processes_add_to_one_sum(tmp_path: Path) -> None:
    spaces = [SqliteSpace(tmp_path / "space.db") for _ in range(3)]
    for _ in range(100):
        for space in spaces:
            space.add("calls")
    for space in spaces:
        await space.close()
    again = SqliteSpace(tmp_path / "space.db")
    assert await again.read("") == {"calls": 300}
    await again.close()


def test_a_file_that_is_no_space_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "space.db"
    path.write_text("a shopping list, longer than the header of a database would be, by and large")
    with pytest.raises(
        BrokenSpace, match=r"cannot be used as a space: .*; move it away, and a new one is made"
    ):
        SqliteSpace(path)
    assert path.read_text().startswith("a shopping list")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BrokenSpace):
        SqliteSpace(tmp_path / "file" / "space.db")


async def test_what_cannot_be_written_now_is_written_later(tmp_path: Path) -> None:
    space = SqliteSpace(tmp_path / "space.db")
    space._connection.execute("PRAGMA busy_timeout=1")
    other = sqlite3.connect(tmp_path / "space.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    space.add("calls")
    assert await space.read("") == {}
    other.execute("ROLLBACK")
    other.close()
    assert await space.read("") == {"calls": 1}
    await space.close()
    with pytest.raises(BrokenSpace, match="it is closed here"):
        await space.read("")


def open_to_others(path: Path) -> list[int]:
    """The permissions of a space's files that it has by now."""
    return [one.stat().st_mode & 0o777 for one in sorted(path.parent.glob(f"{path.name}*"))]


async def test_a_space_is_for_its_owner_alone(tmp_path: Path) -> None:
    space = SqliteSpace(tmp_path / "new" / "space.db")
    space.add("calls")
    assert await space.read("") == {"calls": 1}
    assert open_to_others(space.path) == [0o600] * 3  # the file, and the two that SQLite keeps beside it
    assert space.path.parent.stat().st_mode & 0o777 == 0o700
    await space.close()


async def test_a_space_that_was_open_to_others_is_closed_and_that_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "space.db"
    before = SqliteSpace(path)
    before.add("calls")
    await before.read("")
    for end in ("", "-wal", "-shm"):
        os.chmod(f"{path}{end}", 0o644)  # noqa: PTH101 # three of one name
    again = SqliteSpace(path)
    assert open_to_others(path) == [0o600] * 3
    assert caplog.messages == [
        f"{path} was open to other users of this machine; from now on only you can open it"
    ]
    for space in (before, again):
        await space.close()


async def test_a_space_of_an_earlier_version_keeps_its_sums(tmp_path: Path) -> None:
    former = sqlite3.connect(tmp_path / "space.db", isolation_level=None)
    former.execute("PRAGMA journal_mode=WAL")
    former.execute(
        "CREATE TABLE IF NOT EXISTS variable (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID"
    )
    former.execute("INSERT INTO variable VALUES ('calls/arm-1/grip', 41)")
    former.close()
    for expected in (42, 43):
        space = SqliteSpace(tmp_path / "space.db")
        space.add("calls/arm-1/grip")
        assert await space.read("") == {"calls/arm-1/grip": expected}
        await space.close()


@pytest.mark.timeout(10)
@pytest.mark.parametrize("device", ["fifo", "/dev/zero"])
def test_a_space_that_is_no_file_is_refused_at_once(tmp_path: Path, device: str) -> None:
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(BrokenSpace, match=r"it is a (FIFO|device), not a file"):
        SqliteSpace(tmp_path / device)


async def test_no_flipped_bit_is_believed(tmp_path: Path) -> None:
    """A file with one bit changed is refused, or what it says is unchanged: that bit meant nothing."""
    path, chance = tmp_path / "space.db", random.Random(7)
    sums = {f"calls/arm-{number}/grip": 10**number for number in range(9)}
    whole = SqliteSpace(path)
    for name, value in sums.items():
        whole.add(name, value)
    await whole.close()
    intact = path.read_bytes()
    row = intact.index(b"calls/arm-7/grip")  # beside it lie its value and its checksum
    spots = [*range(row - 8, row + 26), *range(110), *chance.sample(range(len(intact)), 60)]
    refused = 0
    for spot in spots:
        flipped = bytearray(intact)
        flipped[spot] ^= 1 << chance.randrange(8)
        path.write_bytes(flipped)
        for end in ("-wal", "-shm"):
            path.with_name(path.name + end).unlink(missing_ok=True)
        try:
            space = SqliteSpace(path)
        except BrokenSpace:
            refused += 1
            continue
        assert await space.read("") == sums, f"bit flipped in byte {spot}"
        await space.close()
    assert refused > 60


async def test_a_sum_that_is_damaged_meanwhile_is_neither_read_nor_added_to(tmp_path: Path) -> None:
    space = SqliteSpace(tmp_path / "space.db")
    space.add("calls", 5)
    await space.read("")
    other = sqlite3.connect(tmp_path / "space.db", isolation_level=None)
    other.execute("UPDATE sums SET value = 4")
    space.add("calls")
    with pytest.raises(BrokenSpace, match="a sum does not fit its checksum"):
        await space.read("")
    assert other.execute("SELECT value FROM sums").fetchall() == [(4,)]
    other.execute("UPDATE sums SET value = 5")
    other.close()
    assert await space.read("") == {"calls": 6}
    await space.close()


async def test_call_counts_survive_a_restart_of_the_robot_and_of_its_process(
    realm: Any, tmp_path: Path
) -> None:
    for expected in (1, 2, 3):
        space = SqliteSpace(tmp_path / "space.db")
        rover = await realm.start(Rover("rover"), space=space)
        await realm.client(rover).call("move", {})
        assert rover.description().calls == {"move": expected}
        realm.kill(rover)
        await space.close()
        await asyncio.sleep(0.5)
