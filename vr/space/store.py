"""The interface of a store, where a space keeps its entries, for its service.

Nothing here waits for an entry: who waits, the service knows. `testing.py` examines any implementation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

from robotree.vr.base.entry import Entry
from robotree.vr.base.requests import KeptEntry, KeptFence
from robotree.vr.space.table import Row

Durability = str
"""How durable an answered request is: `memory`, `process` (kill -9 of any process) or `power` (its loss)."""

EntryNews = frozenset[str] | None
"""Marks of an entry that has become visible or free; None: it may be any."""


class FenceState(NamedTuple):
    """How a fence is after somebody has asked for it."""

    epoch: int
    holder: str
    left: float
    """[s]"""
    granted: bool
    """Whether the one who asked holds it."""


class Contents(NamedTuple):
    """The contents of a store, for people."""

    counts: dict[str, int]
    """Entries by kind."""
    transactions: int
    entries: tuple[KeptEntry, ...]
    fences: tuple[KeptFence, ...]


class SpaceStore(Protocol):
    """Used by one thread at a time. All times are [s] from now on; infinite: for ever."""

    name: str
    """Of the space, for messages."""
    where: str
    """For people, without passwords."""
    durability: Durability
    slow: bool
    """Whether an operation may wait for a disk or another machine."""
    rings: Callable[[], None]
    """Called, in any thread, when others have changed what is kept here."""

    def together(self) -> AbstractContextManager[None]:
        """Do several operations, all of which are kept when the block ends.

        Raises:
            SpaceError: at the end of the block: they could not be kept, and nothing of them was done.
        """
        ...

    def write(self, entry: Entry, term: float, key: str, transaction: str) -> tuple[int, float]:
        """Put an entry in; returns its number and the lease that is granted.

        Raises:
            KeyTaken: another one has the key.
            SpaceFull: there is no room.
            TransactionOver: the transaction has ended.
        """
        ...

    def find(
        self, kind: str, fields: Mapping[str, Any], transaction: str, *, take: bool, most: int
    ) -> Sequence[Row]:
        """Read or take the oldest entries of a kind with these fields.

        Raises:
            TransactionOver: the transaction has ended.
        """
        ...

    def put_back(self, rows: Sequence[Row]) -> None:
        """Have entries that were taken outside of a transaction be there again."""
        ...

    def renew(self, id_: int, term: float) -> float:
        """Have the lease of an entry end later, or now (0). Returns what is granted.

        Raises:
            NoSuchEntry: it is there no longer.
        """
        ...

    def open(self, term: float) -> str:
        """Begin a transaction; returns its name.

        Raises:
            SpaceFull: too many are open.
        """
        ...

    def commit(self, transaction: str) -> None:
        """Keep what a transaction has done.

        Raises:
            TransactionOver: it has ended; nothing of it was kept.
        """
        ...

    def roll_back(self, transaction: str) -> None:
        """Take back what a transaction has done, if it is open."""
        ...

    def acquire(self, name: str, holder: str, term: float) -> FenceState:
        """Hold a name if it is free, under a higher epoch than ever before."""
        ...

    def renew_fence(self, name: str, epoch: int, term: float) -> FenceState:
        """Hold a name for longer, or let it go (0).

        Raises:
            FenceLost: it is held no longer under this epoch.
        """
        ...

    def expire(self) -> float:
        """Take out what has ended. Returns after how long there may be more [s]."""
        ...

    def news(self) -> Sequence[EntryNews]:
        """Return what has become visible or free since this was asked last."""
        ...

    def contents(self, kind: str, most: int) -> Contents:
        """Return what is in it: of one kind, or of all."""
        ...

    def close(self) -> None:
        """Let go of what it uses. Twice is once."""
        ...
