"""The disk in memory: it does what the real one does, and loses with the power what was not synced."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.base.errors import JournalInUse
from robotree.vr.journal.segments import HEAD, Disk, OSDisk, Segments
from robotree.vr.world.disk import SECTOR, Medium, MemoryDisk

FOLDER = Path("/h1")


def result_of(work: Callable[[], Any]) -> object:
    """Return what a call of a disk returns, or the number of its error."""
    try:
        result = work()
    except OSError as error:
        return type(error).__name__
    return sorted(result) if isinstance(result, list) else result


def played(disk: Disk, folder: Path, chance: random.Random) -> list[object]:
    """Do what chance has it with a disk; returns all that it answers."""
    opened: list[int] = []
    answers: list[object] = []
    lock = result_of(lambda: disk.lock(folder))
    answers += [isinstance(lock, int), result_of(lambda: disk.lock(folder))]
    for _ in range(40):
        path = folder / chance.choice(["1.log", "2.log"])
        match chance.randrange(6):
            case 0:
                made = result_of(lambda path=path: disk.create(path))
                opened += [made] if isinstance(made, int) else []
                answers.append("made" if isinstance(made, int) else made)
            case 1 if opened:
                data, to = chance.randbytes(5), chance.choice(opened)
                answers.append(result_of(lambda data=data, to=to: disk.write(to, data)))
            case 2 if opened:
                to = chance.choice(opened)
                answers.append(result_of(lambda to=to: disk.sync(to)))
            case 3:
                answers.append(result_of(lambda path=path: disk.unlink(path)))
            case 4:
                answers.append(result_of(lambda path=path: disk.read(path)))
            case _:
                names = result_of(lambda: disk.names(folder))
                answers.append([name for name in names if name != "lock"])  # type: ignore[attr-defined]
    answers.append(result_of(lambda: disk.sync_folder(folder)))
    for number in opened:
        disk.close(number)
    if isinstance(lock, int):
        disk.close(lock)
    return answers


@pytest.mark.parametrize("seed", range(20))
def test_it_answers_as_the_disk_of_the_operating_system(seed: int, tmp_path: Path) -> None:
    real = played(OSDisk(), tmp_path / "h", random.Random(seed))
    assert played(MemoryDisk(), tmp_path / "h", random.Random(seed)) == real


def written(disk: MemoryDisk, *bodies: bytes) -> Segments:
    log = Segments(FOLDER, disk)
    log.begin()
    for body in bodies:
        log.write(bytearray(bytes(HEAD.size) + body))
    return log


def read(medium: Medium) -> list[bytes]:
    log = Segments(FOLDER, MemoryDisk(medium))
    try:
        return list(log.frames())
    finally:
        log.close()


def test_a_process_that_is_killed_loses_nothing_that_was_written_and_holds_no_lock() -> None:
    disk = MemoryDisk()
    written(disk, b"first", b"second")
    with pytest.raises(JournalInUse):
        Segments(FOLDER, MemoryDisk(disk.medium))
    disk.end()
    assert read(disk.medium) == [b"first", b"second"]


def test_what_was_not_synced_is_lost_or_torn_with_the_power_and_what_was_synced_is_there() -> None:
    lengths: set[int] = set()
    holes = 0
    for seed in range(100):
        disk = MemoryDisk()
        number = disk.lock(FOLDER) and disk.create(FOLDER / "1.log")
        disk.write(number, b"s" * 100)
        disk.sync(number)
        disk.sync_folder(FOLDER)
        disk.write(number, b"u" * 4 * SECTOR)
        disk.end()
        disk.medium.lose_power(random.Random(seed))
        data = MemoryDisk(disk.medium).read(FOLDER / "1.log")
        assert data.startswith(b"s" * 100)
        lengths.add(len(data))
        holes += b"\0" in data
    assert len(lengths) > 50
    assert holes > 5


def test_a_name_that_was_not_synced_may_be_lost_or_back() -> None:
    found: set[tuple[str, ...]] = set()
    for seed in range(50):
        disk = MemoryDisk()
        disk.lock(FOLDER)
        disk.create(FOLDER / "old")
        disk.sync_folder(FOLDER)
        disk.create(FOLDER / "new")
        disk.unlink(FOLDER / "old")
        disk.end()
        disk.medium.lose_power(random.Random(seed))
        found.add(tuple(sorted(MemoryDisk(disk.medium).names(FOLDER))))
    assert found == {(), ("new",), ("old",), ("new", "old")}


def test_a_disk_without_room_takes_a_part_and_then_nothing() -> None:
    disk = MemoryDisk()
    disk.lock(FOLDER)
    number = disk.create(FOLDER / "1.log")
    disk.medium.room = 3
    assert disk.write(number, b"12345") == 3
    with pytest.raises(OSError, match="No space"):
        disk.write(number, b"45")
    disk.medium.broken = True
    with pytest.raises(OSError, match="Read-only"):
        disk.unlink(FOLDER / "1.log")


def test_each_moment_of_a_write_has_a_name_and_its_parts_are_there_then() -> None:
    moments: list[tuple[str, int]] = []
    disk = MemoryDisk(
        moment=lambda name: moments.append((name, len(disk.read(FOLDER / "1")))) if "write" in name else None
    )
    disk.lock(FOLDER)
    disk.write(disk.create(FOLDER / "1"), b"1234")
    assert moments == [("before write", 0), ("within write", 2), ("after write", 4)]


def test_an_old_copy_of_a_disk_can_be_put_back() -> None:
    disk = MemoryDisk()
    log = written(disk, b"first")
    copy = disk.medium.copy()
    log.write(bytearray(bytes(HEAD.size) + b"second"))
    disk.end()
    disk.medium.put_back(copy)
    assert read(disk.medium) == [b"first"]
