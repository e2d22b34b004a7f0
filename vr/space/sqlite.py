"""A space in one SQLite file, which several processes of a machine may share.

Writing never holds up an event loop: a thread of its own gathers what was added and commits it in groups
(WAL, `synchronous=NORMAL`: nothing is lost when a process is killed, the last moments may be when the power
fails). Adding is one statement in the database, so processes do not overwrite each other's sums.

Each sum has a checksum: SQLite checks how a file is built, not what stands in it. Only its owner can open it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import queue
import sqlite3
import threading
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import msgspec

from robotree.files import private_file, private_folder
from robotree.vr.errors import BrokenSpace

BUSY = 5.0
"""[s] to wait for another process's commit."""
_TABLE = (
    "CREATE TABLE sums (name TEXT PRIMARY KEY, value INTEGER NOT NULL, checksum INTEGER NOT NULL) "
    "WITHOUT ROWID"
)
_FORMER = "CREATE TABLE variable (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID"
"""The table of earlier versions, which had no checksums."""
_ADD = (
    "INSERT INTO sums (name, value, checksum) VALUES (:name, :amount, checksum(:name, :amount)) "
    "ON CONFLICT (name) DO UPDATE SET value = intact(name, value, checksum) + :amount, "
    "checksum = checksum(name, intact(name, value, checksum) + :amount)"
)
_READ = "SELECT name, intact(name, value, checksum) FROM sums WHERE substr(name, 1, ?) = ?"

_DAMAGED = "it is damaged: a sum does not fit its checksum"

_log = logging.getLogger(__name__)
_Task = Callable[[sqlite3.Connection], None]


class _Sum(msgspec.Struct, frozen=True):
    name: str
    amount: int


class SqliteSpace:
    """See `Space`."""

    def __init__(self, path: Path) -> None:
        """Open the file, or make it.

        Args:
            path: of the file; its folder is made if need be.

        Raises:
            BrokenSpace: it is damaged, of another kind, or cannot be written.
        """
        self.path = path
        self._added: queue.SimpleQueue[_Sum | _Task | None] = queue.SimpleQueue()
        self._closed = False
        self._connection = _open(path)
        self._thread = threading.Thread(target=self._write, name=f"space {path.name}", daemon=True)
        self._thread.start()

    def add(self, name: str, amount: int = 1) -> None:
        """See `Space.add`."""
        self._added.put(_Sum(name, amount))

    async def read(self, prefix: str) -> dict[str, int]:
        """See `Space.read`.

        Raises:
            BrokenSpace: the file cannot be read any more.
        """
        if self._closed:
            raise BrokenSpace(path=str(self.path), reason="it is closed here")
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[dict[str, int]] = loop.create_future()

        def look(connection: sqlite3.Connection) -> None:
            try:
                rows = dict(connection.execute(_READ, (len(prefix), prefix)).fetchall())
            except sqlite3.Error as error:
                loop.call_soon_threadsafe(
                    answer.set_exception, BrokenSpace(path=str(self.path), reason=_reason(error))
                )
            else:
                loop.call_soon_threadsafe(answer.set_result, rows)

        self._added.put(look)
        return await answer

    async def close(self) -> None:
        """See `Space.close`."""
        self._closed = True
        self._added.put(None)
        await asyncio.to_thread(self._thread.join)

    # -- in the thread ----------------------------------------------------------------------------

    def _write(self) -> None:
        sums: Counter[str] = Counter()
        with contextlib.closing(self._connection):
            while True:
                item = self._added.get()
                if isinstance(item, _Sum):
                    sums[item.name] += item.amount
                    if not self._added.empty():
                        continue  # one commit for all
                self._commit(sums)
                if item is None:
                    return
                if not isinstance(item, _Sum):
                    item(self._connection)

    def _commit(self, sums: Counter[str]) -> None:
        try:
            with self._connection:
                added = ({"name": name, "amount": amount} for name, amount in sums.items())
                self._connection.executemany(_ADD, added)
        except sqlite3.Error as error:  # a robot does not stop because it cannot be counted
            _log.warning("%s: %d sums wait, because %s", self.path, len(sums), _reason(error))
        else:
            sums.clear()


def _open(path: Path) -> sqlite3.Connection:
    try:
        if not path.parent.exists():
            private_folder(path.parent)
        _keep_private(path)
        connection = sqlite3.connect(path, timeout=BUSY, check_same_thread=False)
    except (OSError, sqlite3.Error) as error:
        raise BrokenSpace(path=str(path), reason=_reason(error)) from None
    try:
        connection.create_function("checksum", 2, _checksum, deterministic=True)
        connection.create_function("intact", 3, _intact, deterministic=True)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=NORMAL")
        _examine(connection)
    except (OSError, sqlite3.Error) as error:
        connection.close()
        raise BrokenSpace(path=str(path), reason=_reason(error)) from None
    return connection


def _keep_private(path: Path) -> None:
    """Close the file, and what SQLite keeps beside it, to other users; earlier versions left it open."""
    beside = [path.with_name(f"{path.name}{end}") for end in ("-wal", "-shm")]
    opened = [private_file(path), *(private_file(one, make=False) for one in beside if one.exists())]
    if any(opened):
        _log.warning("%s was open to other users of this machine; from now on only you can open it", path)


def _examine(connection: sqlite3.Connection) -> None:
    """See that the file is a whole space; make one of an empty file, or of one without checksums.

    Raises:
        sqlite3.Error: it is damaged, or of another kind.
    """
    if _tables(connection) != [_TABLE]:
        with connection:
            connection.execute("BEGIN IMMEDIATE")  # of several processes that open it, one makes the table
            match _tables(connection):
                case []:
                    connection.execute(_TABLE)
                case [only] if only == _FORMER:
                    connection.execute(_TABLE)
                    connection.execute(
                        "INSERT INTO sums SELECT name, value, checksum(name, value) FROM variable"
                    )
                    connection.execute("DROP TABLE variable")
                case [only] if only == _TABLE:
                    pass
                case _:
                    raise sqlite3.DatabaseError("it is damaged, or no space of ours")
    ((verdict,), *_) = connection.execute("PRAGMA quick_check(1)").fetchall()
    if verdict != "ok":
        raise sqlite3.DatabaseError(f"it is damaged: {verdict}")
    connection.execute(_READ, (0, "")).fetchall()


def _tables(connection: sqlite3.Connection) -> list[str]:
    return [sql for (sql,) in connection.execute("SELECT sql FROM sqlite_schema")]


def _checksum(name: str, value: int) -> int:
    return zlib.crc32(f"{name}={value}".encode())


def _intact(name: str, value: int, checksum: int) -> int:
    """Return a value that is as it was written.

    Raises:
        ValueError: it, its name or its checksum is not.
    """
    if type(value) is not int or checksum != _checksum(name, value):
        raise ValueError
    return value


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return _DAMAGED if "user-defined function" in str(error) else str(error)
