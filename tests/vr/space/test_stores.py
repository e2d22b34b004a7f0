"""The stores of a space keep the same promises; nothing that is in a file is lost in silence."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from robotree.vr.base.entry import Entry
from robotree.vr.base.errors import SpaceDamaged, SpaceError, SpaceFull, SpaceUnusable
from robotree.vr.base.requests import FOR_EVER
from robotree.vr.world.examine_space import OpenStore, TimedStore, do, find, job, write
from robotree.vr.world.testing import SPACE_CHECKS
from tests.vr.space.stores import Timed, sqlite


@pytest.mark.parametrize("check", SPACE_CHECKS, ids=lambda check: check.__name__)
def test_a_store_keeps_its_promises(check: Callable[[TimedStore], None], open_store: OpenStore) -> None:
    timed = open_store()
    try:
        check(timed)
    finally:
        timed.store.close()


# -- a file: what is wrong with it is said in one sentence, and nothing is lost in silence ---------


def filled(path: Path, count: int = 3) -> Timed:
    timed = sqlite(path)
    for number in range(count):
        write(timed, job(number, note=f"note-{number}-" * 10))
    return timed


def refusal(path: Path, error: type[SpaceError]) -> str:
    """What is said instead of opening a file; the file stays as it is."""
    before = path.read_bytes()
    with pytest.raises(error) as caught:
        sqlite(path)
    assert path.read_bytes() == before
    told = str(caught.value)
    assert str(path) in told
    assert "\n" not in told
    return told


def test_entries_and_epochs_survive_their_process(tmp_path: Path) -> None:
    path = tmp_path / "s.db"
    timed = filled(path)
    epoch = do(timed, timed.store.acquire, "door", "anna", 100.0).epoch
    open_ = do(timed, timed.store.open, 60.0)
    find(timed, take=True, within=open_)
    write(timed, job(9), within=open_)
    timed.store.close()
    again = sqlite(path)
    assert find(again, most=9) == [0, 1, 2], "what was not committed has done nothing"
    fence = do(again, again.store.acquire, "door", "bob", 1.0)
    assert (fence.granted, fence.holder, fence.epoch) == (False, "anna", epoch)
    again.store.close()


def test_a_lease_goes_on_while_nobody_serves_and_no_clock_makes_it_longer(tmp_path: Path) -> None:
    path = tmp_path / "s.db"
    timed = sqlite(path)
    for number, term in enumerate((10.0, 30.0)):
        write(timed, job(number), term=term)
    timed.store.close()
    later = sqlite(path)
    later.store.close()
    late = Timed()
    late.pass_time(20.0)
    late.store = type(later.store)("jobs", path, late.now, late.unix)  # type: ignore[call-arg]
    assert find(late, most=9) == [1]
    late.store.close()
    early = Timed()
    early.pass_time(-500.0)  # the clock was set back
    early.store = type(later.store)("jobs", path, early.now, early.unix)  # type: ignore[call-arg]
    early.pass_time(31.0)
    assert find(early, most=9) == []
    early.store.close()


def test_a_second_process_is_told_who_has_the_file(tmp_path: Path) -> None:
    timed = filled(tmp_path / "s.db")
    with pytest.raises(SpaceUnusable, match="another process owns it, and serves it; ask that one"):
        sqlite(tmp_path / "s.db")
    timed.store.close()


@pytest.mark.parametrize("at", ["note-1", "Job"])
def test_a_changed_byte_is_noticed(tmp_path: Path, at: str) -> None:
    path = tmp_path / "s.db"
    filled(path).store.close()
    content = bytearray(path.read_bytes())
    content[content.rindex(at.encode())] ^= 1
    path.write_bytes(content)
    told = refusal(path, SpaceDamaged)
    assert "is not as it was written" in told
    assert "put a copy back, or move it away" in told


def test_a_file_that_is_cut_off_or_garbage_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "s.db"
    filled(path, 200).store.close()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert "is damaged (" in refusal(path, SpaceDamaged)
    path.write_bytes(b"not a database at all" * 1000)
    assert "is damaged (file is not a database)" in refusal(path, SpaceDamaged)


def test_a_torn_log_loses_what_was_not_answered_alone(tmp_path: Path) -> None:
    """What a kill in the middle of a write leaves: the last record of the log is not whole."""
    path, copy = tmp_path / "s.db", tmp_path / "copy.db"
    timed = filled(path)
    log = Path(f"{path}-wal").read_bytes()
    write(timed, job(9))
    grown = Path(f"{path}-wal").read_bytes()
    copy.write_bytes(path.read_bytes())
    Path(f"{copy}-wal").write_bytes(grown[: len(log) + (len(grown) - len(log)) // 2])
    timed.store.close()
    again = sqlite(copy)
    assert find(again, most=9) == [0, 1, 2]
    again.store.close()


def test_a_database_of_another_program_or_version_is_left_alone(tmp_path: Path) -> None:
    other = tmp_path / "other.db"
    with sqlite3.connect(other) as file:
        file.execute("CREATE TABLE songs (title TEXT)")
    file.close()
    assert "it is a database of another program" in refusal(other, SpaceUnusable)
    path = tmp_path / "s.db"
    filled(path).store.close()
    with sqlite3.connect(path) as file:
        file.execute("PRAGMA user_version = 7")
    file.close()
    assert "it is of version 7, this robotree reads version 1" in refusal(path, SpaceUnusable)


def test_on_a_full_disk_nothing_changes_and_afterwards_it_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "s.db"
    timed = filled(path)
    file = timed.store._file._file  # type: ignore[attr-defined]
    pages = file.execute("PRAGMA page_count").fetchone()[0]
    file.execute(f"PRAGMA max_page_count = {pages + 5}")
    large = Entry(("Job",), {"number": 7, "note": "x" * 50_000})
    open_ = do(timed, timed.store.open, 60.0)
    find(timed, take=True, within=open_)
    do(timed, timed.store.write, large, FOR_EVER, "", open_)
    with pytest.raises(SpaceFull, match=r"the disk that holds .* is full; nothing was changed"):
        do(timed, timed.store.write, large, FOR_EVER, "k", "")
    assert find(timed, most=9) == [1, 2]
    with pytest.raises(SpaceFull):
        do(timed, timed.store.commit, open_)
    assert find(timed, most=9) == [0, 1, 2], "the transaction has done nothing"
    file.execute("PRAGMA max_page_count = 1000000")
    write(timed, job(8), key="k")
    assert find(timed, take=True, most=9) == [0, 1, 2, 8]
    timed.store.close()
    again = sqlite(path)
    assert find(again, most=9) == []
    again.store.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(SpaceUnusable, match="cannot be used"):
            sqlite(tmp_path / "s.db")
    finally:
        tmp_path.chmod(0o700)


def test_it_takes_no_more_than_its_limit(tmp_path: Path) -> None:
    timed = sqlite(tmp_path / "s.db", most=3)
    for number in range(3):
        write(timed, job(number), term=5.0)
    with pytest.raises(SpaceFull, match="it holds 3 entries, as many as it takes"):
        write(timed, job(3))
    timed.pass_time(6.0)
    write(timed, job(4))
    assert find(timed, most=9) == [4]
    timed.store.close()
