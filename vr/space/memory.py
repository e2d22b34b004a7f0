"""A space in the memory of one process: all is gone with it, epochs of fences too."""

from __future__ import annotations

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any

from robotree.vr.base.chance import token
from robotree.vr.base.entry import Entry, marks_of
from robotree.vr.base.requests import KeptEntry, KeptFence
from robotree.vr.space.store import Contents, Durability, EntryNews, FenceState
from robotree.vr.space.table import MOST_ENTRIES, FenceRow, Row, SpaceTable


class MemoryStore:
    """See the module, and `SpaceStore`."""

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
