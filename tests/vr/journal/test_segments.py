"""The files of a log: what was written comes back, what is damaged is named, and one host writes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from robotree.vr.base.errors import DamagedJournal, JournalInUse
from robotree.vr.journal.segments import HEAD, OSDisk, Segments


def written(folder: Path, *bodies: bytes) -> Path:
    """Write a file of frames; returns it."""
    log = Segments(folder, OSDisk())
    log.begin()
    for body in bodies:
        log.write(bytearray(bytes(HEAD.size) + body))
    log.close()
    return max(folder.glob("*.log"))


def read(folder: Path) -> list[bytes]:
    log = Segments(folder, OSDisk())
    try:
        return list(log.frames())
    finally:
        log.close()


def test_what_was_written_is_read_in_its_order_over_all_files(tmp_path: Path) -> None:
    written(tmp_path, b"one", b"", b"two")
    written(tmp_path, b"three")
    assert read(tmp_path) == [b"one", b"", b"two", b"three"]


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


def test_an_older_file_without_its_end_is_damage(tmp_path: Path) -> None:
    older = written(tmp_path, b"first")
    older.write_bytes(older.read_bytes()[:-1])
    written(tmp_path, b"second")
    with pytest.raises(DamagedJournal, match="the end of the file is missing"):
        read(tmp_path)


def test_of_two_hosts_the_second_is_refused(tmp_path: Path) -> None:
    first = Segments(tmp_path, OSDisk())
    with pytest.raises(JournalInUse, match="end that one first"):
        Segments(tmp_path, OSDisk())
    first.close()
    Segments(tmp_path, OSDisk()).close()


def test_only_the_newest_file_stays_when_the_older_are_dropped(tmp_path: Path) -> None:
    written(tmp_path, b"one")
    log = Segments(tmp_path, OSDisk())
    log.begin()
    log.write(bytearray(bytes(HEAD.size) + b"two"))
    log.drop_older()
    log.close()
    assert read(tmp_path) == [b"two"]
