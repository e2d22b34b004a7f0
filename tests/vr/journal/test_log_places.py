"""Files and PostgreSQL keep a log by the same rules, as `journal/store.py` says: one examination for both."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path

import pytest

from robotree.vr.base.errors import Deposed, JournalInUse
from robotree.vr.journal.files import FilePlace
from robotree.vr.journal.postgres import PostgresPlace
from robotree.vr.journal.segments import HEAD
from robotree.vr.journal.store import LogPlace, LogStore, own
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
