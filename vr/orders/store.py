"""The memory of a directory: records in a file or a database that one process owns, answered from memory.

What has been written survives a kill and a loss of power (WAL, synchronous FULL): an order is acknowledged
after that.
"""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import msgspec

from robotree.files.database import OwnedDatabase
from robotree.vr.base.chance import token
from robotree.vr.base.errors import DirectoryDamaged, DirectoryUnusable, JournalError
from robotree.vr.base.order import KnownAgent, Order, OrderHold, merged, merged_hold, merged_known

MARK = 0x526F4F72
"""`application_id` of the file."""
VERSION = 1
"""`user_version` of the file."""
IN_MEMORY = "memory"
"""Instead of a file: nothing is kept."""

TAKEN_OVER = ".in-database"
"""Behind the name of a file whose records a database has now."""
DIRECTORY = "directory"
"""Kind and key of the record of a database that names the directory."""

_SCHEMA = """
CREATE TABLE record (kind TEXT NOT NULL, key TEXT NOT NULL, body BLOB NOT NULL,
    crc INTEGER NOT NULL, PRIMARY KEY (kind, key)) WITHOUT ROWID;
CREATE TABLE directory (id TEXT NOT NULL);
"""
_KINDS: dict[str, Any] = {"orders": Order, "agents": KnownAgent, "holds": OrderHold}
_encode = msgspec.msgpack.Encoder().encode
_decoders: dict[str, Callable[[bytes], Any]] = {
    table: msgspec.msgpack.Decoder(kind).decode for table, kind in _KINDS.items()
}


@runtime_checkable
class Records(Protocol):
    """A file or a database that keeps records by kind and key, for one process. From one thread at a time."""

    where: str
    """For people, without passwords."""

    def records(self) -> Iterable[tuple[str, str, bytes]]:
        """Return the kind, key and body of each record."""
        ...

    def put_records(
        self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()
    ) -> None:
        """Keep records, and remove others: all or none, and for good when this returns."""
        ...


class _FileRecords:
    """The records of a directory in a file that this process owns. `Records`."""

    def __init__(self, path: Path) -> None:
        self.where = str(path)
        self.file = OwnedDatabase(
            path,
            _SCHEMA,
            mark=MARK,
            version=VERSION,
            unusable=self._unusable,
            damaged=lambda reason: DirectoryDamaged(where=self.where, reason=reason),
            full=self._unusable,
        )
        self.file.execute("PRAGMA synchronous=FULL")

    def _unusable(self, reason: str) -> DirectoryUnusable:
        return DirectoryUnusable(where=self.where, reason=reason)

    def records(self) -> Iterator[tuple[str, str, bytes]]:
        with self.file.explained():
            for (id_,) in self.file.execute("SELECT id FROM directory"):
                yield DIRECTORY, DIRECTORY, id_.encode()
            for kind, key, body, crc in self.file.execute("SELECT kind, key, body, crc FROM record"):
                if kind not in _KINDS or _sum(kind, key, body) != crc:
                    raise DirectoryDamaged(where=self.where, reason=f"record {key} is not as it was written")
                yield kind, key, body

    def put_records(
        self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()
    ) -> None:
        with self.file.explained(), self.file.transaction():
            for kind, key, body in rows:
                if kind == DIRECTORY:
                    self.file.execute("INSERT INTO directory VALUES (?)", (body.decode(),))
                else:
                    values = (kind, key, body, _sum(kind, key, body))
                    self.file.execute("INSERT OR REPLACE INTO record VALUES (?, ?, ?, ?)", values)
            for each in gone:
                self.file.execute("DELETE FROM record WHERE kind = ? AND key = ?", each)


class OrderStore:
    """See the module."""

    def __init__(self, path: Path | None, database: Records | None = None) -> None:
        """Open or make the file, and read it.

        Args:
            path: of the file, in a folder that only this user can enter; None: there is none.
            database: keeps the records instead, for this process alone; closed by who has opened it. What a
                file at `path` holds is taken over once: the directory had no database before.

        Raises:
            DirectoryUnusable: it cannot be opened, is another process's or program's, or of another version.
            DirectoryDamaged: it cannot be read.
        """
        self.orders: dict[str, Order] = {}
        """By key."""
        self.agents: dict[str, KnownAgent] = {}
        """By identity."""
        self.holds: dict[str, OrderHold] = {}
        """By id."""
        self.trouble = ""
        """Why nothing is kept at the moment, as it was said last; empty: all is."""
        moves = database is not None and path is not None and path.exists()
        before = OrderStore(path) if moves else None
        self.id: str = token() if before is None else before.id
        """Of the directory, for as long as its memory is there."""
        self._file = _FileRecords(path) if database is None and path is not None else None
        self._records: Records | None = database or self._file
        self.where = IN_MEMORY if self._records is None else self._records.where
        if self._records is not None:
            with self._explained():
                self._read(self._records)
                if before is not None and path is not None:
                    self._take_over(before, path)

    def close(self) -> None:
        """Let the file go. Twice is once."""
        if self._file is not None:
            self._file.file.close()

    def put(
        self,
        orders: Iterable[Order] = (),
        agents: Iterable[KnownAgent] = (),
        holds: Iterable[OrderHold] = (),
        forget: Iterable[str] = (),
    ) -> None:
        """Keep records, in the place of those that are known; all of them or none.

        Args:
            orders: by their keys.
            agents: by their identities.
            holds: by their ids.
            forget: keys of orders.

        Raises:
            DirectoryUnusable: nothing was kept.
        """
        orders, agents, holds, forget = list(orders), list(agents), list(holds), list(forget)
        rows = [("orders", each.key, _encode(each)) for each in orders]
        rows += [("agents", each.identity, _encode(each)) for each in agents]
        rows += [("holds", each.id, _encode(each)) for each in holds]
        if self._records is not None and (rows or forget):
            with self._explained():
                self._records.put_records(rows, [("orders", key) for key in forget])
            self.trouble = ""
        self.orders.update({each.key: each for each in orders})
        self.agents.update({each.identity: each for each in agents})
        self.holds.update({each.id: each for each in holds})
        for key in forget:
            self.orders.pop(key, None)

    def _take_over(self, before: OrderStore, path: Path) -> None:
        """Keep what a file holds, too, and put the file aside: killed in between, the same is done again."""
        orders, agents, holds = before.orders, before.agents, before.holds
        try:
            self.put(
                [merged(each, self.orders.get(key, each)) for key, each in orders.items()],
                [merged_known(each, self.agents.get(key, each)) for key, each in agents.items()],
                [merged_hold(each, self.holds.get(key, each)) for key, each in holds.items()],
            )
        finally:
            before.close()
        path.rename(path.with_name(f"{path.name}{TAKEN_OVER}"))

    def _read(self, records: Records) -> None:
        """Read all records; a memory that names no directory is of this one."""
        found = {(kind, key): body for kind, key, body in records.records()}
        known = found.pop((DIRECTORY, DIRECTORY), None)
        if known is None:
            records.put_records([(DIRECTORY, DIRECTORY, self.id.encode())])
        else:
            self.id = known.decode()
        memories: dict[str, dict[str, Any]]
        memories = {"orders": self.orders, "agents": self.agents, "holds": self.holds}
        for (kind, key), body in found.items():
            if kind in memories:
                memories[kind][key] = _decoders[kind](body)

    @contextlib.contextmanager
    def _explained(self) -> Generator[None]:
        try:
            yield
        except (JournalError, OSError) as error:  # of a database
            raise DirectoryUnusable(where=self.where, reason=str(error)) from None
        except msgspec.MsgspecError as error:
            raise DirectoryDamaged(where=self.where, reason=str(error)) from None


def _sum(kind: str, key: str, body: bytes) -> int:
    """Return a check sum: SQLite itself does not notice a changed byte in what it keeps."""
    return zlib.crc32(f"{kind}\0{key}\0".encode() + body)
