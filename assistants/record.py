"""What assistants asked for and what became of it: `assistants/NAME.jsonl`, beside what the realm keeps.

Every request that could have moved something is a line, also one that was refused before it reached a robot.
What robots carried out is in their own histories as well, with the same key (`robotree why`).
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

import msgspec

from robotree.assistants.budget import Budget, Use, What
from robotree.assistants.marking import data_of
from robotree.files import opened_own, private_folder, read
from robotree.vr.base.foreign import bounded

FOLDER: Final = "assistants"
LARGEST: Final = 4 << 20
"""[B] of one record, which then becomes `.old`."""
LONGEST_LINE: Final = 8000
"""[B]"""
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
    what: Became
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

    def write(self, what: Became, **told: Any) -> None:
        """Append a line; texts and arguments are bounded. It is on its way to the disk when this returns.

        Raises:
            OSError: it cannot be written.
        """
        texts = {name: bounded(value, 1000) if isinstance(value, str) else data_of(value)
                 for name, value in told.items()}  # fmt: skip
        line = msgspec.json.encode(Entry(unix=self.unix(), what=what, **texts))
        if len(line) > LONGEST_LINE:
            line = msgspec.json.encode(
                Entry(unix=self.unix(), what=what, **{**texts, "arguments": "too large"})
            )
        lines = self._aside if what in ASIDE else self._lines
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

    def use(
        self,
        amounts: Mapping[What, float],
        check: Callable[[Budget, float], None] = lambda _budget, _now: None,
    ) -> None:
        """Note that something was used.

        Args:
            amounts: how much, by what.
            check: takes the budget and the time [s since 1970] before; what it raises leaves all as it was.

        Raises:
            OSError: it cannot be kept.
        """

        def change(budget: Budget, now: float) -> None:
            check(budget, now)
            for what, amount in amounts.items():
                budget.use(what, amount, now)

        self.change(change)

    def change(self, change: Callable[[Budget, float], _Found]) -> _Found:
        """Change the budget while nobody else looks at it; it is in the file when this returns.

        Args:
            change: takes the budget and the time [s since 1970]; what it raises leaves all as it was.

        Returns:
            What `change` returns.

        Raises:
            OSError: it cannot be kept.
        """
        with self._locked():
            budget = self._budget()
            found = change(budget, self.unix())
            new = self._uses.with_suffix(".new")
            with os.fdopen(opened_own(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb") as stream:
                stream.write(msgspec.json.encode(budget.uses))
            new.replace(self._uses)  # not synced: it outlives processes, and a loss of power gives calls back
        return found

    def _budget(self) -> Budget:
        try:
            return Budget(msgspec.json.decode(read(self._uses, LARGEST), type=list[Use]))
        except FileNotFoundError:
            return Budget()
        except msgspec.MsgspecError as error:
            raise OSError(f"what {self.assistant} has used cannot be read: {error}") from None

    @contextlib.contextmanager
    def _locked(self) -> Generator[None]:
        private_folder(self.folder.parent)
        private_folder(self.folder)
        lock = os.open(self.folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield
        finally:
            os.close(lock)


def _entries(lines: Iterable[bytes]) -> Generator[Entry]:
    for line in lines:
        with contextlib.suppress(msgspec.MsgspecError):
            yield msgspec.json.decode(line, type=Entry)
