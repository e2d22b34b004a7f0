"""The files of directories and of orders: what is not as it was written is refused with what to do."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from robotree.vr.base.errors import DirectoryDamaged, LedgerDamaged
from robotree.vr.orders.ledger import Ledger
from robotree.vr.orders.store import OrderStore


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
