"""The memory of a robot of its orders: which it has, which have begun, and how each ended.

It is written before an order begins, so that a robot that was killed knows on its return what it may have
done. An order is remembered until it has expired everywhere: a directory that comes back late with an old
copy is told how the order ended.

It is a file beside the history of the robot, or lies with the journal of a host in PostgreSQL: then a host
that stands by on another machine knows which orders have begun, and one that was deposed writes nothing more.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from robotree.files import private_file, private_folder, read, replace
from robotree.vr.base.chance import token
from robotree.vr.base.errors import JournalError, LedgerDamaged, LedgerUnusable
from robotree.vr.base.order import Order, merged
from robotree.vr.orders.store import Records

GRACE = 86400.0
"""[s] for which an order is remembered after its end: by so much clocks may differ."""
IDENTITY = "identity"
"""File with the identity of a robot, in its folder."""
ORDERS = "orders.db"
"""File with its orders."""
MOST_IDENTITY = 10_000
"""[bytes] of the first file."""


class LedgerEntry(msgspec.Struct, frozen=True):
    """One order of the robot."""

    order: Order
    begun: bool = False
    """Whether it may have begun."""
    witness: str = ""
    """`Robot.witness` when it began: the memory of its commands beyond the process."""


class _Identity(msgspec.Struct, frozen=True):
    """Content of the file."""

    id: str
    kind: str


_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(LedgerEntry).decode
_decode_place = msgspec.msgpack.Decoder(dict[str, float]).decode
_decode_time = msgspec.msgpack.Decoder(float).decode
ENTRY, TOUCHED, REST = "entry", "touched", "rest"
"""Kinds of records: an order; when somebody commanded or moved a robot; where it came to rest."""
_TROUBLE = (OSError, sqlite3.Error, JournalError)


class FileRecords:
    """A ledger in a SQLite file. `Records`."""

    def __init__(self, path: Path) -> None:
        """Open or make the file.

        Raises:
            OSError: it cannot be opened.
            sqlite3.Error: it is none, or damaged.
        """
        self.where = str(path)
        private_file(path)
        self._file = sqlite3.connect(path, timeout=5.0, isolation_level=None, check_same_thread=False)
        for order in (
            "PRAGMA journal_mode=WAL",
            "PRAGMA synchronous=FULL",
            "CREATE TABLE IF NOT EXISTS entry (key TEXT PRIMARY KEY, body BLOB NOT NULL)",
            "CREATE TABLE IF NOT EXISTS touched (identity TEXT PRIMARY KEY, at REAL NOT NULL)",
            "CREATE TABLE IF NOT EXISTS rest (identity TEXT PRIMARY KEY, place BLOB NOT NULL)",
        ):
            self._file.execute(order)

    def close(self) -> None:
        """Let the file go."""
        self._file.close()

    def records(self) -> Iterator[tuple[str, str, bytes]]:
        for key, body in self._file.execute("SELECT key, body FROM entry"):
            yield ENTRY, key, body
        for identity, at in self._file.execute("SELECT identity, at FROM touched"):
            yield TOUCHED, identity, _encode(at)
        for identity, place in self._file.execute("SELECT identity, place FROM rest"):
            yield REST, identity, place

    def put_records(
        self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()
    ) -> None:
        file = self._file
        with file:  # one transaction
            file.execute("BEGIN IMMEDIATE")
            for kind, key, body in rows:
                if kind == ENTRY:
                    file.execute("INSERT OR REPLACE INTO entry VALUES (?, ?)", (key, body))
                elif kind == REST:
                    file.execute("INSERT OR REPLACE INTO rest VALUES (?, ?)", (key, body))
                else:
                    at = _decode_time(body)
                    file.execute("INSERT OR REPLACE INTO touched VALUES (?, ?)", (key, at))
            for kind, key in gone:
                if kind == REST:
                    file.execute("DELETE FROM rest WHERE identity = ?", (key,))
                else:
                    file.execute("DELETE FROM entry WHERE key = ?", (key,))


class Ledger:
    """The orders of the robots of one process; see the module."""

    def __init__(self, place: Path | Records | None) -> None:
        """Open it, and read it.

        Args:
            place: a file; or what keeps records, which stays open; None: nothing survives the process.

        Raises:
            LedgerUnusable: it cannot be used.
        """
        self.where = "memory"
        self.slow = place is not None
        """Whether to write may wait for a disk."""
        self.entries: dict[str, LedgerEntry] = {}
        """By the key of the order."""
        self.touched: dict[str, float] = {}
        """When somebody commanded or moved each robot last, other than by an order, by identity: [s] since
        1970."""
        self.rest: dict[str, dict[str, float]] = {}
        """Where each robot came to rest, by identity, as far as it says; not known while it moves."""
        self._lock = threading.Lock()
        self._records: Records | None = None
        if place is None:
            return
        self.where = str(place) if isinstance(place, Path) else place.where
        try:
            self._open(place)
        except (*_TROUBLE, msgspec.MsgspecError) as error:
            self.close()
            raise self._in_words(error) from None

    def _open(self, place: Path | Records) -> None:
        if isinstance(place, Path):
            place = FileRecords(place)
        self._records = place
        for kind, key, body in self._records.records():
            if kind == ENTRY:
                self.entries[key] = _decode(body)
            elif kind == TOUCHED:
                self.touched[key] = _decode_time(body)
            elif kind == REST:
                self.rest[key] = _decode_place(body)

    def close(self) -> None:
        """Let the file go. Twice is once."""
        records, self._records = self._records, None
        if isinstance(records, FileRecords):
            records.close()

    def take_over(self, path: Path) -> None:
        """Keep what a file holds, too, and put the file aside: killed in between, the same is done again.

        An order that may have begun by either of the two has begun.

        Raises:
            LedgerUnusable: it cannot be read, or not be kept here.
        """
        before = Ledger(path)
        try:
            for entry in before.entries.values():
                known = self.entries.get(entry.order.key, entry)
                witness = entry.witness if entry.begun else known.witness
                order = merged(entry.order, known.order)
                self.put(LedgerEntry(order, begun=entry.begun or known.begun, witness=witness))
            for identity, at in before.touched.items():
                self.touch(identity, max(at, self.touched.get(identity, at)))
            for identity, place in before.rest.items():
                if identity not in self.rest:
                    self.note_rest(identity, place)
        finally:
            before.close()
        path.rename(path.with_name(f"{path.name}.in-database"))

    def put(self, entry: LedgerEntry) -> None:
        """Keep an entry in the place of the one that is known. From any thread, as all that follow.

        Raises:
            LedgerUnusable: it is not kept.
        """
        self._write([(ENTRY, entry.order.key, _encode(entry))])
        self.entries[entry.order.key] = entry

    def touch(self, identity: str, at: float) -> None:
        """Take note that a person has commanded a robot.

        Raises:
            LedgerUnusable: it is not kept.
        """
        self._write([(TOUCHED, identity, _encode(at))])
        self.touched[identity] = at

    def note_rest(self, identity: str, place: dict[str, float] | None) -> None:
        """Take note where a robot came to rest; None: it moves, or is about to.

        Raises:
            LedgerUnusable: it is not kept.
        """
        if place is None:
            self._write([], [(REST, identity)])
            self.rest.pop(identity, None)
        else:
            self._write([(REST, identity, _encode(place))])
            self.rest[identity] = place

    def forget(self, now: float) -> None:
        """Forget what has expired everywhere; `now` [s] since 1970.

        Raises:
            LedgerUnusable: it is not forgotten.
        """
        old = [
            key
            for key, entry in self.entries.items()
            if entry.order.over and entry.order.begin_by + GRACE < now
        ]
        if old:
            self._write([], [(ENTRY, key) for key in old])
        for key in old:
            del self.entries[key]

    def _write(self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()) -> None:
        try:
            with self._lock:
                if self._records is not None:
                    self._records.put_records(rows, gone)
        except _TROUBLE as error:
            raise self._in_words(error) from None

    def _in_words(self, error: Exception) -> LedgerUnusable:
        code: int = getattr(error, "sqlite_errorcode", 0) & 0xFF
        damaged = isinstance(error, msgspec.MsgspecError) or code in {
            sqlite3.SQLITE_CORRUPT,
            sqlite3.SQLITE_NOTADB,
        }
        return (LedgerDamaged if damaged else LedgerUnusable)(where=self.where, reason=str(error))


class OrderMemory(NamedTuple):
    """What a robot keeps to take orders."""

    ledger: Ledger
    identity: str = ""
    """Which robot it is, for its whole life; empty: that of its first incarnation, which its host keeps."""


def identity_in(folder: Path, kind: str) -> str:
    """Return the identity of the robot that is kept in a folder; it is drawn when it is asked for first.

    Args:
        folder: in which only this robot is kept.
        kind: of the robot: another kind under the same name is another robot.

    Raises:
        LedgerUnusable: it cannot be kept.
    """
    path = folder / IDENTITY
    try:
        private_folder(folder)
        with contextlib.suppress(FileNotFoundError, msgspec.MsgspecError):
            known = msgspec.json.decode(read(path, MOST_IDENTITY), type=_Identity)
            if known.kind == kind:
                return known.id
        drawn = token()
        replace(path, msgspec.json.encode(_Identity(drawn, kind)))
    except OSError as error:
        raise LedgerUnusable(where=str(path), reason=error.strerror or str(error)) from None
    return drawn
