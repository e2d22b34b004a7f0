"""A space in a SQLite file that one process owns: it is answered from memory, and kept in the file.

The file has what everybody may see; transactions are in memory alone, so one that was open when its process
was killed has changed nothing. Each `together` is one transaction of SQLite. `durability` says what that
survives: `process` (WAL, synchronous NORMAL) or `power` (FULL, one fdatasync); fences are always kept as
`power`, since an epoch must never come twice.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from robotree.files.database import OwnedDatabase
from robotree.vr.base.entry import Entry, marks_of
from robotree.vr.base.errors import SpaceDamaged, SpaceError, SpaceFull, SpaceUnusable
from robotree.vr.base.system import clock_shift
from robotree.vr.space.store import Durability, MemoryStore, finite
from robotree.vr.space.table import MOST_ENTRIES, FenceRow, Row, SpaceTable

MARK = 0x526F5370
"""`application_id` of the file."""
VERSION = 1
"""`user_version` of the file."""
RESERVED = 1000
"""Numbers of entries that are reserved at a time: none is used twice, whenever the process was killed."""

_SCHEMA = """
CREATE TABLE entry (
    id INTEGER PRIMARY KEY, key TEXT NOT NULL, term REAL, expires REAL, body BLOB NOT NULL,
    crc INTEGER NOT NULL
);
CREATE TABLE fence (
    name TEXT PRIMARY KEY, epoch INTEGER NOT NULL, holder TEXT NOT NULL, term REAL NOT NULL,
    expires REAL NOT NULL
);
CREATE TABLE reserved (next INTEGER NOT NULL);
INSERT INTO reserved VALUES (1);
"""
_PUT = "INSERT OR REPLACE INTO entry VALUES (?, ?, ?, ?, ?, ?)"
_DROP = "DELETE FROM entry WHERE id = ?"
_encode = msgspec.msgpack.Encoder().encode
_decode: Callable[[bytes], Entry] = msgspec.msgpack.Decoder(Entry).decode


class SqliteStore(MemoryStore):
    """See the module. `SpaceStore`."""

    def __init__(
        self,
        name: str,
        path: Path,
        now: Callable[[], float],
        unix: Callable[[], float],
        *,
        durability: Durability = "process",
        most: int = MOST_ENTRIES,
    ) -> None:
        """Open or make the file, and read it.

        Args:
            name: of the space.
            path: of the file, in a folder that only this user can enter.
            now: returns the time [s] on a monotonic clock.
            unix: returns the time [s] since 1970: leases in the file end by that.
            durability: `process` or `power`.
            most: entries that it takes.

        Raises:
            SpaceUnusable: it cannot be opened, is another process's or program's, or of another version.
            SpaceDamaged: it cannot be read.
        """
        super().__init__(name, now, most=most)
        self.where, self.durability = str(path), durability
        self.slow = durability == "power"  # a write that waits for no disk takes less than another thread
        self._unix, self._reserved = unix, 0
        self._file = OwnedDatabase(
            path,
            _SCHEMA,
            mark=MARK,
            version=VERSION,
            unusable=lambda reason: SpaceUnusable(where=self.where, reason=reason),
            damaged=lambda reason: SpaceDamaged(where=self.where, reason=reason),
            full=lambda _: SpaceFull(space=name, reason=f"the disk that holds {self.where} is full"),
        )
        self._full: bool | None = None
        with self._file.explained():
            self._synchronise(full=durability == "power")
            self._load()

    def close(self) -> None:
        self._file.close()

    # -- keeping ----------------------------------------------------------------------------------

    def _keep(self) -> None:
        table = self._table
        orders = self._orders() if table.changed or table.changed_fences else []
        try:
            if orders:
                with self._file.explained():
                    self._synchronise(full=self.durability == "power" or bool(table.changed_fences))
                    with self._file.transaction():
                        for order, values in orders:
                            self._file.execute(order, values)
        except SpaceError:
            table.undo()
            raise
        table.settle()

    def _orders(self) -> list[tuple[str, tuple[Any, ...]]]:
        """Return what has to be written into the file."""
        table, orders = self._table, list[tuple[str, tuple[Any, ...]]]()
        shift = clock_shift(self._now, self._unix)
        for id_, before in table.changed.items():
            row = table.rows.get(id_)
            was, is_ = _kept(before), _kept(row)
            if is_ is not None and (was is None or (was.expires, was.key) != (is_.expires, is_.key)):
                orders.append((_PUT, self._packed(is_, shift)))
            elif was is not None and is_ is None:
                orders.append((_DROP, (id_,)))
        for name in table.changed_fences:
            fence = table.fences[name]
            term = fence.left(self._now())
            row_of_fence = (name, fence.epoch, fence.holder, term, fence.expires + shift)
            orders.append(("INSERT OR REPLACE INTO fence VALUES (?, ?, ?, ?, ?)", row_of_fence))
        if table.next_id > self._reserved:
            self._reserved = table.next_id + RESERVED
            orders.append(("UPDATE reserved SET next = ?", (self._reserved,)))
        return orders

    def _packed(self, row: Row, shift: float) -> tuple[Any, ...]:
        body = _encode(row.entry)
        term, expires = finite(row.expires - self._now()), finite(row.expires + shift)
        return (row.id, row.key, term, expires, body, _sum(row.id, row.key, term, expires, body))

    def _synchronise(self, *, full: bool) -> None:
        if full != self._full:
            self._full = full
            self._file.execute(f"PRAGMA synchronous={'FULL' if full else 'NORMAL'}")

    def _load(self) -> None:
        now, unix = self._now(), self._unix()
        reserved: int = self._file.execute("SELECT next FROM reserved").fetchone()[0]
        self._reserved = reserved
        self._table = table = SpaceTable(self.name, first=reserved, most=self._table.most)
        order = "SELECT id, key, term, expires, body, crc FROM entry ORDER BY id"
        for id_, key, term, expires, body, crc in self._file.execute(order):
            if _sum(id_, key, term, expires, body) != crc:
                raise SpaceDamaged(where=self.where, reason=f"entry {id_} is not as it was written")
            entry = _decode(body)
            end = now + _left(term, expires, unix)
            table.load(Row(id_, entry, marks_of(entry.kinds, entry.fields), key, end))
        for name, epoch, holder, term, expires in self._file.execute("SELECT * FROM fence"):
            table.fences[name] = FenceRow(epoch, holder, now + _left(term, expires, unix))


def _kept(row: Row | None) -> Row | None:
    """Return what the file has of an entry: nothing before the transaction that wrote it commits."""
    return None if row is None or row.written_by else row


def _left(term: float | None, expires: float | None, unix: float) -> float:
    """Return what is left of a lease [s]; a clock that was set back does not make it longer."""
    if term is None or expires is None:
        return math.inf
    return min(term, expires - unix)


def _sum(*values: object) -> int:
    """Return a check sum: SQLite itself does not notice a changed byte in what it keeps."""
    return zlib.crc32(b"\0".join(map(_bytes, values)))


def _bytes(value: object) -> bytes:
    return value if isinstance(value, bytes) else repr(value).encode()
