"""Places for a log, as `journal/store.py` says: one examination for all, and what files name as damaged."""

from __future__ import annotations

import contextlib
import os
import random
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path

import pytest

from robotree.vr.base.errors import DamagedJournal, Deposed, JournalInUse, LostJournal
from robotree.vr.journal.files import FilePlace
from robotree.vr.journal.postgres import PostgresPlace
from robotree.vr.journal.segments import HEAD, OSDisk, Segments
from robotree.vr.journal.store import LogPlace, LogStore, own
from robotree.vr.world.disk import MemoryDisk
from tests.vr.space.postgres import Server, server

OpenPlace = Callable[[], LogPlace]
"""Returns a new view of one and the same place, as another process has it."""


def _frame(text: str) -> bytearray:
    return bytearray(bytes(HEAD.size) + text.encode())


def _texts(log: LogStore) -> list[str]:
    return [body.decode() for body in log.frames()]


def _refused(log: LogStore) -> None:
    """See that an owner that was deposed can let nothing leave."""
    for way in (log.expect_owner, log.beat):
        with pytest.raises(Deposed, match="h2"):
            way()


def examine_reading(place: OpenPlace) -> None:
    """What was written comes back in its order, over segments, until they are dropped."""
    assert place().look() is None, "a new place has no owner"
    log = own(place(), "h1")
    log.begin()
    log.write(_frame("one"))
    log.write(_frame(""))
    size = log.size
    log.write(_frame("two"))
    assert 0 < size < log.size
    log.close()
    log = own(place(), "h1")
    assert _texts(log) == ["one", "", "two"]
    log.begin()
    assert log.size == 0
    log.write(_frame("three"))
    log.sync()
    log.close()
    log = own(place(), "h1")
    assert _texts(log) == ["one", "", "two", "three"]
    log.begin()
    log.write(_frame("four"))
    log.drop_older()
    log.close()
    log = own(place(), "h1")
    assert _texts(log) == ["four"]
    log.begin()
    log.write(_frame("five"))
    log.clear()
    log.close()
    log = own(place(), "h1")
    assert _texts(log) == []
    log.close()


def examine_owners(place: OpenPlace) -> None:
    """A log has one owner; numbers grow; a beat is seen; who has closed it does not live."""
    log = own(place(), "h1")
    first = place().look()
    assert first is not None
    assert (first.host, first.lives) == ("h1", True), first
    with pytest.raises(JournalInUse, match="h1"):
        own(place(), "h9")
    assert place().take("h9", first.number - 1) is None, "somebody else came after that one"
    assert place().take("h9", first.number + 1) is None, "that one has not been the owner"
    log.beat()
    log.expect_owner()
    second = place().look()
    assert second is not None
    assert (second.number, second.host) == (first.number, "h1")
    assert second.beat != first.beat, "a sign of life is seen"
    log.close()
    log.close()
    third = place().look()
    assert third is not None
    assert (third.number, third.lives) == (first.number, False), third
    log = own(place(), "h1")
    fourth = place().look()
    assert fourth is not None
    assert fourth.number > first.number, "each owner has a higher number"
    log.close()


def examine_deposition(place: OpenPlace) -> None:
    """Who takes a log from an owner that lives reads all that it has let leave, and nothing after that."""
    old = own(place(), "h1")
    old.begin()
    old.write(_frame("one"))
    old.expect_owner()
    before = place().look()
    assert before is not None
    new = place().take("h2", before.number)
    assert new is not None
    found = _texts(new)
    assert found == ["one"]
    new.begin()
    new.write(_frame("two"))
    new.drop_older()
    _late(old)
    new.write(_frame("three"))
    new.expect_owner()
    new.close()
    old.close()
    log = own(place(), "h1")
    assert _texts(log) == ["two", "three"], "nothing of an owner that was deposed is read"
    log.close()


def _late(old: LogStore) -> None:
    """Have an owner that was deposed go on, as after a pause at any place."""
    ways: list[Callable[[], None]] = [
        lambda: old.write(_frame("late")),
        old.begin,
        lambda: old.write(_frame("later")),
        old.drop_older,
        lambda: old.write(_frame("last")),
        old.clear,
    ]
    for way in ways:
        with contextlib.suppress(Deposed, OSError):
            way()
    _refused(old)


def examine_rivals(place: OpenPlace, rivals: int = 8, rounds: int = 10) -> None:
    """Of several that take a log after the same owner exactly one gets it, each time."""
    own(place(), "h0").close()
    places = [place() for _ in range(rivals)]
    with ThreadPoolExecutor(rivals) as threads:
        for _ in range(rounds):
            owner = places[0].look()
            assert owner is not None
            number = owner.number
            attempts = [threads.submit(rival.take, "h2", number) for rival in places]
            got = [log for attempt in attempts if (log := attempt.result()) is not None]
            assert len(got) == 1, f"{len(got)} have the same log"
            got[0].expect_owner()
            got[0].close()
            following = places[1].look()
            assert following is not None
            assert following.number == number + 1


EXAMINATIONS = (examine_reading, examine_owners, examine_deposition, examine_rivals)


_names = count()


@pytest.fixture(scope="module")
def database() -> Iterator[Server]:
    """A server whose files need not survive anything."""
    with server("fsync=off", "full_page_writes=off", "autovacuum=off") as running:
        yield running


@pytest.fixture(params=["files", "postgres"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[OpenPlace]:
    if request.param == "files":
        yield lambda: FilePlace(tmp_path / "log")
        return
    running: Server = request.getfixturevalue("database")
    name, opened = f"test/{next(_names)}", list[PostgresPlace]()

    def open_place() -> PostgresPlace:
        opened.append(PostgresPlace(running.url, name))
        return opened[-1]

    yield open_place
    for each in opened:
        each.close()


@pytest.mark.parametrize("examine", EXAMINATIONS)
def test_a_place_for_a_log_keeps_the_rules(place: OpenPlace, examine: Callable[[OpenPlace], None]) -> None:
    examine(place)
    owner = place().look()
    assert owner is not None
    assert not owner.lives


# -- the files of a log: what is damaged or missing is named ---------------------------------------


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
