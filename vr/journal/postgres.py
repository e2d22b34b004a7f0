"""A log in PostgreSQL, for hosts on several machines: the same frames as in files, one in each row.

Each write is one statement, which is also the look if this process is still the owner: the database decides
both together. A statement is never left open, so a process that is paused holds no lock of the database.

Between two writes, `expect_owner` trusts the last answer for `SURE` seconds from when its question was sent;
a stand-by waits longer than that without a sign of life (`standby.SHORTEST_AFTER`). So a host that is cut off
from the database does nothing more after `SURE`, and one that does not reach it for `PATIENCE` ends.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import TYPE_CHECKING, Any, LiteralString

from robotree.vr.base.errors import DamagedJournal, Deposed, JournalCutOff, JournalError
from robotree.vr.base.extras import explained
from robotree.vr.journal.segments import frames_in, seal_frame
from robotree.vr.journal.store import Owner

if TYPE_CHECKING:
    import psycopg

SURE = 1.5
"""[s] for which an owner needs not ask again if it still is one."""
PATIENCE = 3.0
"""[s] for which an owner waits for the database: less than is left of a lease of 5 s when it is renewed."""
AGAIN = 0.1
"""[s] between two attempts to reach it."""
WITHIN = 2
"""[s] to wait for a connection, a lock or an answer."""
CUT = "08"
"""First letters of the SQL states of lost connections (PostgreSQL, appendix A)."""

_SCHEMA: LiteralString = """
CREATE TABLE IF NOT EXISTS robotree_log (
    name text PRIMARY KEY, owner bigint NOT NULL, host text NOT NULL, beat bigint NOT NULL
) WITH (fillfactor = 50);
CREATE TABLE IF NOT EXISTS robotree_frame (
    log text NOT NULL, segment bigint NOT NULL, number bigint NOT NULL, body bytea NOT NULL,
    PRIMARY KEY (log, segment, number)
);
ALTER TABLE robotree_frame ALTER body SET STORAGE EXTERNAL;
CREATE TABLE IF NOT EXISTS robotree_record (
    log text NOT NULL, kind text NOT NULL, key text NOT NULL, body bytea NOT NULL,
    PRIMARY KEY (log, kind, key)
);
"""
_HOLD: LiteralString = "SELECT pg_try_advisory_lock(1383027569, hashtext(%(log)s || '/' || %(owner)s::text))"
_LOOK: LiteralString = """
SELECT owner, host, beat, EXISTS (
    SELECT FROM pg_locks WHERE locktype = 'advisory' AND granted AND classid = 1383027569
    AND objid::bigint = hashtext(name || '/' || owner::text)::bigint & 4294967295
) FROM robotree_log WHERE name = %(log)s"""
_FIRST: LiteralString = """
INSERT INTO robotree_log VALUES (%(log)s, 1, %(host)s, 0) ON CONFLICT DO NOTHING RETURNING owner"""
_LET_GO: LiteralString = "SELECT pg_advisory_unlock_all()"
_TAKE: LiteralString = """
UPDATE robotree_log SET owner = owner + 1, host = %(host)s, beat = beat + 1
    WHERE name = %(log)s AND owner = %(after)s RETURNING owner"""
_WRITE: LiteralString = """
WITH ours AS (
    SELECT FROM robotree_log WHERE name = %(log)s AND owner = %(owner)s FOR SHARE
), written AS (
    INSERT INTO robotree_frame SELECT %(log)s, %(segment)s, %(number)s, %(body)s FROM ours
    ON CONFLICT DO NOTHING
) SELECT count(*) FROM ours"""
_DROP: LiteralString = """
WITH ours AS (
    SELECT FROM robotree_log WHERE name = %(log)s AND owner = %(owner)s FOR SHARE
), dropped AS (
    DELETE FROM robotree_frame WHERE log = %(log)s AND segment < %(segment)s AND EXISTS (SELECT FROM ours)
) SELECT count(*) FROM ours"""
_PUT: LiteralString = """
WITH ours AS (
    SELECT FROM robotree_log WHERE name = %(log)s AND owner = %(owner)s FOR SHARE
), gone AS (
    DELETE FROM robotree_record USING unnest(%(gone_kinds)s::text[], %(gone_keys)s::text[]) AS g(k, e)
    WHERE log = %(log)s AND kind = g.k AND key = g.e AND EXISTS (SELECT FROM ours)
), put AS (
    INSERT INTO robotree_record SELECT %(log)s, k, e, b
    FROM ours, unnest(%(kinds)s::text[], %(keys)s::text[], %(bodies)s::bytea[]) AS r(k, e, b)
    ON CONFLICT (log, kind, key) DO UPDATE SET body = excluded.body
) SELECT count(*) FROM ours"""
_RECORDS: LiteralString = "SELECT kind, key, body FROM robotree_record WHERE log = %(log)s"
_BEAT: LiteralString = """
WITH beaten AS (
    UPDATE robotree_log SET beat = beat + 1 WHERE name = %(log)s AND owner = %(owner)s RETURNING name
) SELECT count(*) FROM beaten"""
_READ: LiteralString = """
SELECT segment, number, body FROM robotree_frame WHERE log = %(log)s ORDER BY segment, number"""
_NEWEST: LiteralString = "SELECT coalesce(max(segment), 0) FROM robotree_frame WHERE log = %(log)s"


class _Database:
    """One connection, made again when it was lost."""

    def __init__(self, url: str) -> None:
        """Prepare.

        Raises:
            ImportError: psycopg is not installed.
        """
        try:
            import psycopg
        except ImportError as error:
            raise explained(error) from None
        self._psycopg, self._url = psycopg, url
        self._connection: psycopg.Connection | None = None
        self.on_connect: Callable[[psycopg.Connection], None] = lambda _: None
        """Called with each new connection."""
        self.where = without_password(url)

    @contextlib.contextmanager
    def used(self) -> Generator[psycopg.Connection]:
        """Use the connection.

        Raises:
            ConnectionError: the database cannot be reached, or was lost meanwhile.
            OSError: it refuses, or its disk is full.
        """
        try:
            if self._connection is None or self._connection.closed:
                self._connection = self._connected()
            yield self._connection
        except (self._psycopg.errors.DiskFull, self._psycopg.errors.OutOfMemory) as error:
            raise OSError(28, first_words(error)) from None
        except self._psycopg.Error as error:
            connection, self._connection = self._connection, None
            refused = error.sqlstate is not None and not error.sqlstate.startswith((CUT, "57P", "55P", "53"))
            if connection is not None:
                connection.close()
            raise (OSError if refused else ConnectionError)(f"{self.where}: {first_words(error)}") from None

    def _connected(self) -> psycopg.Connection:
        connection = self._psycopg.connect(
            self._url,
            autocommit=True,
            connect_timeout=WITHIN,
            keepalives_idle=WITHIN,
            keepalives_interval=1,
            keepalives_count=WITHIN,
            tcp_user_timeout=1000 * WITHIN,
        )
        settings = {
            "synchronous_commit": "on",
            "lock_timeout": f"{WITHIN}s",
            "statement_timeout": f"{PATIENCE}s",
        }
        for setting, value in settings.items():
            connection.execute("SELECT set_config(%s, %s, false)", (setting, value))
        self.on_connect(connection)
        return connection

    def close(self, last: LiteralString = "") -> None:
        """End the connection, after a last statement. Twice is once."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with contextlib.suppress(self._psycopg.Error):
                if last:
                    connection.execute(last)
            connection.close()


class PostgresPlace:
    """A log in a database. `LogPlace`."""

    def __init__(self, url: str, log: str) -> None:
        """Prepare; nothing is connected to yet.

        Args:
            url: as libpq takes it, `postgresql://host/database`. The tables are in its first schema.
            log: name of the log: several share a database.

        Raises:
            ImportError: psycopg is not installed.
        """
        self._url, self._log = url, log
        self._database = _Database(url)
        self._database.on_connect = _make_tables
        self.where = f"{self._database.where} ({log})"

    def look(self) -> Owner | None:
        with self._database.used() as connection:
            found = connection.execute(_LOOK, {"log": self._log}).fetchone()
        return None if found is None else Owner(*found)

    def take(self, host: str, after: int) -> PostgresLog | None:
        values = {"log": self._log, "host": host, "after": after}
        with self._database.used() as connection:
            found = connection.execute(_TAKE if after else _FIRST, values).fetchone()
        return None if found is None else PostgresLog(self._url, self._log, int(found[0]), self.where)

    def close(self) -> None:
        self._database.close()


class PostgresLog:
    """A log that this process has taken. `LogStore`."""

    def __init__(self, url: str, log: str, owner: int, where: str) -> None:
        """Connect.

        Raises:
            OSError: the database cannot be reached.
        """
        self.where, self.name, self.size, self.missing, self.was_full = where, log, 0, "", False
        self._values: dict[str, Any] = {"log": log, "owner": owner, "segment": 0, "number": 0}
        self._database = _Database(url)
        self._database.on_connect = self._hold
        self._lock = threading.RLock()
        self._sure_until = 0.0
        """[s, monotonic]"""
        self._closed = False
        with self._lock, self._database.used() as connection:
            found = connection.execute(_NEWEST, self._values).fetchone()
        self._values["segment"] = 0 if found is None else found[0]

    def _hold(self, connection: psycopg.Connection) -> None:
        """Show others that this process lives: the database lets go when the connection ends."""
        connection.execute(_HOLD, self._values)

    # -- reading ----------------------------------------------------------------------------------

    def frames(self, lost_power: Callable[[], bool] = lambda: False) -> Iterator[bytes]:
        """See `LogStore.frames`: the database has lost nothing."""
        del lost_power
        with self._lock, self._database.used() as connection:
            rows = connection.execute(_READ, self._values).fetchall()
        expected = (0, 0)
        for segment, number, body in rows:
            place = f"{self.where}, segment {segment}, frame {number}"
            if segment == expected[0] and number != expected[1]:
                raise DamagedJournal(path=place, at=0, detail="one before it is missing")
            expected = segment, number + 1
            yield from frames_in(bytes(body), place)

    def records(self) -> list[tuple[str, str, bytes]]:
        """Return what is kept beside the log: kind, key and body of each record.

        Raises:
            OSError: the database cannot be read.
        """
        with self._lock, self._database.used() as connection:
            rows = connection.execute(_RECORDS, self._values).fetchall()
        return [(str(kind), str(key), bytes(body)) for kind, key, body in rows]

    # -- writing ----------------------------------------------------------------------------------

    def put_records(
        self, rows: Sequence[tuple[str, str, bytes]], gone: Sequence[tuple[str, str]] = ()
    ) -> None:
        """Keep records beside the log, in the place of those that are known, and remove others; all or none.

        Raises:
            Deposed: another process is the owner; nothing was written.
            JournalCutOff: the database was not reached; it may have been written.
            OSError: it refuses, or its disk is full.
        """
        self._ask(
            _PUT,
            kinds=[kind for kind, _, _ in rows],
            keys=[key for _, key, _ in rows],
            bodies=[body for _, _, body in rows],
            gone_kinds=[kind for kind, _ in gone],
            gone_keys=[key for _, key in gone],
        )

    def begin(self) -> None:
        self._values["segment"] += 1
        self._values["number"] = self.size = 0

    def write(self, body: bytearray) -> None:
        seal_frame(body)
        with self._lock:  # `ON CONFLICT`: the answer to the first attempt may have been lost
            self._ask(_WRITE, body=bytes(body))
            self._values["number"] += 1
        self.size += len(body)

    def sync(self) -> None:
        """See `LogStore.sync`: each statement is (synchronous_commit)."""

    def drop_older(self) -> None:
        self._ask(_DROP)

    def clear(self) -> None:
        self._ask(_DROP, segment=self._values["segment"] + 1)

    def beat(self) -> None:
        if not self._closed:
            self._ask(_BEAT)

    def expect_owner(self) -> None:
        if time.monotonic() >= self._sure_until and not self._closed:
            self._ask(_BEAT)

    def close(self) -> None:
        with self._lock:
            self._closed = True
            self._database.close(_LET_GO)  # the end of a connection takes effect a little later

    def _ask(self, order: LiteralString, **more: Any) -> None:
        """Carry out a statement that only the owner can.

        Raises:
            Deposed: this process is not the owner.
            JournalCutOff: the database was not reached for `PATIENCE`.
            OSError: it refuses, or its disk is full.
        """
        latest = time.monotonic() + PATIENCE
        with self._lock:
            while not self._closed:
                sent = time.monotonic()
                try:
                    with self._database.used() as connection:
                        found = connection.execute(order, {**self._values, **more}).fetchone()
                except ConnectionError as error:
                    if time.monotonic() > latest:
                        raise JournalCutOff(where=self.where, seconds=PATIENCE, reason=str(error)) from None
                    time.sleep(AGAIN)
                    continue
                if found is None or not found[0]:
                    self._sure_until = 0.0
                    raise self._deposed()
                self._sure_until = sent + SURE
                return

    def _deposed(self) -> JournalError:
        host = "somebody else"
        with contextlib.suppress(OSError), self._database.used() as connection:
            found = connection.execute(_LOOK, self._values).fetchone()
            host = host if found is None else found[1]
        return Deposed(host=host, log=self.where)


def _make_tables(connection: psycopg.Connection) -> None:
    with connection.transaction():
        connection.execute("SELECT pg_advisory_xact_lock(1383027570)")
        connection.execute(_SCHEMA)


def first_words(error: Exception) -> str:
    """Return the first line of what PostgreSQL says."""
    text = str(error).strip()
    return text.splitlines()[0] if text else type(error).__name__


def without_password(url: str) -> str:
    """Return where a database is, for people."""
    from psycopg.conninfo import conninfo_to_dict

    found = conninfo_to_dict(url)
    return f"postgresql://{found.get('host', '')}:{found.get('port', 5432)}/{found.get('dbname', '')}"
