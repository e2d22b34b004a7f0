"""The files of a log: what is damaged or missing is named. The rest is examined in `test_log_places.py`."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robotree.vr.base.errors import DamagedJournal, JournalInUse, LostJournal
from robotree.vr.journal.segments import HEAD, OSDisk, Segments
from robotree.vr.world.disk import MemoryDisk

BOOT = "this start of the machine"


def written(folder: Path, *bodies: bytes) -> Path:
    """Write a file of frames; returns it."""
    log = Segments(folder, OSDisk(), BOOT)
    log.begin()
    for body in bodies:
        log.write(bytearray(bytes(HEAD.size) + body))
    log.close()
    return max(folder.glob("*.log"))


def read(folder: Path, boot: str = "another") -> list[bytes]:
    log = Segments(folder, OSDisk(), boot)
    try:
        return list(log.frames())
    finally:
        log.close()


def test_a_frame_that_was_cut_short_is_left_out_wherever_it_was_cut(tmp_path: Path) -> None:
    file = written(tmp_path, b"first", b"second")
    data = file.read_bytes()
    first = HEAD.size + len(b"first")
    for end in range(first, len(data)):
        file.write_bytes(data[:end])
        assert read(tmp_path) == [b"first"]


def test_each_flipped_bit_is_damage_and_never_lost_in_silence(tmp_path: Path) -> None:
    file = written(tmp_path, b"first", b"second")
    data = file.read_bytes()
    for at in range(len(data)):
        for bit in range(8):
            file.write_bytes(data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :])
            with pytest.raises(DamagedJournal, match=re.escape(str(file))):
                read(tmp_path)


def test_an_older_file_may_be_cut_short_for_the_next_process_may_have_ended_before_its_own_was_whole(
    tmp_path: Path,
) -> None:
    older = written(tmp_path, b"first", b"second")
    older.write_bytes(older.read_bytes()[:-1])
    written(tmp_path)
    assert read(tmp_path) == [b"first"]


@pytest.mark.parametrize("seed", range(50))
def test_after_a_loss_of_power_all_that_was_synced_is_there_and_nothing_else_makes_it_unreadable(
    seed: int,
) -> None:
    disk, chance = MemoryDisk(), random.Random(seed)
    log = Segments(tmp := Path("/h"), disk)
    log.begin()
    log.write(bytearray(bytes(HEAD.size) + b"old" * 300))
    for body in (b"new", b"newer"):
        log.begin()
        log.write(bytearray(bytes(HEAD.size) + body))
        log.sync()
        log.drop_older()
    log.write(bytearray(bytes(HEAD.size) + b"loose" * 1000))
    disk.end()
    disk.medium.lose_power(chance)
    log = Segments(tmp, MemoryDisk(disk.medium))
    assert b"newer" in list(log.frames(lambda: True))
    log.begin()
    log.clear()
    log.close()
    disk.medium.lose_power(chance)
    assert list(Segments(tmp, MemoryDisk(disk.medium)).frames()) == []


LOSSES: dict[str, tuple[Callable[[Path], object], str]] = {
    "one byte": (
        lambda file: os.truncate(file, file.stat().st_size - 1),
        "1 bytes at the end of 00000002.log",
    ),
    "a frame": (
        lambda file: os.truncate(file, file.stat().st_size - HEAD.size - len(b"second")),
        "18 bytes at the end of 00000002.log are missing",
    ),
    "all of it": (lambda file: os.truncate(file, 0), "00000002.log is missing"),
    "the file": (Path.unlink, "00000002.log is missing"),
}


@pytest.mark.parametrize("loss", LOSSES)
def test_what_somebody_takes_away_is_missed(tmp_path: Path, loss: str) -> None:
    take_away, words = LOSSES[loss]
    written(tmp_path, b"old")
    take_away(written(tmp_path, b"first", b"second"))
    with pytest.raises(LostJournal, match=words):
        read(tmp_path, BOOT)


@pytest.mark.parametrize("loss", LOSSES)
def test_what_a_loss_of_power_takes_away_is_told(tmp_path: Path, loss: str) -> None:
    take_away, words = LOSSES[loss]
    written(tmp_path, b"old")
    take_away(written(tmp_path, b"first", b"second"))
    log = Segments(tmp_path, OSDisk(), "the next start")
    assert list(log.frames()) in ([b"old", b"first"], [b"old"])
    assert words in log.missing
    log.close()


def test_a_mark_that_was_never_finished_says_nothing(tmp_path: Path) -> None:
    file = written(tmp_path, b"first", b"second")
    mark = (tmp_path / "lock").read_bytes()
    file.write_bytes(file.read_bytes()[:-1])
    for end in range(len(mark)):
        (tmp_path / "lock").write_bytes(mark[:end])
        assert read(tmp_path, BOOT) == [b"first"]


def test_a_name_that_is_no_file_of_the_log_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.log").write_text("mine")
    written(tmp_path, b"first")
    assert read(tmp_path) == [b"first"]
    assert (tmp_path / "notes.log").read_text() == "mine"


def test_a_process_that_a_page_has_forked_keeps_no_lock(tmp_path: Path) -> None:
    """Its parent is killed, and the next host takes the folder while the child lives on."""
    program = """
import os, sys, time
from pathlib import Path
from robotree.vr.journal.segments import OSDisk, Segments
segments = Segments(Path(sys.argv[1]), OSDisk())
segments.begin()
if os.fork() == 0:
    print(os.getpid(), flush=True)
    time.sleep(30)
    os._exit(0)
time.sleep(30)
"""
    words = [sys.executable, "-c", program, str(tmp_path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        try:
            with pytest.raises(JournalInUse):
                Segments(tmp_path, OSDisk())
            process.kill()
            process.wait()
            assert Path(f"/proc/{child}/comm").exists(), "the child lives"
            Segments(tmp_path, OSDisk()).close()
        finally:
            os.kill(child, signal.SIGKILL)
