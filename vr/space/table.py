"""The entries of a space and the rules that change them, in one process. Pure: `now` is an argument.

An entry that a transaction has taken stays, held, until the transaction commits; one that it has written is
seen by it alone. So a transaction that is taken back, runs out, or was lost with its process has changed
nothing. Each change can be undone (`undo`) until it is kept (`settle`): a store undoes what it could not
write.
"""

from __future__ import annotations

import heapq
from collections import OrderedDict
from collections.abc import Iterable, MutableMapping
from typing import Any

import msgspec

from robotree.vr.base.entry import Entry
from robotree.vr.base.errors import FenceLost, KeyTaken, NoSuchEntry, SpaceFull, TransactionOver

MOST_ENTRIES = 200_000
"""Entries of one space; one takes 1 to 2 kB of memory."""
MOST_TRANSACTIONS = 10_000


_NOTHING = OrderedDict[int, None]()


class Row(msgspec.Struct, frozen=True):
    """An entry and what is known of it."""

    id: int
    """Entries are found in the order of these."""
    entry: Entry
    marks: frozenset[str]
    """See `entry.marks_of`."""
    key: str = ""
    expires: float = float("inf")
    """[s]"""
    taken_by: str = ""
    """The transaction that has taken it; empty: none has."""
    written_by: str = ""
    """The transaction that has written it and has not ended; empty: it is there for everybody."""
    readers: frozenset[str] = frozenset()
    """Transactions that have read it: nobody else takes it before they end."""

    @property
    def held(self) -> bool:
        """Whether a transaction decides about it."""
        return bool(self.taken_by or self.written_by or self.readers)


class FenceRow(msgspec.Struct, frozen=True):
    """A name that one at a time holds."""

    epoch: int = 0
    holder: str = ""
    """For people."""
    expires: float = 0.0
    """[s]"""

    def left(self, now: float) -> float:
        """Return for how long it is held [s]; 0: nobody holds it."""
        return max(0.0, self.expires - now) if self.holder else 0.0


class _Pending(msgspec.Struct):
    """A transaction that is open."""

    expires: float
    rows: dict[int, None] = {}
    """Entries that it has written, taken or read."""


class SpaceTable:
    """See the module. Not for several threads at a time."""

    def __init__(self, name: str, *, first: int = 1, most: int = MOST_ENTRIES) -> None:
        """Begin empty.

        Args:
            name: of the space, for messages.
            first: number of the first entry.
            most: entries that it takes.
        """
        self.name, self.next_id, self.most = name, first, most
        self.rows: dict[int, Row] = {}
        self.fences: dict[str, FenceRow] = {}
        self.transactions: dict[str, _Pending] = {}
        self.news: list[frozenset[str]] = []
        """Marks of the entries that have become visible, or free to be taken, since somebody looked."""
        self.changed: dict[int, Row | None] = {}
        """Entries that have changed since `settle`, as they were before it."""
        self.changed_fences: dict[str, FenceRow | None] = {}
        """The same of fences."""
        self._keys: dict[str, int] = {}
        """Which entry has a key; of one that was taken and the one that its taker wrote instead: that one."""
        self._marked: dict[str, OrderedDict[int, None]] = {}
        """Entries by their marks, in the order of their numbers."""
        self._ends: list[tuple[float, int, str]] = []
        """When leases of entries and transactions end, the earliest first; some are renewed meanwhile."""
        self._undo: list[tuple[MutableMapping[Any, Any], Any, Any]] = []

    # -- entries ----------------------------------------------------------------------------------

    def write(
        self, entry: Entry, marks: frozenset[str], expires: float, key: str, transaction: str, now: float
    ) -> Row:
        """Put an entry in.

        Raises:
            KeyTaken: another one has its key.
            SpaceFull: there are too many.
            TransactionOver: the transaction has ended.
        """
        pending = self._pending(transaction, now)
        if key:
            self._free_key(key, transaction, now)
        if len(self.rows) >= self.most:
            self.expire(now)
            if len(self.rows) >= self.most:
                raise SpaceFull(space=self.name, reason=f"it holds {self.most} entries, as many as it takes")
        row = Row(self.next_id, entry, marks, key, expires, "", transaction)
        self.next_id += 1
        self._put(row)
        if pending is not None:
            pending.rows[row.id] = None
        return row

    def load(self, row: Row) -> None:
        """Put in an entry that was kept elsewhere."""
        self._put(row)
        self.settle()
        self.news.clear()

    def find(
        self, marks: frozenset[str], transaction: str, now: float, *, take: bool, most: int
    ) -> list[Row]:
        """Read or take the oldest entries that have all of some marks.

        Raises:
            TransactionOver: the transaction has ended.
        """
        pending = self._pending(transaction, now)
        found: list[Row] = []
        for id_ in self._candidates(marks):
            row = self.rows[id_]
            if row.taken_by or row.written_by not in {"", transaction} or row.expires <= now:
                continue
            if take and not row.readers <= {transaction}:
                continue
            if marks <= row.marks:
                found.append(row)
                if len(found) >= most:
                    break
        for row in found:
            if pending is not None:
                pending.rows[row.id] = None
            if take:
                self._take(row, transaction)
            elif transaction and not row.written_by:
                self._put(msgspec.structs.replace(row, readers=row.readers | {transaction}))
        return found

    def put_back(self, rows: Iterable[Row], now: float) -> None:
        """Undo that entries were taken outside of a transaction; a key that another has by now is lost."""
        self.expire(now)
        for row in rows:
            key = "" if row.key in self._keys else row.key
            if row.expires > now and row.id not in self.rows:
                self._put(msgspec.structs.replace(row, key=key))

    def renew(self, id_: int, expires: float, now: float) -> None:
        """Have the lease of an entry end at another time [s].

        Raises:
            NoSuchEntry: it is there no longer.
        """
        row = self.rows.get(id_)
        if row is None or row.taken_by or row.expires <= now:
            raise NoSuchEntry(space=self.name, id=id_)
        if expires > now:
            self._put(msgspec.structs.replace(row, expires=expires))
        else:
            self._remove(row)

    # -- transactions -----------------------------------------------------------------------------

    def open(self, transaction: str, expires: float) -> None:
        """Begin a transaction, under a name that no other ever had.

        Raises:
            SpaceFull: too many are open.
        """
        if len(self.transactions) >= MOST_TRANSACTIONS:
            raise SpaceFull(space=self.name, reason=f"{MOST_TRANSACTIONS} transactions are open")
        self.transactions[transaction] = _Pending(expires)
        heapq.heappush(self._ends, (expires, 0, transaction))

    def commit(self, transaction: str, now: float) -> None:
        """Keep what was done in a transaction, and end it.

        Raises:
            TransactionOver: it has ended already, and nothing of it was kept.
        """
        self._pending(transaction, now)
        for row in self._leave(transaction):
            if row.taken_by:
                self._remove(row)
            else:
                self._put(msgspec.structs.replace(row, written_by="", readers=row.readers - {transaction}))

    def roll_back(self, transaction: str) -> None:
        """End a transaction so that it has done nothing. One that has ended stays as it is."""
        rows = self._leave(transaction)
        for row in rows:
            if row.written_by:
                self._remove(row)
        for row in rows:
            if not row.written_by:
                self._put(msgspec.structs.replace(row, taken_by="", readers=row.readers - {transaction}))

    # -- fences -----------------------------------------------------------------------------------

    def acquire(self, name: str, holder: str, expires: float, now: float) -> FenceRow:
        """Hold a name, if it is free. Returns how it is then: somebody else's if that one holds it."""
        fence = self.fences.get(name, FenceRow())
        return fence if fence.left(now) else self._set_fence(name, FenceRow(fence.epoch + 1, holder, expires))

    def renew_fence(self, name: str, epoch: int, expires: float, now: float) -> FenceRow:
        """Hold a name until another time [s]; a time that is over lets it go.

        Raises:
            FenceLost: it is held no longer under this epoch.
        """
        fence = self.fences.get(name, FenceRow())
        if fence.epoch != epoch or not fence.left(now):
            raise FenceLost(name=name, epoch=epoch, current=fence.epoch)
        if expires > now:
            return self._set_fence(name, FenceRow(epoch, fence.holder, expires))
        return self._set_fence(name, FenceRow(epoch))

    def _set_fence(self, name: str, fence: FenceRow) -> FenceRow:
        self.changed_fences.setdefault(name, self.fences.get(name))
        self._set(self.fences, name, fence)
        return fence

    # -- time -------------------------------------------------------------------------------------

    @property
    def due(self) -> float:
        """[s] When `expire` has something to do; infinite: never."""
        return self._ends[0][0] if self._ends else float("inf")

    def expire(self, now: float) -> None:
        """Take out what has ended: entries, and transactions, which are taken back."""
        while self._ends and self._ends[0][0] <= now:
            _, id_, transaction = heapq.heappop(self._ends)
            pending = self.transactions.get(transaction)
            if pending is not None and pending.expires <= now:
                self.roll_back(transaction)
            row = self.rows.get(id_)
            if row is not None and row.expires <= now and not row.taken_by:
                self._remove(row)

    # -- undoing ----------------------------------------------------------------------------------

    def settle(self) -> None:
        """Keep all changes so far: they cannot be undone any more."""
        self._undo.clear()
        self.changed.clear()
        self.changed_fences.clear()

    def undo(self) -> None:
        """Have everything as it was at the last `settle`; transactions that have ended since stay ended."""
        for mapping, key, before in reversed(self._undo):
            if mapping is self.rows:
                self._set_row(key, before)
            elif before is None:
                mapping.pop(key, None)
            else:
                mapping[key] = before
        self.settle()
        self.news.clear()
        for row in [row for row in self.rows.values() if row.held]:
            self._forget_ended(row)

    def _forget_ended(self, row: Row) -> None:
        """Free an entry of the transactions that have ended."""
        open_ = self.transactions
        if row.written_by and row.written_by not in open_:
            self._remove(row)
        elif (row.taken_by and row.taken_by not in open_) or not open_.keys() >= row.readers:
            taken_by = row.taken_by if row.taken_by in open_ else ""
            readers = frozenset(row.readers & open_.keys())
            self._put(msgspec.structs.replace(row, taken_by=taken_by, readers=readers))

    # -- inside -----------------------------------------------------------------------------------

    def _pending(self, transaction: str, now: float) -> _Pending | None:
        if not transaction:
            return None
        pending = self.transactions.get(transaction)
        if pending is None:
            reason = "its time was over, its program has gone, or it was ended before"
            raise TransactionOver(space=self.name, reason=reason)
        if pending.expires <= now:
            self.roll_back(transaction)
            raise TransactionOver(space=self.name, reason="its time is over")
        return pending

    def _leave(self, transaction: str) -> list[Row]:
        """Have a transaction be over; return the entries that it holds."""
        pending = self.transactions.pop(transaction, None)
        found = (self.rows.get(id_) for id_ in (() if pending is None else pending.rows))
        return [row for row in found if row is not None and row.held]

    def _free_key(self, key: str, transaction: str, now: float) -> None:
        """See that a new entry can have a key."""
        row = self.rows.get(self._keys.get(key, 0))
        if row is None or (transaction and row.taken_by == transaction):
            return
        if row.expires > now or row.taken_by:
            raise KeyTaken(space=self.name, key=key)
        self._remove(row)

    def _candidates(self, marks: frozenset[str]) -> Iterable[int]:
        """Return the shortest list in which all entries with these marks are."""
        shortest: OrderedDict[int, None] | dict[int, Row] = self.rows
        for mark in marks:
            listed = self._marked.get(mark, _NOTHING)
            if len(listed) <= len(shortest):
                shortest = listed
        return shortest

    def _take(self, row: Row, transaction: str) -> None:
        if transaction and not row.written_by:
            self._put(msgspec.structs.replace(row, taken_by=transaction, readers=frozenset()))
        else:
            self._remove(row)

    def _put(self, row: Row) -> None:
        """Have an entry be so."""
        before = self.rows.get(row.id)
        self.changed.setdefault(row.id, before)
        self._undo.append((self.rows, row.id, before))
        if row.key and (before is None or not row.taken_by):
            self._set(self._keys, row.key, row.id)
        if row.expires < float("inf") and (
            before is None or before.expires != row.expires or before.taken_by
        ):
            heapq.heappush(self._ends, (row.expires, row.id, ""))
        self._set_row(row.id, row)
        if not row.taken_by and not row.written_by:
            self.news.append(row.marks)

    def _remove(self, row: Row) -> None:
        """Have an entry be there no longer."""
        self.changed.setdefault(row.id, self.rows.get(row.id))
        self._undo.append((self.rows, row.id, self.rows.get(row.id)))
        self._set_row(row.id, None)
        if row.key and self._keys.get(row.key) == row.id:
            self._set(self._keys, row.key, None)
            if (pending := self.transactions.get(row.written_by)) is not None:
                self._give_key_back(row.key, pending)

    def _give_key_back(self, key: str, pending: _Pending) -> None:
        """Have the entry that a transaction has taken keep its key, as it may come back."""
        taken = (self.rows.get(id_) for id_ in pending.rows)
        for row in taken:
            if row is not None and row.key == key and row.taken_by:
                self._set(self._keys, key, row.id)

    def _set(self, mapping: MutableMapping[Any, Any], key: object, value: object) -> None:
        self._undo.append((mapping, key, mapping.get(key)))
        if value is None:
            mapping.pop(key, None)
        else:
            mapping[key] = value

    def _set_row(self, id_: int, row: Row | None) -> None:
        """Change an entry and the lists in which it is."""
        before = self.rows.pop(id_, None) if row is None else self.rows.get(id_)
        if row is not None:
            self.rows[id_] = row
        if before is not None and row is None:
            for mark in before.marks:
                listed = self._marked[mark]
                del listed[id_]
                if not listed:
                    del self._marked[mark]
        elif before is None and row is not None:
            for mark in row.marks:
                listed = self._marked.setdefault(mark, OrderedDict())
                late = bool(listed) and next(reversed(listed)) > id_
                listed[id_] = None
                if late:  # it comes back
                    self._marked[mark] = OrderedDict.fromkeys(sorted(listed))
