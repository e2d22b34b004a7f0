"""A space in one SQLite file, which several processes of a machine may share.

Writing never holds up an event loop: a thread of its own gathers what was added and commits it in groups
(WAL, `synchronous=NORMAL`: nothing is lost when a process is killed, the last moments may be when the power
fails). Adding is one statement in the database, so processes do not overwrite each other's sums.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import queue
import sqlite3
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import msgspec

from robotree.vr.errors import BrokenSpace

BUSY = 5.0
"""[s] to wait for another process's commit."""
_TABLE = "CREATE TABLE IF NOT EXISTS variable (name TEXT PRIMARY KEY, value INTEGER NOT NULL) WITHOUT ROWID"
_ADD = (
    "INSERT INTO variable (name, value) VALUES (?, ?) "
    "ON CONFLICT (name) DO UPDATE SET value = value + excluded.value"
)
_READ = "SELECT name, value FROM variable WHERE substr(name, 1, ?) = ?"

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
                    answer.set_exception, BrokenSpace(path=str(self.path), reason=str(error))
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
                self._connection.executemany(_ADD, sums.items())
        except sqlite3.Error as error:  # a robot does not stop because it cannot be counted
            _log.warning("%s: %d sums wait, because %s", self.path, len(sums), error)
        else:
            sums.clear()


def _open(path: Path) -> sqlite3.Connection:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(path, timeout=BUSY, check_same_thread=False)
    except (OSError, sqlite3.Error) as error:
        raise BrokenSpace(path=str(path), reason=str(error)) from None
    try:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=NORMAL")
        with connection:
            connection.execute(_TABLE)
    except sqlite3.Error as error:
        connection.close()
        raise BrokenSpace(path=str(path), reason=str(error)) from None
    return connection
