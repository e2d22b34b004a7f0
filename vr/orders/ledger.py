"""The memory of a robot of its orders: which it has, which have begun, and how each ended.

It is written before an order begins, so that a robot that was killed knows on its return what it may have
done. An order is remembered until it has expired everywhere: a directory that comes back late with an old
copy is told how the order ended.
"""

from __future__ import annotations

import contextlib
import sqlite3
import threading
from collections.abc import Generator
from pathlib import Path
from typing import NamedTuple

import msgspec

from robotree.files import private_file, private_folder, read, replace
from robotree.vr.base.chance import token
from robotree.vr.base.errors import DirectoryUnusable
from robotree.vr.base.order import Order

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


class Ledger:
    """The orders of the robots of one process; see the module."""

    def __init__(self, path: Path | None) -> None:
        """Open or make the file, and read it.

        Args:
            path: of the file; None: nothing survives the process.

        Raises:
            DirectoryUnusable: it cannot be used.
        """
        self.where = "memory" if path is None else str(path)
        self.slow = path is not None
        """Whether to write may wait for a disk."""
        self.entries: dict[str, LedgerEntry] = {}
        """By the key of the order."""
        self.touched: dict[str, float] = {}
        """When somebody commanded or moved each robot last, other than by an order, by identity: [s] since
        1970."""
        self.rest: dict[str, dict[str, float]] = {}
        """Where each robot came to rest, by identity, as far as it says; not known while it moves."""
        self._lock = threading.Lock()
        self._file: sqlite3.Connection | None = None
        if path is None:
            return
        try:
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
            for key, body in self._file.execute("SELECT key, body FROM entry"):
                self.entries[key] = _decode(body)
            self.touched.update(self._file.execute("SELECT identity, at FROM touched"))
            for identity, place in self._file.execute("SELECT identity, place FROM rest"):
                self.rest[identity] = _decode_place(place)
        except (OSError, sqlite3.Error, msgspec.MsgspecError) as error:
            self.close()
            raise DirectoryUnusable(where=self.where, reason=str(error)) from None

    def close(self) -> None:
        """Let the file go. Twice is once."""
        file, self._file = self._file, None
        if file is not None:
            file.close()

    def put(self, entry: LedgerEntry) -> None:
        """Keep an entry in the place of the one that is known. From any thread, as all that follow.

        Raises:
            DirectoryUnusable: it is not kept.
        """
        with self._explained():
            if self._file is not None:
                order = "INSERT OR REPLACE INTO entry VALUES (?, ?)"
                self._file.execute(order, (entry.order.key, _encode(entry)))
        self.entries[entry.order.key] = entry

    def touch(self, identity: str, at: float) -> None:
        """Take note that a person has commanded a robot.

        Raises:
            DirectoryUnusable: it is not kept.
        """
        with self._explained():
            if self._file is not None:
                self._file.execute("INSERT OR REPLACE INTO touched VALUES (?, ?)", (identity, at))
        self.touched[identity] = at

    def note_rest(self, identity: str, place: dict[str, float] | None) -> None:
        """Take note where a robot came to rest; None: it moves, or is about to.

        Raises:
            DirectoryUnusable: it is not kept.
        """
        with self._explained():
            if self._file is not None and place is None:
                self._file.execute("DELETE FROM rest WHERE identity = ?", (identity,))
            elif self._file is not None:
                self._file.execute("INSERT OR REPLACE INTO rest VALUES (?, ?)", (identity, _encode(place)))
        if place is None:
            self.rest.pop(identity, None)
        else:
            self.rest[identity] = place

    def forget(self, now: float) -> None:
        """Forget what has expired everywhere; `now` [s] since 1970.

        Raises:
            DirectoryUnusable: it is not forgotten.
        """
        old = [
            key
            for key, entry in self.entries.items()
            if entry.order.over and entry.order.begin_by + GRACE < now
        ]
        with self._explained():
            if self._file is not None and old:
                self._file.executemany("DELETE FROM entry WHERE key = ?", [(key,) for key in old])
        for key in old:
            del self.entries[key]

    @contextlib.contextmanager
    def _explained(self) -> Generator[None]:
        try:
            with self._lock:
                yield
        except sqlite3.Error as error:
            raise DirectoryUnusable(where=self.where, reason=str(error)) from None


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
        DirectoryUnusable: it cannot be kept.
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
        raise DirectoryUnusable(where=str(path), reason=error.strerror or str(error)) from None
    return drawn
