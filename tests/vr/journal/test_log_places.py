"""Files and PostgreSQL keep a log by the same rules: one examination for both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest

from robotree.vr.journal.files import FilePlace
from robotree.vr.journal.postgres import PostgresPlace
from tests.vr.journal import examination
from tests.vr.space.postgres import Server, server

_names = count()


@pytest.fixture(scope="module")
def database() -> Iterator[Server]:
    """A server whose files need not survive anything."""
    with server("fsync=off", "full_page_writes=off", "autovacuum=off") as running:
        yield running


@pytest.fixture(params=["files", "postgres"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[examination.OpenPlace]:
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


@pytest.mark.parametrize("examine", examination.EXAMINATIONS)
def test_a_place_for_a_log_keeps_the_rules(
    place: examination.OpenPlace, examine: Callable[[examination.OpenPlace], None]
) -> None:
    examine(place)
    owner = place().look()
    assert owner is not None
    assert not owner.lives
