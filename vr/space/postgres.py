"""A space in PostgreSQL: any number of processes serve it together, on any number of machines.

What a transaction holds is written into the rows (`taken_by`, `written_by`, `readers`), each time in one
short transaction of PostgreSQL. So nothing waits for an open transaction, a lost connection ends none, and
the lease of one ends by the clock of the database, whoever looks. NOTIFY tells the others what has changed;
they look once a second besides.

Each statement is committed alone: durability `power` waits for the disk (synchronous_commit=on), `process`
does not (off): what was answered survives all processes of robotree, but the last moments (up to three times
`wal_writer_delay`, 0.6 s) not a crash of PostgreSQL itself. Fences are always kept as `power`.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, LiteralString

import msgspec

from robotree.vr.base.chance import token
from robotree.vr.base.entry import Entry, marks_of
from robotree.vr.base.errors import (
    FenceLost,
    KeyTaken,
    NoSuchEntry,
    SpaceDamaged,
    SpaceFull,
    SpaceLost,
    SpaceUnusable,
    TransactionOver,
)
from robotree.vr.base.extras import explained
from robotree.vr.base.requests import KeptEntry, KeptFence
from robotree.vr.journal.postgres import first_words, without_password
from robotree.vr.space.store import Contents, Durability, EntryNews, FenceState, nothing
from robotree.vr.space.table import Row

if TYPE_CHECKING:
    import psycopg

CHANNEL = "robotree_space"
"""Of NOTIFY."""
VERSION = 1
"""Of the tables."""
LOCK_WITHIN = 5
"""[s] to wait for a connection, or for a lock."""
LOOK = 1.0
"""[s] between two looks for what no bell has told."""

_SCHEMA: LiteralString = """
CREATE TABLE IF NOT EXISTS robotree_space (version integer NOT NULL);
INSERT INTO robotree_space SELECT 1 WHERE NOT EXISTS (SELECT FROM robotree_space);
CREATE TABLE IF NOT EXISTS robotree_entry (
    id bigint GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    marks text[] NOT NULL, body bytea NOT NULL, expires float8 NOT NULL,
    key text, lent_key text, taken_by text, written_by text, readers text[] NOT NULL DEFAULT '{}'
) WITH (fillfactor = 70, autovacuum_vacuum_scale_factor = 0.01);
CREATE UNIQUE INDEX IF NOT EXISTS robotree_entry_key ON robotree_entry (key) WHERE key IS NOT NULL;
CREATE INDEX IF NOT EXISTS robotree_entry_marks ON robotree_entry USING gin (marks)
    WITH (fastupdate = off);
CREATE INDEX IF NOT EXISTS robotree_entry_taken ON robotree_entry (taken_by) WHERE taken_by IS NOT NULL;
CREATE INDEX IF NOT EXISTS robotree_entry_written ON robotree_entry (written_by) WHERE written_by IS NOT NULL;
CREATE INDEX IF NOT EXISTS robotree_entry_read ON robotree_entry USING gin (readers) WHERE readers <> '{}';
CREATE INDEX IF NOT EXISTS robotree_entry_ends ON robotree_entry (expires) WHERE expires < 'Infinity';
CREATE TABLE IF NOT EXISTS robotree_transaction (name text PRIMARY KEY, expires float8 NOT NULL);
CREATE TABLE IF NOT EXISTS robotree_fence (
    name text PRIMARY KEY, epoch bigint NOT NULL, holder text NOT NULL, expires float8 NOT NULL
);
CREATE OR REPLACE FUNCTION robotree_now() RETURNS float8 LANGUAGE sql VOLATILE AS
    'SELECT extract(epoch FROM clock_timestamp())::float8';
"""
_NOTIFY: LiteralString = "SELECT pg_notify('robotree_space', '')"
_WRITE: LiteralString = """
WITH written AS (
    INSERT INTO robotree_entry (marks, body, expires, key) VALUES (%s, %s, robotree_now() + %s, %s)
    ON CONFLICT (key) WHERE key IS NOT NULL DO NOTHING RETURNING id
) SELECT id, pg_notify('robotree_space', '') FROM written"""
_WRITE_WITHIN: LiteralString = """
WITH open AS (
    SELECT name FROM robotree_transaction WHERE name = %(t)s AND expires > robotree_now() FOR SHARE
) INSERT INTO robotree_entry (marks, body, expires, key, written_by)
    SELECT %(marks)s, %(body)s, robotree_now() + %(term)s, %(key)s, name FROM open
    ON CONFLICT (key) WHERE key IS NOT NULL DO NOTHING RETURNING id"""
_LEND: LiteralString = """
UPDATE robotree_entry SET lent_key = key, key = NULL WHERE key = %(key)s AND taken_by = %(t)s"""
_READ: LiteralString = """
SELECT id, body, key, expires FROM robotree_entry
    WHERE marks @> %(marks)s AND taken_by IS NULL AND written_by IS NULL
    AND expires > (SELECT robotree_now()) ORDER BY id LIMIT %(most)s"""
_TAKE: LiteralString = """
DELETE FROM robotree_entry WHERE id = ANY(ARRAY(
    SELECT id FROM robotree_entry WHERE marks @> %(marks)s AND taken_by IS NULL AND written_by IS NULL
    AND readers = '{}' AND expires > (SELECT robotree_now()) ORDER BY id LIMIT %(most)s FOR UPDATE SKIP LOCKED
)) RETURNING id, body, key, expires"""
_READ_WITHIN: LiteralString = """
WITH open AS (
    SELECT name FROM robotree_transaction WHERE name = %(t)s AND expires > robotree_now() FOR SHARE
) UPDATE robotree_entry SET readers = CASE
        WHEN written_by IS NULL THEN array_append(array_remove(readers, %(t)s), %(t)s) ELSE readers END
    WHERE EXISTS (SELECT FROM open) AND id = ANY(ARRAY(
    SELECT id FROM robotree_entry WHERE marks @> %(marks)s AND taken_by IS NULL
    AND (written_by IS NULL OR written_by = %(t)s)
    AND expires > (SELECT robotree_now()) ORDER BY id LIMIT %(most)s FOR UPDATE
)) RETURNING id, body, key, expires, written_by"""
_TAKE_WITHIN: LiteralString = """
WITH open AS (
    SELECT name FROM robotree_transaction WHERE name = %(t)s AND expires > robotree_now() FOR SHARE
) UPDATE robotree_entry SET taken_by = %(t)s, readers = '{}'
    WHERE EXISTS (SELECT FROM open) AND id = ANY(ARRAY(
    SELECT id FROM robotree_entry WHERE marks @> %(marks)s AND taken_by IS NULL
    AND (written_by IS NULL OR written_by = %(t)s) AND readers <@ ARRAY[%(t)s]
    AND expires > (SELECT robotree_now()) ORDER BY id LIMIT %(most)s FOR UPDATE SKIP LOCKED
)) RETURNING id, body, key, expires, written_by"""
_BY_KIND: dict[tuple[bool, bool], LiteralString] = {
    (False, False): _READ,
    (True, False): _TAKE,
    (False, True): _READ_WITHIN,
    (True, True): _TAKE_WITHIN,
}
"""The orders that find entries, by `take` and whether it is done in a transaction."""
_BY_FIELDS: dict[tuple[bool, bool], LiteralString] = {
    how: order.replace("ORDER BY id", "ORDER BY id + 0") for how, order in _BY_KIND.items()
}
"""The same for templates with fields. Few entries match those, and `LIMIT 1` misleads the planner into
reading all in their order (12 ms of 10,000); to sort by a sum it has to find them by their marks first."""
_GIVE_KEYS_BACK: LiteralString = """
UPDATE robotree_entry SET key = lent_key, lent_key = NULL WHERE lent_key = ANY(%s)"""
"""The entry that a transaction has taken has its key again, when what it wrote instead is gone."""
_RENEW: LiteralString = """
UPDATE robotree_entry SET expires = robotree_now() + %(term)s
    WHERE id = %(id)s AND taken_by IS NULL AND expires > robotree_now() RETURNING id"""
_CANCEL: LiteralString = """
DELETE FROM robotree_entry
    WHERE id = %(id)s AND taken_by IS NULL AND expires > robotree_now() RETURNING key, written_by"""
_LIST: LiteralString = """
SELECT id, body, coalesce(key, lent_key, ''), expires - robotree_now(),
    taken_by IS NOT NULL OR readers <> '{}' FROM robotree_entry
    WHERE written_by IS NULL AND expires > (SELECT robotree_now()) ORDER BY id"""
_FENCES: LiteralString = """
SELECT name, epoch, holder, greatest(expires - robotree_now(), 0) FROM robotree_fence ORDER BY name"""
_ACQUIRE: LiteralString = """
INSERT INTO robotree_fence AS f VALUES (%(name)s, 1, %(holder)s, robotree_now() + %(term)s)
    ON CONFLICT (name) DO UPDATE
    SET epoch = f.epoch + 1, holder = excluded.holder, expires = excluded.expires
    WHERE f.holder = '' OR f.expires <= robotree_now() RETURNING epoch"""


class PostgresStore:
    """See the module. `SpaceStore`."""

    slow: bool = True

    def __init__(
        self, name: str, url: str, *, durability: Durability = "power", listens: bool = True
    ) -> None:
        """Connect, and make the tables where they are missing.

        Args:
            name: of the space, for messages.
            url: as libpq takes it, `postgresql://host/database`. The tables are in its first schema.
            durability: `process` or `power`.
            listens: whether to be told of what others change.

        Raises:
            SpaceUnusable: it cannot be connected to, or has tables of another version.
            ImportError: psycopg is not installed.
        """
        try:
            import psycopg
        except ImportError as error:
            raise explained(error) from None
        self.name, self._url, self.durability = name, url, durability
        self.where = without_password(url)
        self.rings: Callable[[], None] = nothing
        self._psycopg = psycopg
        self._news: list[EntryNews] = []
        self._closed = False
        self._connection: psycopg.Connection | None = None
        self._pids: set[int] = set()
        """The server's processes behind our connections: their bells are our own."""
        with self._lent() as connection:
            self._make_tables(connection)
        if listens:
            threading.Thread(target=self._listen, name=f"space {name} listens", daemon=True).start()

    def close(self) -> None:
        self._closed = True
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    @contextlib.contextmanager
    def together(self) -> Generator[None]:
        """See `SpaceStore.together`: each operation is kept when it is done."""
        yield

    # -- entries ----------------------------------------------------------------------------------

    def write(self, entry: Entry, term: float, key: str, transaction: str) -> tuple[int, float]:
        marks = marks_of(entry.kinds, entry.fields)
        values = (list(marks), _encode(entry), term, key or None)
        for last in (False, True):
            with self._lent("the write") as connection:
                if transaction:
                    id_ = self._write_within(connection, values, transaction)
                else:
                    found = connection.execute(_WRITE, values).fetchone()
                    id_ = None if found is None else found[0]
            if id_ is not None:
                if not transaction:
                    self._news.append(marks)
                return id_, term
            if not last:
                self.expire()  # the key may be that of an entry which has ended
        raise KeyTaken(space=self.name, key=key)

    def _write_within(
        self, connection: psycopg.Connection, values: tuple[Any, ...], transaction: str
    ) -> int | None:
        named = dict(zip(("marks", "body", "term", "key"), values, strict=True)) | {"t": transaction}
        with connection.transaction():
            if named["key"]:
                connection.execute(_LEND, named)
            found = connection.execute(_WRITE_WITHIN, named).fetchone()
            if found is None:
                self._expect_open(connection, transaction)
        return None if found is None else int(found[0])

    def find(
        self, kind: str, fields: Mapping[str, Any], transaction: str, *, take: bool, most: int
    ) -> Sequence[Row]:
        marks = list(marks_of((kind,) if kind else (), fields))
        values = {"marks": marks, "most": most, "t": transaction}
        order = (_BY_FIELDS if fields else _BY_KIND)[take, bool(transaction)]
        with self._lent("the take" if take else "") as connection:
            if transaction:
                found = self._find_within(connection, order, values, take=take)
            else:
                found = connection.execute(order, values).fetchall()
        return sorted(
            (
                Row(id_, _decode(body, self.where), frozenset(), key or "", expires)
                for id_, body, key, expires, *_ in found
            ),
            key=lambda row: row.id,
        )

    def _find_within(
        self, connection: psycopg.Connection, order: LiteralString, values: dict[str, Any], *, take: bool
    ) -> list[tuple[Any, ...]]:
        with connection.transaction():
            found = connection.execute(order, values).fetchall()
            if not found:
                self._expect_open(connection, values["t"])
            own = [(id_, key) for id_, _, key, _, written_by in found if written_by]
            if take and own:
                ids = [id_ for id_, _ in own]
                connection.execute("DELETE FROM robotree_entry WHERE id = ANY(%s)", (ids,))
                connection.execute(_GIVE_KEYS_BACK, ([key for _, key in own if key],))
        return found

    def put_back(self, rows: Sequence[Row]) -> None:
        order: LiteralString = """
            INSERT INTO robotree_entry (id, marks, body, expires, key) OVERRIDING SYSTEM VALUE
            SELECT %(id)s, %(marks)s, %(body)s, %(expires)s,
                CASE WHEN EXISTS (SELECT FROM robotree_entry WHERE key = %(key)s) THEN NULL ELSE %(key)s END
            ON CONFLICT DO NOTHING"""
        self.expire()
        with self._lent("what was given back") as connection, connection.transaction():
            for row in rows:
                entry, key = row.entry, row.key or None
                marks = list(marks_of(entry.kinds, entry.fields))
                values = {"id": row.id, "marks": marks, "body": _encode(entry), "expires": row.expires}
                connection.execute(order, {**values, "key": key})
            connection.execute(_NOTIFY)
        self._news.append(None)

    def renew(self, id_: int, term: float) -> float:
        with self._lent("the renewal") as connection, connection.transaction():
            found = connection.execute(_RENEW if term else _CANCEL, {"id": id_, "term": term}).fetchone()
            if found is not None and not term and found[0] and found[1]:
                connection.execute(_GIVE_KEYS_BACK, ([found[0]],))
        if found is None:
            raise NoSuchEntry(space=self.name, id=id_)
        return term

    # -- transactions -----------------------------------------------------------------------------

    def open(self, term: float) -> str:
        transaction = token()
        order: LiteralString = "INSERT INTO robotree_transaction VALUES (%s, robotree_now() + %s)"
        with self._lent("the begin of a transaction") as connection:
            connection.execute(order, (transaction, term))
        return transaction

    def commit(self, transaction: str) -> None:
        values = {"t": transaction}
        over: LiteralString = (
            "DELETE FROM robotree_transaction WHERE name = %(t)s AND expires > robotree_now() RETURNING name"
        )
        with self._lent("the commit") as connection, connection.transaction():
            if connection.execute(over, values).fetchone() is None:
                raise TransactionOver(space=self.name, reason=_OVER)
            with connection.pipeline():
                connection.execute("DELETE FROM robotree_entry WHERE taken_by = %(t)s", values)
                connection.execute(
                    "UPDATE robotree_entry SET written_by = NULL WHERE written_by = %(t)s", values
                )
                self._leave_readers(connection, [transaction])
                connection.execute(_NOTIFY)
        self._news.append(None)

    def roll_back(self, transaction: str) -> None:
        over: LiteralString = "DELETE FROM robotree_transaction WHERE name = %s RETURNING name"
        with self._lent() as connection, connection.transaction():
            if connection.execute(over, (transaction,)).fetchone() is not None:
                self._take_back(connection, [transaction])

    def _take_back(self, connection: psycopg.Connection, names: list[str]) -> None:
        with connection.pipeline():
            connection.execute("DELETE FROM robotree_entry WHERE written_by = ANY(%s)", (names,))
            connection.execute(
                "UPDATE robotree_entry SET taken_by = NULL, key = coalesce(lent_key, key), lent_key = NULL"
                " WHERE taken_by = ANY(%s)",
                (names,),
            )
            self._leave_readers(connection, names)
            connection.execute(_NOTIFY)
        self._news.append(None)

    def _leave_readers(self, connection: psycopg.Connection, names: list[str]) -> None:
        connection.execute(
            "UPDATE robotree_entry"
            " SET readers = ARRAY(SELECT unnest(readers) EXCEPT SELECT unnest(%(names)s))"
            " WHERE readers <> '{}' AND readers && %(names)s",
            {"names": names},
        )

    def _expect_open(self, connection: psycopg.Connection, transaction: str) -> None:
        """Refuse what belongs to a transaction that has ended.

        Raises:
            TransactionOver: it has.
        """
        order: LiteralString = "SELECT FROM robotree_transaction WHERE name = %s AND expires > robotree_now()"
        if connection.execute(order, (transaction,)).fetchone() is None:
            raise TransactionOver(space=self.name, reason=_OVER)

    # -- fences -----------------------------------------------------------------------------------

    def acquire(self, name: str, holder: str, term: float) -> FenceState:
        values = {"name": name, "holder": holder, "term": term}
        with self._lent("the fence") as connection:
            with connection.transaction():
                connection.execute("SET LOCAL synchronous_commit = on")  # an epoch never comes twice
                granted = connection.execute(_ACQUIRE, values).fetchone()
            if granted is not None:
                return FenceState(granted[0], holder, term, granted=True)
            return self._fence(connection, name)

    def renew_fence(self, name: str, epoch: int, term: float) -> FenceState:
        order: LiteralString = """
            WITH renewed AS (
                UPDATE robotree_fence SET expires = robotree_now() + %(term)s,
                    holder = CASE WHEN %(term)s > 0 THEN holder ELSE '' END
                WHERE name = %(name)s AND epoch = %(epoch)s AND holder <> '' AND expires > robotree_now()
                RETURNING holder
            ) SELECT holder, CASE WHEN %(term)s > 0 THEN NULL ELSE pg_notify('robotree_space', '') END
              FROM renewed"""
        with self._lent("the fence") as connection:
            values = {"name": name, "epoch": epoch, "term": term}
            found = connection.execute(order, values).fetchone()
            if found is None:
                current = self._fence(connection, name).epoch
                raise FenceLost(name=name, epoch=epoch, current=current)
        return FenceState(epoch, found[0], term, granted=True)

    def _fence(self, connection: psycopg.Connection, name: str) -> FenceState:
        order: LiteralString = (
            "SELECT epoch, holder, greatest(expires - robotree_now(), 0) FROM robotree_fence WHERE name = %s"
        )
        found = connection.execute(order, (name,)).fetchone()
        epoch, holder, left = found or (0, "", 0.0)
        return FenceState(epoch, holder, left, granted=False)

    # -- time, news and people --------------------------------------------------------------------

    def expire(self) -> float:
        with self._lent() as connection, connection.transaction():
            over = connection.execute(
                "DELETE FROM robotree_transaction WHERE expires <= (SELECT robotree_now()) RETURNING name"
            ).fetchall()
            if over:
                self._take_back(connection, [name for (name,) in over])
            ended = connection.execute(
                "DELETE FROM robotree_entry WHERE expires < 'Infinity' AND taken_by IS NULL"
                " AND expires <= (SELECT robotree_now()) RETURNING key, written_by"
            ).fetchall()
            if keys := [key for key, written_by in ended if key and written_by]:
                connection.execute(_GIVE_KEYS_BACK, (keys,))
            due = connection.execute(
                "SELECT min(expires) - robotree_now() FROM robotree_transaction"
            ).fetchone()
        self._news.append(None)  # what no bell has told
        return LOOK if due is None or due[0] is None else min(LOOK, float(due[0]))

    def news(self) -> Sequence[EntryNews]:
        news, self._news = self._news, []
        return news

    def contents(self, kind: str, most: int) -> Contents:
        counts = dict[str, int]()
        kept: list[KeptEntry] = []
        with self._lent() as connection:
            for id_, body, key, left, held in connection.execute(_LIST):
                entry = _decode(body, self.where)
                counts[entry.kind] = counts.get(entry.kind, 0) + 1
                if len(kept) < most and (not kind or kind in entry.kinds):
                    kept.append(KeptEntry(id_, entry, key, left, held))
            pending = connection.execute(
                "SELECT count(*) FROM robotree_transaction WHERE expires > robotree_now()"
            ).fetchone()
            fences = connection.execute(_FENCES).fetchall()
        return Contents(
            counts=counts,
            transactions=0 if pending is None else pending[0],
            entries=tuple(kept),
            fences=tuple(
                KeptFence(name, epoch, holder if left else "", left) for name, epoch, holder, left in fences
            ),
        )

    # -- the connection ---------------------------------------------------------------------------

    @contextlib.contextmanager
    def _lent(self, doubtful: str = "") -> Generator[psycopg.Connection]:
        """Use the connection; one that was lost is made again.

        Args:
            doubtful: what nobody knows of if the connection is lost meanwhile; empty: nothing was asked.

        Raises:
            SpaceLost: the connection was lost, and with it the answer.
            SpaceUnusable: PostgreSQL cannot be connected to, or refuses.
            SpaceFull: its disk is full.
        """
        errors = self._psycopg.errors
        connection = self._connected()
        try:
            yield connection
        except (errors.DiskFull, errors.OutOfMemory) as error:
            raise SpaceFull(space=self.name, reason=first_words(error)) from None
        except (errors.DataCorrupted, errors.IndexCorrupted) as error:
            raise SpaceDamaged(where=self.where, reason=first_words(error)) from None
        except self._psycopg.Error as error:
            if connection.closed or connection.broken:
                self._connection = None
                if doubtful:
                    raise SpaceLost(space=self.name, request=doubtful) from None
            raise SpaceUnusable(where=self.where, reason=first_words(error)) from None

    def _connected(self) -> psycopg.Connection:
        if self._connection is None or self._connection.closed:
            self._connection = self._connect()
            mode = "on" if self.durability == "power" else "off"
            settings = {"synchronous_commit": mode, "lock_timeout": f"{LOCK_WITHIN}s"}
            for setting, value in settings.items():
                self._connection.execute("SELECT set_config(%s, %s, false)", (setting, value))
        return self._connection

    def _connect(self) -> psycopg.Connection:
        try:
            connection = self._psycopg.connect(self._url, autocommit=True, connect_timeout=LOCK_WITHIN)
        except self._psycopg.Error as error:
            raise SpaceUnusable(where=self.where, reason=first_words(error)) from None
        self._pids.add(connection.info.backend_pid)
        return connection

    def _make_tables(self, connection: psycopg.Connection) -> None:
        with connection.transaction():
            connection.execute("SELECT pg_advisory_xact_lock(1383027568)")
            there = connection.execute("SELECT to_regclass('robotree_space')").fetchone()
            if there is None or there[0] is None:
                connection.execute(_SCHEMA)
            version = connection.execute("SELECT version FROM robotree_space").fetchone()
        if version is None or version[0] != VERSION:
            found = "no version" if version is None else f"version {version[0]}"
            reason = f"its tables are of {found}, this robotree uses version {VERSION}; use that robotree"
            raise SpaceUnusable(where=self.where, reason=reason)

    def _listen(self) -> None:
        """Hear the bell of others; a lost connection is made again, and what it missed is looked for."""
        while not self._closed:
            with contextlib.suppress(self._psycopg.Error, SpaceUnusable), self._connect() as connection:
                connection.execute("LISTEN robotree_space")
                self.rings()
                while not self._closed:
                    for bell in connection.notifies(timeout=LOOK, stop_after=1):
                        if bell.pid not in self._pids:
                            self.rings()
            threading.Event().wait(LOOK if not self._closed else 0.0)


_OVER = "its time was over, its program has gone, or it was ended before"
_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[Entry] = msgspec.msgpack.Decoder(Entry)


def _decode(body: bytes, where: str) -> Entry:
    try:
        return _decoder.decode(body)
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SpaceDamaged(where=where, reason=str(error)) from None
