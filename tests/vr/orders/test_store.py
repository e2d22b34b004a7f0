"""The files of directories and of orders: what is not as it was written is refused with what to do."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

import pytest

from robotree.vr.base.errors import DirectoryDamaged, DirectoryUnusable, LedgerDamaged, LedgerUnusable
from robotree.vr.base.order import Order, OrderHold
from robotree.vr.journal.postgres import PostgresLog, PostgresPlace
from robotree.vr.orders.ledger import Ledger, LedgerEntry
from robotree.vr.orders.run import _taken
from robotree.vr.orders.store import OrderStore
from tests.vr.space.postgres import Server, server


@pytest.mark.parametrize(
    ("damage", "sentence"),
    [
        ("INSERT INTO record VALUES ('wishes', 'k', x'00', 0)", "record k is not as it was written"),
        ("DROP TABLE directory", "no such table: directory"),
    ],
)
def test_what_no_directory_writes_is_damage(tmp_path: Path, damage: str, sentence: str) -> None:
    path = tmp_path / "directory.db"
    OrderStore(path).close()
    with sqlite3.connect(path) as file:
        file.execute(damage)
    file.close()
    with pytest.raises(DirectoryDamaged, match=rf"\({sentence}\); move it away"):
        OrderStore(path)


def test_a_damaged_memory_of_orders_says_whose_it_is_and_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "orders.db"
    path.write_bytes(b"not a database at all" * 1000)
    with pytest.raises(LedgerDamaged, match=r"the host remembers.*\(file is not a database\); move it away"):
        Ledger(path)


# -- what they keep in PostgreSQL outlives the machine, and belongs to one process -----------------


_names = count(1)


@pytest.fixture(scope="module")
def running() -> Iterator[Server]:
    with server("fsync=off", "full_page_writes=off", "autovacuum=off") as running:
        yield running


def order(key: str, state: str = "waiting") -> Order:
    return Order(key=key, robot="r1", identity="i1", command="drive", state=state, begin_by=5e9)  # type: ignore[arg-type]


def owned(running: Server, name: str, host: str, after: int) -> PostgresLog:
    place = PostgresPlace(running.url, name)
    log = place.take(host, after)
    place.close()
    assert isinstance(log, PostgresLog)
    return log


def test_a_host_that_stands_by_knows_which_orders_were_begun(running: Server) -> None:
    name = f"ledger/{next(_names)}"
    first = owned(running, name, "h1", 0)
    ledger = Ledger(first)
    ledger.put(LedgerEntry(order("a", "taken"), begun=True, witness="w"))
    ledger.put(LedgerEntry(order("b", "done")))
    ledger.touch("i1", 7.5)

    second = owned(running, name, "h2", 1)
    taken_over = Ledger(second)
    assert taken_over.entries == ledger.entries
    assert taken_over.touched == {"i1": 7.5}
    with pytest.raises(LedgerUnusable):  # it was deposed: nothing more begins there
        ledger.put(LedgerEntry(order("c", "taken"), begun=True))
    taken_over.forget(1e10)
    assert Ledger(second).entries.keys() == {"a"}
    first.close()
    second.close()


def test_a_directory_in_a_database_is_the_same_wherever_it_runs(running: Server, tmp_path: Path) -> None:
    name = f"directory/{next(_names)}"
    with contextlib.ExitStack() as stack:
        store = OrderStore(tmp_path / "unused.db", _taken(running.url, name, "d1", stack))
        store.put(orders=[order("a"), order("b")])
        store.put(orders=[order("a", "done")], forget=["b"])
        with pytest.raises(DirectoryUnusable, match="d1"), contextlib.ExitStack() as other:
            _taken(running.url, name, "d1", other)
    assert not list(tmp_path.iterdir())
    with contextlib.ExitStack() as stack:
        again = OrderStore(None, _taken(running.url, name, "d1", stack))
        assert again.id == store.id
        assert {key: each.state for key, each in again.orders.items()} == {"a": "done"}


class Records:
    """A database that fails when it is told to."""

    where = "a database"

    def __init__(self, *, fails: bool = False) -> None:
        self.kept: dict[tuple[str, str], bytes] = {}
        self.fails = fails

    def records(self) -> list[tuple[str, str, bytes]]:
        return [(kind, key, body) for (kind, key), body in self.kept.items()]

    def put_records(
        self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()
    ) -> None:
        if self.fails and any(kind == "orders" for kind, _, _ in rows):
            raise OSError("the line is cut")
        self.kept.update({(kind, key): body for kind, key, body in rows})
        for each in gone:
            self.kept.pop(each, None)


def test_what_a_directory_kept_in_its_folder_is_in_the_database_that_it_gets(tmp_path: Path) -> None:
    path = tmp_path / "directory.db"
    local = OrderStore(path)
    local.put(orders=[order("a"), order("b", "done")], holds=[OrderHold(id="h", by="anna", at=1.0)])
    local.close()
    database = Records(fails=True)
    with pytest.raises(DirectoryUnusable, match="the line is cut"):
        OrderStore(path, database)
    assert path.exists(), "nothing is put aside that the database has not"
    database.fails = False
    moved = OrderStore(path, database)
    assert {key: each.state for key, each in moved.orders.items()} == {"a": "waiting", "b": "done"}
    assert moved.id == local.id, "it is the same directory"
    assert set(moved.holds) == {"h"}
    assert [each.name for each in tmp_path.iterdir()] == ["directory.db.in-database"]
    moved.put(orders=[order("a", "done")])
    assert OrderStore(path, database).orders["a"].state == "done", "it is taken over once"


def test_a_copy_in_a_folder_undoes_nothing_that_the_database_knows(tmp_path: Path) -> None:
    path, database = tmp_path / "directory.db", Records()
    OrderStore(None, database).put(orders=[order("a", "done")])
    local = OrderStore(path)
    local.put(orders=[order("a"), order("c")])
    local.close()
    states = {key: each.state for key, each in OrderStore(path, database).orders.items()}
    assert states == {"a": "done", "c": "waiting"}


def test_the_ledger_of_a_host_is_taken_over_by_the_database_that_it_gets(tmp_path: Path) -> None:
    path, database = tmp_path / "orders.db", Records()
    local = Ledger(path)
    local.put(LedgerEntry(order("a", "taken"), begun=True, witness="w"))
    local.put(LedgerEntry(order("b", "taken")))
    local.touch("i1", 7.5)
    local.note_rest("i1", {"x": 1.0})
    local.close()
    other = Ledger(database)
    other.put(LedgerEntry(order("b", "done"), begun=True))
    other.touch("i1", 9.0)
    other.take_over(path)
    again = Ledger(database)
    assert again.entries["a"] == LedgerEntry(order("a", "taken"), begun=True, witness="w")
    assert (again.entries["b"].order.state, again.entries["b"].begun) == ("done", True)
    assert (again.touched, again.rest) == ({"i1": 9.0}, {"i1": {"x": 1.0}})
    assert not path.exists()


def test_a_database_that_is_not_there_is_one_sentence() -> None:
    with pytest.raises(DirectoryUnusable, match="nowhere"), contextlib.ExitStack() as stack:
        _taken("postgresql://127.0.0.1:9/nowhere", "any", "d1", stack)
