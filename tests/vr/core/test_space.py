from __future__ import annotations

import asyncio
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
