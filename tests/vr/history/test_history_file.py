"""Laws of the history: a chain of hashes that shows what is missing or changed, within bounds."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from robotree.vr.base.errors import HistoryUnusable
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import ReadEvents
from robotree.vr.history.file import HistoryFile


def called(key: str, robot: str = "arm", unix: float = 100.0, **more: object) -> HistoryEvent:
    return HistoryEvent(kind="accepted", unix=unix, robot=robot, key=key, command="go", **more)  # type: ignore[arg-type]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with ten events."""
    path = tmp_path / "history.db"
    file = HistoryFile(path, writes=True)
    for number in range(1, 11):
        file.append([called(f"k{number}", unix=100.0 + number)])
    file.close()
    return path


def spoil(path: Path, order: str) -> str:
    """Change the file behind its back; return what an examination says."""
    connection = sqlite3.connect(path)
    with connection:
        connection.execute(order)
    connection.close()
    file = HistoryFile(path)
    try:
        return file.verify().fault
    finally:
        file.close()


def test_what_was_written_is_verified_to_the_last_event(path: Path) -> None:
    file = HistoryFile(path)
    found = file.verify()
    file.close()
    assert (found.count, found.first, found.fault) == (10, 1, "")
    assert len(found.last_hash) == 64


@pytest.mark.parametrize(
    ("order", "fault"),
    [
        ("DELETE FROM event WHERE number = 4", "event 4 is missing"),
        ("DELETE FROM event WHERE number = 1", "event 1 is missing"),
        ("DELETE FROM event WHERE number > 8", "event 9 is missing"),
        ("UPDATE event SET body = replace(body, 'k5', 'kX') WHERE number = 5", "event 5 was changed"),
        ("UPDATE event SET body = CAST(body AS BLOB), unix = 7 WHERE number = 6", "event 6 was changed"),
        ("UPDATE event SET robot = 'leg' WHERE number = 7", "event 7 was changed"),
        ("UPDATE event SET hash = x'00' WHERE number = 10", "event 10 was changed"),
    ],
)
def test_the_first_event_that_is_missing_or_changed_is_named(path: Path, order: str, fault: str) -> None:
    assert spoil(path, order).startswith(fault)


def test_a_chain_whose_oldest_events_were_deleted_for_their_age_is_still_verified(path: Path) -> None:
    file = HistoryFile(path, writes=True)
    assert file.trim(now=1000.0, oldest=1000.0 - 104.5) == 4
    found = file.verify()
    assert (found.count, found.first, found.fault) == (6, 5, "")
    file.append([called("k11")])
    assert file.verify().fault == ""
    file.close()
    assert spoil(path, "DELETE FROM event WHERE number = 5").startswith("event 5 is missing")


def test_a_file_that_grows_beyond_its_bound_loses_its_oldest_events(tmp_path: Path) -> None:
    file = HistoryFile(tmp_path / "history.db", writes=True)
    largest = 1_000_000
    for batch in range(60):
        file.append([called(f"{batch}/{number}", arguments="x" * 1000) for number in range(100)])
        while file.trim(now=200.0, largest=largest):
            pass
    assert (tmp_path / "history.db").stat().st_size < 2 * largest
    file.append([called("last")])
    assert file.verify().fault == ""
    file.close()


def test_the_last_motion_of_a_robot_comes_with_all_that_led_to_it(tmp_path: Path) -> None:
    file = HistoryFile(tmp_path / "history.db", writes=True)
    file.append([called("a", "team"), called("a/1", "arm"), called("b", "team"), called("b/2/1", "arm")])
    file.append([called("c", "team")])
    found = file.read(ReadEvents(robot="arm", last=True))
    assert [event.event.key for event in found.events] == ["b", "b/2/1"]
    assert file.read(ReadEvents(robot="leg", last=True)).events == ()
    file.close()


def test_of_more_events_than_asked_for_the_latest_come_and_the_rest_is_named(path: Path) -> None:
    file = HistoryFile(path)
    found = file.read(ReadEvents(robot="arm", most=3, since=105.0))
    assert [event.event.key for event in found.events] == ["k8", "k9", "k10"]
    assert found.more
    file.close()


def test_a_file_that_is_none_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "history.db"
    path.write_bytes(b"no database at all" * 100)
    with pytest.raises(HistoryUnusable, match=r"file is not a database.; the robots run on"):
        HistoryFile(path, writes=True)
