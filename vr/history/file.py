"""Events of robots in a SQLite file, as a chain: each row has the SHA-256 of its body and of the row before.

    event(number, unix, robot, kind, key, body, hash)      body: `HistoryEvent` as JSON
    ends(which, number, hash)      `last`: of the newest row; `deleted`: of the last row that was deleted

Who changes or removes a row must change all that follow, and `ends`; a hash of the last row that was noted
elsewhere shows that, too. Rows are deleted from the oldest on, and the chain then begins at `deleted`.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec

from robotree.files import expect_own, private_file, private_folder
from robotree.vr.base.errors import HistoryUnusable
from robotree.vr.base.history_event import HistoryEvent, NumberedEvent
from robotree.vr.base.requests import EventsRead, EventsVerified, ReadEvents

MARK = 0x526F4869
"""`application_id` of the file."""
VERSION = 1
"""`user_version` of the file."""
OLDEST = 30 * 24 * 3600.0
"""[s] for which an event is kept."""
LARGEST = 2 * 1024**3
"""[bytes] of the file; before it grows beyond that, the oldest events are deleted."""
PORTION = 2000
"""Events that are deleted at a time."""
DEEPEST = 64
"""Calls above a call that are looked for."""
_BESIDE = ("", "-wal", "-shm", "-journal")
"""Ends of the names of the file itself, and of those that SQLite makes beside it."""

_SCHEMA = """
CREATE TABLE event (number INTEGER PRIMARY KEY, unix REAL NOT NULL, robot TEXT NOT NULL, kind TEXT NOT NULL,
    key TEXT NOT NULL, body BLOB NOT NULL, hash BLOB NOT NULL);
CREATE INDEX by_robot ON event(robot, kind, number);
CREATE INDEX by_key ON event(key) WHERE key != '';
CREATE TABLE ends (which TEXT PRIMARY KEY, number INTEGER NOT NULL, hash BLOB NOT NULL);
INSERT INTO ends VALUES ('last', 0, x''), ('deleted', 0, x'');
"""
_encode = msgspec.json.Encoder().encode
_decode: msgspec.json.Decoder[HistoryEvent] = msgspec.json.Decoder(HistoryEvent)


def link(before: bytes, number: int, body: bytes) -> bytes:
    """Return the hash of a row.

    Args:
        before: hash of the row before it; empty: it is the first.
        number: of the row.
        body: of it.
    """
    return hashlib.sha256(before + number.to_bytes(8, "big") + body).digest()


class HistoryFile:
    """See the module. To be used by one thread at a time."""

    def __init__(self, path: Path, *, writes: bool = False) -> None:
        """Open the file.

        Args:
            path: of it, in a folder of ours.
            writes: whether to write to it, and to make it if it is not there.

        Raises:
            HistoryUnusable: it cannot be opened, or is no such file.
        """
        self.path = path
        with self._explained():
            if writes:
                private_folder(path.parent)
            for beside in _BESIDE:  # SQLite opens them by their names
                expect_own(path.with_name(f"{path.name}{beside}"))
            if writes:
                private_file(path)
            way = f"{path.absolute().as_uri()}?mode={'rw' if writes else 'ro'}"
            self._file = sqlite3.connect(way, uri=True, isolation_level=None, check_same_thread=False)
            try:
                self._open(writes=writes)
            except BaseException:
                self._file.close()
                raise

    def _open(self, *, writes: bool) -> None:
        self._file.execute("PRAGMA busy_timeout = 2000")
        mark = self._file.execute("PRAGMA application_id").fetchone()[0]
        version = self._file.execute("PRAGMA user_version").fetchone()[0]
        if writes and (mark, version) == (0, 0):
            self._file.executescript(
                f"PRAGMA journal_mode = WAL; BEGIN IMMEDIATE; {_SCHEMA}"
                f"PRAGMA application_id = {MARK}; PRAGMA user_version = {VERSION}; COMMIT;"
            )
        elif (mark, version) != (MARK, VERSION):
            raise sqlite3.DatabaseError(f"it is no history of format {VERSION}")
        if writes:
            self._file.execute("PRAGMA synchronous = NORMAL")

    @contextmanager
    def _explained(self) -> Generator[None]:
        try:
            yield
        except (sqlite3.Error, OSError, msgspec.MsgspecError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise HistoryUnusable(path=str(self.path), detail=reason) from None

    def close(self) -> None:
        """Use it no more."""
        self._file.close()

    # -- writing ----------------------------------------------------------------------------------

    def append(self, events: Sequence[HistoryEvent]) -> None:
        """Append events in one transaction: all of them or none.

        Raises:
            HistoryUnusable: they cannot be written.
        """
        with self._explained(), self._transaction():
            number, before = self._end("last")
            rows: list[tuple[object, ...]] = []
            for event in events:
                number += 1
                body = _encode(event)
                before = link(before, number, body)
                rows.append((number, event.unix, event.robot, event.kind, event.key, body, before))
            self._file.executemany("INSERT INTO event VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
            self._file.execute("UPDATE ends SET number = ?, hash = ? WHERE which = 'last'", (number, before))

    def has(self, kind: str, key: str) -> bool:
        """Whether there is an event of this kind of a call."""
        query = "SELECT 1 FROM event WHERE key = ? AND kind = ? LIMIT 1"
        with self._explained():
            return self._file.execute(query, (key, kind)).fetchone() is not None

    def trim(self, now: float, *, oldest: float = OLDEST, largest: int = LARGEST) -> int:
        """Delete some of the oldest events if they are too old, or too many.

        Args:
            now: [s] since 1970.
            oldest: [s] that an event is kept.
            largest: [bytes] that events may take.

        Returns:
            How many were deleted: at most `PORTION`.

        Raises:
            HistoryUnusable: it cannot be written.
        """
        with self._explained():
            names = ("page_count", "freelist_count", "page_size")
            pages, free, size = (self._file.execute(f"PRAGMA {name}").fetchone()[0] for name in names)
            limit = now + 1.0 if (pages - free) * size > largest else now - oldest
            query = "SELECT number, unix, hash FROM event ORDER BY number LIMIT ?"
            last: tuple[int, bytes] | None = None
            count = 0
            for number, unix, digest in self._file.execute(query, (PORTION,)):
                if unix >= limit:
                    break
                last, count = (number, digest), count + 1
            if last is not None:
                with self._transaction():
                    self._file.execute("DELETE FROM event WHERE number <= ?", last[:1])
                    self._file.execute("UPDATE ends SET number = ?, hash = ? WHERE which = 'deleted'", last)
            return count

    @contextmanager
    def _transaction(self) -> Generator[None]:
        with self._file:  # commits, or rolls back
            self._file.execute("BEGIN IMMEDIATE")
            yield

    def _end(self, which: str) -> tuple[int, bytes]:
        row = self._file.execute("SELECT number, hash FROM ends WHERE which = ?", (which,)).fetchone()
        if row is None:
            raise sqlite3.DatabaseError(f"the end {which!r} of the chain is missing")
        return row[0], bytes(row[1])

    # -- reading ----------------------------------------------------------------------------------

    def read(self, request: ReadEvents) -> EventsRead:
        """Return the events that a request asks for.

        Raises:
            HistoryUnusable: it cannot be read.
        """
        with self._explained():
            key = self._last_motion(request.robot) if request.last else request.key
            if key or request.last:
                return EventsRead(events=tuple(self._events_of(above(key))))
            query = (
                "SELECT number, body FROM event WHERE robot = ? AND unix >= ? ORDER BY number DESC LIMIT ?"
            )
            rows = self._file.execute(query, (request.robot, request.since, request.most + 1)).fetchall()
            events = [NumberedEvent(number, _decode.decode(body)) for number, body in rows[: request.most]]
            return EventsRead(events=tuple(reversed(events)), more=len(rows) > request.most)

    def _last_motion(self, robot: str) -> str:
        query = "SELECT key FROM event WHERE robot = ? AND kind = 'accepted' ORDER BY number DESC LIMIT 1"
        row = self._file.execute(query, (robot,)).fetchone()
        return "" if row is None else row[0]

    def _events_of(self, keys: Sequence[str]) -> list[NumberedEvent]:
        marks = ", ".join("?" * len(keys))
        query = f"SELECT number, body FROM event WHERE key IN ({marks}) AND key != '' ORDER BY number"  # noqa: S608
        found = self._file.execute(query, tuple(keys)).fetchall()
        return [NumberedEvent(number, _decode.decode(body)) for number, body in found]

    def robots(self) -> list[str]:
        """Return the names of the robots of which anything is kept.

        Raises:
            HistoryUnusable: it cannot be read.
        """
        with self._explained():
            return [row[0] for row in self._file.execute("SELECT DISTINCT robot FROM event ORDER BY robot")]

    def verify(self) -> EventsVerified:
        """Examine the whole chain.

        Raises:
            HistoryUnusable: it cannot be read.
        """
        with self._explained(), self._file:
            self._file.execute("BEGIN")  # one state of the file, while others write
            return self._verified()

    def _verified(self) -> EventsVerified:
        number, before = self._end("deleted")
        first, count = number + 1, 0
        query = "SELECT number, unix, robot, kind, key, body, hash FROM event ORDER BY number"

        def found(fault: str) -> EventsVerified:
            return EventsVerified(count=count, first=first, last_hash=before.hex(), fault=fault)

        for row in self._file.execute(query):
            expected, body, digest = number + 1, row[5], row[6]
            if row[0] != expected:
                return found(f"event {expected} is missing")
            intact = isinstance(body, bytes) and link(before, expected, body) == digest
            if not (intact and _fits(body, row[1:5])):
                return found(f"event {expected} was changed")
            number, before, count = expected, digest, count + 1
        last, digest = self._end("last")
        if last > number:
            return found(f"event {number + 1} is missing")
        if (last, digest) != (number, before):
            return found(f"event {number} was changed")
        return found("")


def _fits(body: bytes, row: Sequence[object]) -> bool:
    """Whether the columns by which a row is found say what its body says."""
    try:
        event = _decode.decode(body)
    except msgspec.MsgspecError:
        return False
    return (event.unix, event.robot, event.kind, event.key) == tuple(row)


def above(key: str) -> list[str]:
    """Return the keys that a call may have been made by, itself first."""
    parts = key.split("/")
    return ["/".join(parts[:end]) for end in range(len(parts), max(0, len(parts) - DEEPEST), -1)]
