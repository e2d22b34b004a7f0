"""What a simulated controller keeps of its earlier lives."""

from __future__ import annotations

import json
import os
import stat
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from pathlib import Path

import pytest

from robotree.protocol.services.fence import LAST_EPOCH
from robotree.sim.controller import fence_file
from robotree.sim.controller.fence_file import FenceFile
from robotree.sim.errors import MemoryLost


def reopened(path: Path, *, reset: bool = False) -> FenceFile:
    file = FenceFile(path, reset=reset)
    file.close()
    return file


def test_what_was_granted_is_known_after_a_restart_and_the_life_is_another_one(tmp_path: Path) -> None:
    path = tmp_path / "fence.json"
    first = FenceFile(path)
    first.fence.grant(1000, 77, "arm-1")
    assert first.fence.admit(1005) is None
    second = reopened(path)  # without `close`: as after kill -9
    assert (second.fence.epoch, second.fence.holder, second.fence.name) == (1005, 77, "arm-1")
    assert second.life == first.life + 1
    assert second.trouble == ""
    first.close()


def test_the_file_is_for_its_owner_alone_and_no_draft_is_left(tmp_path: Path) -> None:
    path = tmp_path / "fence.json"
    reopened(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    names = [".fence.json.known", "fence.json", "fence.json.copy"]
    assert sorted(each.name for each in tmp_path.iterdir()) == names


@pytest.mark.parametrize(
    "garbage",
    [
        b"",
        b"\xff\xfe\x00",
        b"[]",
        b"{}",
        b"[" * 3000,
        b'{"epoch": -1, "holder": 0, "name": "", "life": 1}',
        b'{"epoch": true, "holder": 0, "name": "", "life": 1}',
        json.dumps({"epoch": LAST_EPOCH + 1, "holder": 0, "name": "", "life": 1}).encode(),
        b"x" * 10_000,
    ],
)
def test_garbage_is_reported_and_what_was_granted_before_now_is_refused(
    tmp_path: Path, garbage: bytes
) -> None:
    path = tmp_path / "fence.json"
    path.write_bytes(garbage)
    now = int(time.time())
    file = reopened(path)
    assert str(path) in file.trouble
    assert now <= file.fence.epoch <= now + 5
    assert file.fence.admit(now - 100) is not None
    assert file.fence.admit(now + 3600) is None
    assert reopened(path).trouble == "", "the next start finds what this one has written"


def test_a_fifo_or_a_folder_in_its_place_stops_nobody(tmp_path: Path) -> None:
    fifo, folder = tmp_path / "fifo", tmp_path / "folder"
    os.mkfifo(fifo)
    folder.mkdir()
    for path in (fifo, folder, tmp_path / "missing" / "fence.json"):
        file = reopened(path)
        assert file.trouble
        assert file.fence.admit(int(time.time()) + 1) is None


def test_a_reset_forgets_the_epoch_but_not_the_number_of_the_life(tmp_path: Path) -> None:
    path = tmp_path / "fence.json"
    first = reopened(path)
    first.fence.grant(5000, 77, "arm-1")
    again = reopened(path, reset=True)
    assert (again.fence.epoch, again.fence.holder, again.life) == (0, 0, first.life + 1)
    assert reopened(path).fence.epoch == 0


def test_without_a_file_lives_are_told_apart_by_chance() -> None:
    lives = {FenceFile(None).life for _ in range(20)}
    assert len(lives) > 15
    assert 0 not in lives


def test_a_flood_of_epochs_makes_no_queue_at_the_disk_and_the_last_one_reaches_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, disk_is_free, synced = tmp_path / "fence.json", threading.Event(), list[int]()

    def fsync(handle: int) -> None:
        disk_is_free.wait(10.0)
        synced.append(os.fstat(handle).st_ino)

    monkeypatch.setattr(os, "fsync", fsync)
    file = FenceFile(path)
    for epoch in range(1, 200):
        assert file.fence.admit(epoch) is None
    disk_is_free.set()
    file.close()
    assert len(synced) <= 6, "both copies and their folder, once for what was under way and once for the rest"
    assert path.stat().st_ino in synced


def granted(path: Path) -> tuple[Path, Path]:
    """A file and its copy that know a lease."""
    file = FenceFile(path)
    file.fence.grant(1000, 77, "arm-1 \u00e4")
    file.close()
    return path, path.with_name(f"{path.name}.copy")


class AtOnce:
    """In place of an executor: no thread for each of some thousand files."""

    def __init__(self, *_: object, **__: object) -> None: ...

    def submit(self, work: Callable[..., None], *args: object) -> Future[None]:
        work(*args)
        done = Future[None]()
        done.set_result(None)
        return done

    def shutdown(self, **_: object) -> None: ...


@pytest.fixture
def memory() -> Iterator[Path]:
    """A folder in memory: a disk needs milliseconds for each file that is synced."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        yield Path(folder)


def test_no_flipped_bit_lowers_the_epoch_or_changes_the_holder(
    memory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fence_file, "ThreadPoolExecutor", AtOnce)
    files = granted(memory / "fence.json")
    whole = [each.read_bytes() for each in files]
    for damaged in (0, 1):
        for bit in range(8 * len(whole[damaged])):
            for file, data in zip(files, whole, strict=True):
                file.write_bytes(data)
            data = bytearray(whole[damaged])
            data[bit // 8] ^= 1 << bit % 8
            files[damaged].write_bytes(data)
            found = reopened(files[0])
            assert (found.fence.epoch, found.fence.holder, found.fence.name) == (1000, 77, "arm-1 \u00e4")
            assert f"{files[damaged]} is damaged; its copy is intact" in found.trouble
            assert reopened(files[0]).trouble == "", "it was mended"


@pytest.mark.parametrize("how", ["damaged", "deleted", "empty"])
def test_a_memory_that_is_lost_is_told_and_a_person_decides(tmp_path: Path, how: str) -> None:
    files = granted(tmp_path / "fence.json")
    for file in files:
        if how == "deleted":
            file.unlink()
        else:
            file.write_bytes(b"" if how == "empty" else file.read_bytes().replace(b"1000", b"1001"))
    for _ in range(2):
        with pytest.raises(MemoryLost, match="look at the robot, then start it once with --reset-epoch"):
            FenceFile(files[0])
    again = reopened(files[0], reset=True)
    assert again.trouble.endswith("any lease is obeyed now")
    assert reopened(files[0]).fence.epoch == 0


def test_one_deleted_copy_is_told_and_made_again(tmp_path: Path) -> None:
    files = granted(tmp_path / "fence.json")
    for file in files:
        file.unlink()
        found = reopened(files[0])
        assert (found.fence.epoch, found.fence.holder) == (1000, 77)
        assert f"{file} is missing" in found.trouble
        assert file.exists()


def test_of_two_copies_the_newer_one_counts(tmp_path: Path) -> None:
    """A process that is killed between two writes leaves an old copy."""
    first, copy = granted(tmp_path / "fence.json")
    old = copy.read_bytes()
    file = FenceFile(first)
    file.fence.grant(2000, 78, "arm-2")
    file.close()
    copy.write_bytes(old)
    assert reopened(first).fence.epoch == 2000


def test_a_file_of_an_earlier_version_is_understood_once(tmp_path: Path) -> None:
    path = tmp_path / "fence.json"
    path.write_text(json.dumps({"epoch": 1000, "holder": 77, "name": "arm-1", "life": 4}))
    found = reopened(path)
    assert (found.fence.epoch, found.fence.holder, found.life) == (1000, 77, 5)
    assert reopened(path).fence.epoch == 1000
