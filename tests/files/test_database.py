"""A database that one process owns: what a block writes is kept whole, or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.files.database import OwnedDatabase


def test_a_block_that_fails_has_written_nothing_and_the_next_one_can_begin(tmp_path: Path) -> None:
    file = OwnedDatabase(
        tmp_path / "numbers.db",
        "CREATE TABLE number (value INTEGER);",
        mark=1,
        version=1,
        unusable=OSError,
        damaged=OSError,
        full=OSError,
    )

    def write(value: int) -> None:
        with file.transaction():
            file.execute("INSERT INTO number VALUES (?)", (value,))
            if value == 1:
                raise ValueError("on purpose")

    with pytest.raises(ValueError, match="on purpose"):
        write(1)
    write(2)
    assert [*file.execute("SELECT value FROM number")] == [(2,)]
    file.close()
