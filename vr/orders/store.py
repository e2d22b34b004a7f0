"""The memory of a directory: records in a file or a database that one process owns, answered from memory.

What has been written survives a kill and a loss of power (WAL, synchronous FULL): an order is acknowledged
after that.
"""

from __future__ import annotations

import contextlib
import sqlite3
import zlib
from collections.abc import Callable, Generator, Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

import msgspec

from robotree.files import private_file
from robotree.vr.base.chance import token
from robotree.vr.base.errors import DirectoryDamaged, DirectoryUnusable, JournalError, VrError
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

_KINDS: dict[str, Any] = {"orders": Order, "agents": KnownAgent, "holds": OrderHold}
_encode = msgspec.msgpack.Encoder().encode
_decoders: dict[str, Callable[[bytes], Any]] = {
    table: msgspec.msgpack.Decoder(kind).decode for table, kind in _KINDS.items()
}


class RecordDatabase(Protocol):
    """A database that keeps records for one process."""

    where: str
    """For people, without passwords."""

    def records(self) -> Iterable[tuple[str, str, bytes]]:
        """Return the kind, key and body of each record."""
        ...

    def put_records(
        self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()
    ) -> None:
        """Keep records, and remove others: all or none."""
        ...


class OrderStore:
    """See the module."""

    def __init__(self, path: Path | None, database: RecordDatabase | None = None) -> None:
        """Open or make the file, and read it.

        Args:
            path: of the file, in a folder that only this user can enter; None: there is none.
            database: keeps the records instead, for this process alone; closed by who has opened it. What a
                file at `path` holds is taken over once: the directory had no database before.

        Raises:
            DirectoryUnusable: it cannot be opened, is another process's or program's, or of another version.
            DirectoryDamaged: it cannot be read.
        """
        self.where = database.where if database else IN_MEMORY if path is None else str(path)
        self.orders: dict[str, Order] = {}
        """By key."""
        self.agents: dict[str, KnownAgent] = {}
        """By identity."""
        self.holds: dict[str, OrderHold] = {}
        """By id."""
        self.id = token()
        """Of the directory, for as long as its file is there."""
        self._file: sqlite3.Connection | None = None
        self._database = database
        with self._explained():
            if database is not None:
                before = OrderStore(path) if path is not None and path.exists() else None
                self._read_database(database, before.id if before is not None else self.id)
                if before is not None and path is not None:
                    self._take_over(before, path)
            elif path is not None:
                self._file = _opened(path, self.where)
                self._load()

    def close(self) -> None:
        """Let the file go. Twice is once."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

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
        with self._explained():
            if self._database is not None and (rows or forget):
                self._database.put_records(rows, [("orders", key) for key in forget])
            elif self._file is not None and (rows or forget):
                self._write(self._file, rows, forget)
        self.orders.update({each.key: each for each in orders})
        self.agents.update({each.identity: each for each in agents})
        self.holds.update({each.id: each for each in holds})
        for key in forget:
            self.orders.pop(key, None)

    @staticmethod
    def _write(file: sqlite3.Connection, rows: list[tuple[str, str, bytes]], forget: list[str]) -> None:
        file.execute("BEGIN IMMEDIATE")
        try:
            file.executemany(
                "INSERT OR REPLACE INTO record VALUES (?, ?, ?, ?)",
                [(kind, key, body, _sum(kind, key, body)) for kind, key, body in rows],
            )
            file.executemany(
                "DELETE FROM record WHERE kind = 'orders' AND key = ?", [(key,) for key in forget]
            )
            file.execute("COMMIT")
        except sqlite3.Error:
            with contextlib.suppress(sqlite3.Error):
                file.execute("ROLLBACK")
            raise

    def _load(self) -> None:
        assert self._file is not None  # noqa: S101 # just opened
        row = self._file.execute("SELECT id FROM directory").fetchone()
        if row is None:
            self._file.execute("INSERT INTO directory VALUES (?)", (self.id,))
        else:
            self.id = str(row[0])
        for kind, key, body, crc in self._file.execute("SELECT kind, key, body, crc FROM record"):
            if kind not in _KINDS or _sum(kind, key, body) != crc:
                raise DirectoryDamaged(where=self.where, reason=f"record {key} is not as it was written")
            self._take(kind, key, body)

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

    def _read_database(self, database: RecordDatabase, own: str) -> None:
        """Read a database; `own`: the id of the directory, if none stands there."""
        found = {(kind, key): body for kind, key, body in database.records()}
        known = found.pop((DIRECTORY, DIRECTORY), None)
        if known is None:
            self.id = own
            database.put_records([(DIRECTORY, DIRECTORY, self.id.encode())])
        else:
            self.id = known.decode()
        for (kind, key), body in found.items():
            if kind in _KINDS:
                self._take(kind, key, body)

    def _take(self, kind: str, key: str, body: bytes) -> None:
        memories: dict[str, dict[str, Any]] = {
            "orders": self.orders,
            "agents": self.agents,
            "holds": self.holds,
        }
        memories[kind][key] = _decoders[kind](body)

    @contextlib.contextmanager
    def _explained(self) -> Generator[None]:
        try:
            yield
        except (JournalError, OSError) as error:  # of a database
            raise DirectoryUnusable(where=self.where, reason=str(error)) from None
        except (sqlite3.Error, msgspec.MsgspecError) as error:
            raise self._in_words(error) from None

    def _in_words(self, error: Exception) -> VrError:
        code: int = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF
        if code == sqlite3.SQLITE_FULL:
            return DirectoryUnusable(where=self.where, reason="its disk is full")
        if code in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
            reason = "another process owns it; ask that one, or end it first"
            return DirectoryUnusable(where=self.where, reason=reason)
        if code in {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}:
            return DirectoryDamaged(where=self.where, reason=str(error))
        return DirectoryUnusable(where=self.where, reason=f"it cannot be written or read ({error})")


def _opened(path: Path, where: str) -> sqlite3.Connection:
    try:
        private_file(path)
    except OSError as error:
        raise DirectoryUnusable(where=where, reason=error.strerror or str(error)) from None
    file = sqlite3.connect(path, timeout=0.0, isolation_level=None, check_same_thread=False)
    try:
        file.execute("PRAGMA locking_mode=EXCLUSIVE")
        file.execute("BEGIN EXCLUSIVE")  # nobody else has it from here on
        _expect_ours(file, where)
        file.execute("COMMIT")
        file.execute("PRAGMA journal_mode=WAL")
        file.execute("PRAGMA synchronous=FULL")
        _expect_whole(file, where)
    except BaseException:
        file.close()
        raise
    return file


def _expect_whole(file: sqlite3.Connection, where: str) -> None:
    damage = file.execute("PRAGMA quick_check(1)").fetchone()[0]
    if damage != "ok":
        raise DirectoryDamaged(where=where, reason=" ".join(str(damage).split()))


def _expect_ours(file: sqlite3.Connection, where: str) -> None:
    mark, version, tables = (
        file.execute(what).fetchone()[0]
        for what in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_master")
    )
    if not (mark or version or tables):
        file.execute(
            "CREATE TABLE record (kind TEXT NOT NULL, key TEXT NOT NULL, body BLOB NOT NULL,"
            " crc INTEGER NOT NULL, PRIMARY KEY (kind, key)) WITHOUT ROWID"
        )
        file.execute("CREATE TABLE directory (id TEXT NOT NULL)")
        file.execute(f"PRAGMA application_id={MARK}")
        file.execute(f"PRAGMA user_version={VERSION}")
    elif mark != MARK:
        raise DirectoryUnusable(where=where, reason="it is a database of another program")
    elif version != VERSION:
        reason = f"it is of version {version}, this robotree reads version {VERSION}; use that robotree"
        raise DirectoryUnusable(where=where, reason=reason)


def _sum(kind: str, key: str, body: bytes) -> int:
    """Return a check sum: SQLite itself does not notice a changed byte in what it keeps."""
    return zlib.crc32(f"{kind}\0{key}\0".encode() + body)
