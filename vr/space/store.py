"""The interface of a store, where a space keeps its entries, for its service, and the store in memory.

Nothing here waits for an entry: who waits, the service knows. `testing.py` examines any implementation.
"""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from robotree.vr.base.chance import token
from robotree.vr.base.entry import Entry, marks_of
from robotree.vr.base.requests import KeptEntry, KeptFence
from robotree.vr.space.table import MOST_ENTRIES, FenceRow, Row, SpaceTable

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

    def together(self) -> contextlib.AbstractContextManager[None]:
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


class MemoryStore:
    """A space in the memory of one process: all is gone with it, epochs of fences too."""

    where: str = "memory"
    durability: Durability = "memory"
    slow: bool = False

    def __init__(self, name: str, now: Callable[[], float], *, most: int = MOST_ENTRIES) -> None:
        """Begin empty.

        Args:
            name: of the space.
            now: returns the time [s] on a monotonic clock.
            most: entries that it takes.
        """
        self.name = name
        self.rings: Callable[[], None] = nothing
        self._now = now
        self._table = SpaceTable(name, most=most)

    @contextlib.contextmanager
    def together(self) -> Generator[None]:
        yield
        self._keep()

    def _keep(self) -> None:
        """Keep what has changed."""
        self._table.settle()

    # -- entries ----------------------------------------------------------------------------------

    def write(self, entry: Entry, term: float, key: str, transaction: str) -> tuple[int, float]:
        now = self._now()
        marks = marks_of(entry.kinds, entry.fields)
        return self._table.write(entry, marks, now + term, key, transaction, now).id, term

    def find(
        self, kind: str, fields: Mapping[str, Any], transaction: str, *, take: bool, most: int
    ) -> Sequence[Row]:
        marks = marks_of((kind,) if kind else (), fields)
        return self._table.find(marks, transaction, self._now(), take=take, most=most)

    def put_back(self, rows: Sequence[Row]) -> None:
        self._table.put_back(rows, self._now())

    def renew(self, id_: int, term: float) -> float:
        now = self._now()
        self._table.renew(id_, now + term, now)
        return term

    # -- transactions -----------------------------------------------------------------------------

    def open(self, term: float) -> str:
        transaction = token()
        self._table.open(transaction, self._now() + term)
        return transaction

    def commit(self, transaction: str) -> None:
        self._table.commit(transaction, self._now())

    def roll_back(self, transaction: str) -> None:
        self._table.roll_back(transaction)

    # -- fences -----------------------------------------------------------------------------------

    def acquire(self, name: str, holder: str, term: float) -> FenceState:
        now = self._now()
        before = self._table.fences.get(name, FenceRow()).epoch
        fence = self._table.acquire(name, holder, now + term, now)
        return FenceState(fence.epoch, fence.holder, fence.left(now), fence.epoch > before)

    def renew_fence(self, name: str, epoch: int, term: float) -> FenceState:
        now = self._now()
        fence = self._table.renew_fence(name, epoch, now + term, now)
        return FenceState(epoch, fence.holder, fence.left(now), granted=True)

    # -- time, news and people --------------------------------------------------------------------

    def expire(self) -> float:
        now = self._now()
        self._table.expire(now)
        return self._table.due - now

    def news(self) -> Sequence[EntryNews]:
        table = self._table
        if not table.news:
            return ()
        news, table.news = table.news, []
        return news

    def contents(self, kind: str, most: int) -> Contents:
        now = self._now()
        rows = [row for row in self._table.rows.values() if not row.written_by and row.expires > now]
        wanted = sorted((row for row in rows if not kind or kind in row.entry.kinds), key=lambda row: row.id)
        return Contents(
            counts=dict(Counter(row.entry.kind for row in rows)),
            transactions=len(self._table.transactions),
            entries=tuple(
                KeptEntry(row.id, row.entry, row.key, row.expires - now, bool(row.taken_by or row.readers))
                for row in wanted[:most]
            ),
            fences=tuple(
                KeptFence(name, fence.epoch, fence.holder if fence.left(now) else "", fence.left(now))
                for name, fence in sorted(self._table.fences.items())
            ),
        )

    def close(self) -> None:
        """See `SpaceStore.close`."""


def finite(term: float) -> float | None:
    """Return a lease [s] as a database keeps it; None: for ever."""
    return term if math.isfinite(term) else None


def nothing() -> None:
    """Nobody else changes what is kept here."""
