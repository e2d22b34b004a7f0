"""The three stores of a space, with a clock that tests move."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import Any

from robotree.vr.space.postgres import PostgresStore
from robotree.vr.space.sqlite import SqliteStore
from robotree.vr.space.store import MemoryStore, SpaceStore
from tests.vr.space.postgres import Server

KINDS = ("memory", "sqlite", "postgres")
_numbers = count()


class Timed:
    """A store with its clock."""

    store: SpaceStore
    """Set by who makes it."""

    def __init__(self) -> None:
        self.time = 1000.0

    def now(self) -> float:
        return self.time

    def unix(self) -> float:
        return self.time + 1.7e9

    def pass_time(self, seconds: float) -> None:
        self.time += seconds


class TimedPostgres(Timed):
    """The clock of the database stands still, too: it is a setting of the connection."""

    def pass_time(self, seconds: float) -> None:
        super().pass_time(seconds)
        assert isinstance(self.store, PostgresStore)
        with self.store._lent() as connection:
            connection.execute("SELECT set_config('robotree.now', %s, false)", (str(self.time),))


def memory() -> Timed:
    timed = Timed()
    timed.store = MemoryStore("jobs", timed.now)
    return timed


def sqlite(path: Path, **options: Any) -> Timed:
    timed = Timed()
    timed.store = SqliteStore("jobs", path, timed.now, timed.unix, **options)
    return timed


def schema_of(server: Server) -> str:
    """Make an empty schema; return the URL of it."""
    import psycopg

    name = f"t{next(_numbers)}"
    with psycopg.connect(server.url, autocommit=True) as connection:
        connection.execute(f"CREATE SCHEMA {name}")  # type: ignore[arg-type,unused-ignore]
    return f"{server.url}&options=-csearch_path%3D{name}"


def ring(url: str) -> None:
    """Have stores that were closed look at once whether they were: without a bell they do so each second."""
    import psycopg

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("NOTIFY robotree_space")


def postgres(server: Server) -> Timed:
    timed = TimedPostgres()
    timed.store = store = PostgresStore("jobs", schema_of(server), listens=False)
    with store._lent() as connection:
        connection.execute(
            "CREATE OR REPLACE FUNCTION robotree_now() RETURNS float8 LANGUAGE sql VOLATILE AS"
            " 'SELECT current_setting(''robotree.now'')::float8'"
        )
    timed.pass_time(0.0)
    return timed
