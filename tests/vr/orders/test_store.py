"""The file of a directory: what is not as it was written is refused with what to do."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from robotree.vr.base.errors import DirectoryDamaged
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
