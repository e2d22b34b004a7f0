"""What assistants asked for and what became of it: `assistants/NAME.jsonl`, beside what the realm keeps.

Every request that could have moved something is a line, also one that was refused before it reached a robot.
What robots carried out is in their own histories as well, with the same key (`robotree why`).
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Generator, Iterable
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeVar

import msgspec

from robotree.assistants.budget import Budget, Use
from robotree.assistants.marking import data_of
from robotree.files import alone, opened_own, private_folder, read, replace
from robotree.vr.base.foreign import bounded

FOLDER: Final = "assistants"
LARGEST: Final = 4 << 20
"""[B] of one record, which then becomes `.old`."""
LONGEST_LINE: Final = 8000
"""[B]"""
LONGEST_LOG: Final = 64 * 1024
"""[B] of a budget with its changes; then it is written anew, as it is."""
ASIDE: Final = frozenset({"came", "refused", "stopped", "gone"})
"""Kinds of entries that have a file of their own, since an assistant can cause any number of them."""
_Found = TypeVar("_Found")

Became = Literal[
    "came", "refused", "asked", "answered", "begun", "done", "failed", "stopped", "gone", "rehearsed"
]


class Entry(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One line of a record."""

    unix: float
    """[s] since 1970."""
    became: Became = msgspec.field(name="what")
    robot: str = ""
    command: str = ""
    arguments: Any = None
    why: str = ""
    """In the assistant's words."""
    key: str = ""
    """Of the call, as in the robot's history."""
    permit: str = ""
    by: str = ""
    """The person who said yes."""
    text: str = ""
    """Why it was refused, how it ended, what was observed."""


class Record:
    """The record and the budget of one assistant."""

    def __init__(self, folder: Path, assistant: str, unix: Callable[[], float] = time.time) -> None:
        """Take the folder in which the realm keeps its things, and the clock [s since 1970]."""
        self.folder, self.assistant, self.unix = folder / FOLDER, assistant, unix
        self._lines = self.folder / f"{assistant}.jsonl"
        self._aside = self.folder / f"{assistant}.aside.jsonl"
        """What moved nothing (`ASIDE`): however much of that an assistant causes, the rest stays."""
        self._uses = self.folder / f"{assistant}.used.json"
        """Each line either all that was used (`Use`), or changes of that; see `Budget.replay`."""
        self._known: _Known | None = None
        self._made = False

    def write(self, became: Became, **fields: Any) -> None:
        """Append a line; texts and arguments are bounded. It is on its way to the disk when this returns.

        Args:
            became: what became of it.
            fields: the other fields of the `Entry`.

        Raises:
            OSError: it cannot be written.
        """
        texts = {name: bounded(value, 1000) if isinstance(value, str) else data_of(value)
                 for name, value in fields.items()}  # fmt: skip
        line = msgspec.json.encode(Entry(unix=self.unix(), became=became, **texts))
        if len(line) > LONGEST_LINE:
            line = msgspec.json.encode(
                Entry(unix=self.unix(), became=became, **{**texts, "arguments": "too large"})
            )
        lines = self._aside if became in ASIDE else self._lines
        with self._locked():
            file = opened_own(lines, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
            with os.fdopen(file, "ab") as stream:
                stream.write(line + b"\n")
                full = stream.tell() > LARGEST
            if full:
                lines.replace(lines.with_suffix(".old"))

    def entries(self, most: int = 100) -> list[Entry]:
        """Return the latest lines, the oldest of these first; a broken one is left out."""
        found: list[Entry] = []
        for path in (self._lines, self._aside):
            with contextlib.suppress(OSError):
                found += _entries(read(path, LARGEST + 2 * LONGEST_LINE).splitlines()[-most:])
        return sorted(found, key=lambda entry: entry.unix)[-most:]

    # -- budget -----------------------------------------------------------------------------------

    def budget(self) -> Budget:
        """Return what was used lately, by each process that has served the assistant."""
        with self._locked():
            return self._budget()

    def change(self, change: Callable[[Budget, float], _Found]) -> _Found:
        """Change the budget while nobody else looks at it; it is in the file when this returns.

        So it outlives every process. What a loss of power may take away is what was noted after the latest
        `sync`.

        Args:
            change: takes the budget and the time [s since 1970]; what it raises leaves all as it was.

        Returns:
            What `change` returns.

        Raises:
            OSError: it cannot be kept.
        """
        with self._locked():
            budget = self._budget()
            budget.changes.clear()
            try:
                found = change(budget, self.unix())
            except BaseException:
                self._known = None  # whatever it has done to the budget was not kept
                raise
            if budget.changes:
                self._append(budget)
        return found

    def sync(self) -> None:
        """Return when all that was noted before survives a loss of power.

        Raises:
            OSError: it cannot be kept.
        """
        file = opened_own(self._uses, os.O_RDONLY)
        try:
            os.fdatasync(file)
        finally:
            os.close(file)

    def _append(self, budget: Budget) -> None:
        """Note the changes of a budget by one line, or all of it, if there are many lines. Under the lock."""
        known, self._known = self._known, None
        line = msgspec.json.encode(budget.changes) + b"\n"
        if known is None or known.size + len(line) > LONGEST_LOG:
            replace(self._uses, msgspec.json.encode(budget.uses) + b"\n")
        else:
            file = opened_own(self._uses, os.O_WRONLY | os.O_APPEND)
            try:
                if os.write(file, line) != len(line):
                    raise OSError(f"the disk took only a part of what {self.assistant} uses")
            finally:
                os.close(file)
        found = self._uses.stat()
        self._known = _Known(found.st_ino, found.st_size, budget)

    def _budget(self) -> Budget:
        """Return what was used, from the file if another process has changed it. Under the lock."""
        try:
            found = self._uses.lstat()
        except FileNotFoundError:
            self._known = None
            return Budget()
        known = self._known
        if known is not None and (known.file, known.size) == (found.st_ino, found.st_size):
            return known.budget
        budget, data = Budget(), read(self._uses, LARGEST)
        try:
            for line in data.splitlines():
                changes: list[list[Any]] = msgspec.json.decode(line, type=list[list[Any]])
                if changes and isinstance(changes[0][0], str):
                    budget.replay(changes)
                else:
                    budget.uses = msgspec.convert(changes, list[Use])
        except (msgspec.MsgspecError, ValueError, TypeError, KeyError, IndexError) as error:
            reason = f"what {self.assistant} has used cannot be read: {error} ({self._uses})"
            raise OSError(reason) from None
        # without an end of line it is of an earlier version, or was cut off: then all of it is written anew
        self._known = _Known(found.st_ino, found.st_size, budget) if data.endswith(b"\n") else None
        return budget

    @contextlib.contextmanager
    def _locked(self) -> Generator[None]:
        if not self._made:
            private_folder(self.folder.parent)
            private_folder(self.folder)
            self._made = True
        with alone(self.folder / ".lock"):
            yield


class _Known(NamedTuple):
    """A budget, and the file that says the same."""

    file: int
    """Its number."""
    size: int
    """[B]"""
    budget: Budget


def _entries(lines: Iterable[bytes]) -> Generator[Entry]:
    for line in lines:
        with contextlib.suppress(msgspec.MsgspecError):
            yield msgspec.json.decode(line, type=Entry)
