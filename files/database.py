"""A SQLite file that one process owns: nobody else opens it meanwhile, and damage is seen first."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Generator
from pathlib import Path

import msgspec

from robotree.files.private import private_file

Explain = Callable[[str], Exception]
"""Makes an error of the caller's room from a clause."""


class OwnedDatabase:
    """See the module. It is in the WAL mode; what is written without a transaction is one of its own."""

    def __init__(
        self,
        path: Path,
        schema: str,
        *,
        mark: int,
        version: int,
        unusable: Explain,
        damaged: Explain,
        full: Explain,
    ) -> None:
        """Open or make the file.

        Args:
            path: of the file, in a folder that only this user can enter.
            schema: makes its tables, in statements that end with a semicolon.
            mark: `application_id` of the file: it is of this program.
            version: `user_version` of the file.
            unusable: error of a file that cannot be used, is another process's or program's, or of another
                version; here, and wherever `explained` is used, as the next two.
            damaged: error of what cannot be read.
            full: error of a disk that is full.
        """
        self._unusable, self._damaged, self._full = unusable, damaged, full
        with self.explained():
            private_file(path)
            file = sqlite3.connect(path, timeout=0.0, isolation_level=None, check_same_thread=False)
            try:
                file.execute("PRAGMA locking_mode=EXCLUSIVE")
                file.execute("BEGIN EXCLUSIVE")  # nobody else has it from here on
                self._expect_ours(file, schema, mark, version)
                file.execute("COMMIT")
                file.execute("PRAGMA journal_mode=WAL")
                self._expect_whole(file)
            except BaseException:
                file.close()
                raise
        self._file = file
        self.execute = file.execute
        self.close = file.close

    def _expect_ours(self, file: sqlite3.Connection, schema: str, mark: int, version: int) -> None:
        found, known, tables = (
            file.execute(query).fetchone()[0]
            for query in (
                "PRAGMA application_id",
                "PRAGMA user_version",
                "SELECT count(*) FROM sqlite_master",
            )
        )
        if not (found or known or tables):
            for order in filter(str.strip, schema.split(";")):
                file.execute(order)
            file.execute(f"PRAGMA application_id={mark}")
            file.execute(f"PRAGMA user_version={version}")
        elif found != mark:
            raise self._unusable("it is a database of another program")
        elif known != version:
            reason = f"it is of version {known}, this robotree reads version {version}; use that robotree"
            raise self._unusable(reason)

    def _expect_whole(self, file: sqlite3.Connection) -> None:
        damage = file.execute("PRAGMA quick_check(1)").fetchone()[0]
        if damage != "ok":
            raise self._damaged(" ".join(str(damage).split()))

    @contextlib.contextmanager
    def transaction(self) -> Generator[None]:
        """Do all of a block or nothing."""
        self.execute("BEGIN")
        try:
            yield
            self.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):
                self.execute("ROLLBACK")
            raise

    @contextlib.contextmanager
    def explained(self) -> Generator[None]:
        """Make an error of the caller's room of what goes wrong in a block."""
        try:
            yield
        except OSError as error:
            raise self._unusable(error.strerror or str(error)) from None
        except sqlite3.ProgrammingError:
            raise self._unusable("it is closed") from None
        except (sqlite3.Error, msgspec.MsgspecError, OverflowError) as error:
            raise self._in_words(error) from None

    def _in_words(self, error: Exception) -> Exception:
        code: int = getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF
        if code == sqlite3.SQLITE_FULL:
            return self._full("its disk is full; make room on that disk")
        if code in {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}:
            return self._unusable("another process owns it, and serves it; ask that one, or end it first")
        # SQLITE_ERROR: a table that it was made with is not there
        if code in {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR}:
            return self._damaged(str(error))
        return self._unusable(
            f"it cannot be written or read ({error}); nothing was changed: look at its disk"
        )
