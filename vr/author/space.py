"""The space of the realm, as the code of a page sees it: `self.space`.

    @dataclass(frozen=True)
    class Delivery:
        place: str
        weight: float = 0.0

    self.space.write(Delivery("hall"), lease="1 h")
    delivery = self.space.take(Delivery, place="hall", within="5 s")     # None: none came in that time

    with self.space.transaction(within="30 s") as tx:                    # all or nothing
        delivery = tx.take(Delivery)
        tx.write(Done(delivery.place))

All calls wait, and end early as `sleep` does when the command is to end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from types import TracebackType
from typing import Any, Self, TypeVar, cast, overload

from robotree.vr.author.context import running
from robotree.vr.base.entry import entry_of, revived, template_of
from robotree.vr.base.errors import EntryUnfit, Garbled
from robotree.vr.base.requests import (
    FOR_EVER,
    AcquireFence,
    AnyRequest,
    CloseTransaction,
    Done,
    EntriesCame,
    EntriesFound,
    EntryLeased,
    FenceGranted,
    FindEntries,
    GiveUp,
    OpenTransaction,
    RenewEntry,
    RenewFence,
    Reply,
    RollBack,
    TransactionOpened,
    WatchEntries,
    WriteEntry,
)
from robotree.vr.base.units import seconds

MOST = 1000
"""Entries that one call returns at most."""
_T = TypeVar("_T")
_R = TypeVar("_R", bound=Reply)


class EntryLease:
    """The lease of an entry: it is in the space until its time is over, or somebody has taken it."""

    def __init__(self, space: str, id_: int, term: float) -> None:
        """Made by `Space.write`."""
        self._space, self.id, self.term = space, id_, term
        """Number of the entry, and the time that was granted [s]; infinite: until it is taken."""

    def __repr__(self) -> str:
        return f"<entry {self.id}, leased for {self.term:g} s>"

    def renew(self, lease: float | str) -> None:
        """Have it end later.

        Args:
            lease: [s] from now on, or text with a unit.

        Raises:
            NoSuchEntry: it is there no longer.
        """
        self.term = _ask(self._space, RenewEntry(id=self.id, term=_seconds(lease)), EntryLeased).term

    def cancel(self) -> None:
        """Take the entry out.

        Raises:
            NoSuchEntry: it is there no longer.
        """
        _ask(self._space, RenewEntry(id=self.id, term=0.0), EntryLeased)


class Fence:
    """A name that one at a time holds; its epoch is higher than all before. It is let go with its block.

    with self.space.acquire("door", ttl="10 s") as fence:
        self.door.open(epoch=fence.epoch)
    """

    def __init__(self, space: str, name: str, ttl: float, granted: FenceGranted) -> None:
        """Made by `Space.acquire`."""
        self._space, self.name, self._ttl = space, name, ttl
        self.epoch: int = granted.epoch
        """Hand it on with each effect: who has seen a higher one refuses a lower one."""
        self.term: float = granted.term
        """[s] that were granted."""

    def __repr__(self) -> str:
        return f"<fence {self.name}, epoch {self.epoch}>"

    def renew(self, ttl: float | str | None = None) -> None:
        """Hold it for longer.

        Args:
            ttl: [s] from now on, or text with a unit; None: as long as when it was acquired.

        Raises:
            FenceLost: its time was over.
        """
        term = self._ttl if ttl is None else _seconds(ttl)
        self.term = _ask(
            self._space, RenewFence(name=self.name, epoch=self.epoch, term=term), FenceGranted
        ).term

    def release(self) -> None:
        """Let it go, without waiting. Twice is once."""
        running().send_to_space(self._space, RenewFence(name=self.name, epoch=self.epoch, term=0.0))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


class SpaceEntries:
    """Writes, reads and takes entries: of the space, or of a transaction."""

    def __init__(self, name: str = "", transaction: str = "") -> None:
        """Made by access to `self.space`."""
        self._name, self._transaction = name, transaction

    def write(self, entry: object, *, lease: float | str | None = None, key: str = "") -> EntryLease:
        """Put an entry into the space.

        Args:
            entry: of a dataclass or a `msgspec.Struct`.
            lease: [s] after which it is taken out, or text with a unit; None: it stays until it is taken.
            key: that no other entry may have; empty: it has none.

        Raises:
            BadEntry: it is no entry.
            KeyTaken: there is an entry with this key.
            SpaceFull: there is no room.
            NoSpace: no space runs.
            SpaceLost: it has ended before it answered.
        """
        term = FOR_EVER if lease is None else _seconds(lease)
        request = WriteEntry(entry=entry_of(entry), term=term, key=key, transaction=self._transaction)
        leased = _ask(self._name, request, EntryLeased)
        return EntryLease(self._name, leased.id, leased.term)

    @overload
    def read(self, wanted: type[_T], /, *, within: float | str | None = 0, **fields: Any) -> _T | None: ...
    @overload
    def read(self, wanted: _T, /, *, within: float | str | None = 0, **fields: Any) -> _T | None: ...
    def read(self, wanted: Any, /, *, within: float | str | None = 0, **fields: Any) -> Any:
        """Return the oldest entry that matches, and leave it there; None: there is none.

        Args:
            wanted: a class: entries of it and of its subclasses match. Or an entry: its fields that are not
                None must be equal, also those that have a default.
            within: [s] to wait for one, or text with a unit; None: until the deadline of the command.
            **fields: values that must be equal.

        Raises:
            EntryUnfit: an entry does not fit into the class.
            SpaceError: see `write`.
        """
        return next(iter(self._find(wanted, fields, take=False, most=1, within=within)), None)

    @overload
    def take(self, wanted: type[_T], /, *, within: float | str | None = 0, **fields: Any) -> _T | None: ...
    @overload
    def take(self, wanted: _T, /, *, within: float | str | None = 0, **fields: Any) -> _T | None: ...
    def take(self, wanted: Any, /, *, within: float | str | None = 0, **fields: Any) -> Any:
        """As `read`, but take the entry out: of all that ask for it only one gets it."""
        return next(iter(self._find(wanted, fields, take=True, most=1, within=within)), None)

    def read_all(self, wanted: type[_T], /, *, most: int = MOST, **fields: Any) -> list[_T]:
        """Return the entries that match, the oldest first, `most` at most."""
        return self._find(wanted, fields, take=False, most=most, within=0)

    def take_all(self, wanted: type[_T], /, *, most: int = MOST, **fields: Any) -> list[_T]:
        """As `read_all`, but take them out."""
        return self._find(wanted, fields, take=True, most=most, within=0)

    def _find(
        self, wanted: Any, fields: dict[str, Any], *, take: bool, most: int, within: float | str | None
    ) -> list[Any]:
        kind, given = template_of(wanted, fields)
        request = FindEntries(
            kind=kind,
            fields=given,
            take=take,
            most=most,
            within=_limit(within),
            transaction=self._transaction,
        )
        found = _ask(self._name, request, EntriesFound)
        cls = cast("type[Any]", wanted if isinstance(wanted, type) else type(wanted))
        try:
            return [revived(entry, cls) for _, entry in found.entries]
        except EntryUnfit:
            running().send_to_space(self._name, GiveUp(ask=found.ask))
            raise


class Space(SpaceEntries):
    """See the module."""

    def __getitem__(self, name: str) -> Space:
        """Return the space of a name, where several run."""
        return Space(name)

    def transaction(self, within: float | str = 30.0) -> SpaceTransaction:
        """Do several things as one: all of them when the block ends, none if it raises or lasts too long.

        What it takes nobody else sees meanwhile; it is back if the block raises, its time is over, or this
        robot dies. What it writes others see when it has ended.

        Args:
            within: [s] that the block may take, or text with a unit; at most an hour.

        Raises:
            TransactionOver: at the end of the block: its time was over before; nothing of it was done.
        """
        return SpaceTransaction(self._name, _seconds(within))

    def acquire(self, name: str, ttl: float | str, within: float | str | None = 0) -> Fence:
        """Be the only one who holds a name.

        Args:
            name: of whatever one at a time may use.
            ttl: [s] after which it is free again unless it is renewed, or text with a unit.
            within: [s] to wait until it is free; None: until the deadline of the command.

        Raises:
            FenceHeld: somebody else holds it.
        """
        term = _seconds(ttl)
        request = AcquireFence(name=name, term=term, within=_limit(within))
        return Fence(self._name, name, term, _ask(self._name, request, FenceGranted))

    def notify(
        self, wanted: type[object], /, *, within: float | str | None = None, **fields: Any
    ) -> Iterator[None]:
        """Come round whenever an entry that matches may have come; from the call of this on.

            for _ in self.space.notify(Delivery, place="hall"):
                while delivery := self.space.take(Delivery, place="hall"): ...

        It is a hint: several entries may give one, and another one may have been faster.

        Args:
            wanted: a class of entries.
            within: [s] after which it ends; None: with the command.
            **fields: values that must be equal.
        """
        kind, given = template_of(wanted, fields)
        number = _ask(self._name, WatchEntries(kind=kind, fields=given), EntriesCame).number
        return self._hints(kind, given, number, running().now() + _limit(within))

    def _hints(self, kind: str, given: dict[str, Any], number: int, end: float) -> Iterator[None]:
        while (left := end - running().now()) > 0:
            request = WatchEntries(kind=kind, fields=given, since=number, within=left)
            came = _ask(self._name, request, EntriesCame)
            number = came.number
            if came.came:
                yield


class SpaceTransaction:
    """See `Space.transaction`."""

    def __init__(self, space: str, within: float) -> None:
        """Made by `Space.transaction`; it begins with its block."""
        self._space, self._within = space, within
        self._transaction = ""

    def __enter__(self) -> SpaceEntries:
        opened = _ask(self._space, OpenTransaction(term=self._within), TransactionOpened)
        self._transaction = opened.transaction
        return SpaceEntries(self._space, opened.transaction)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        transaction, done = self._transaction, False
        try:
            if kind is None:
                _ask(self._space, CloseTransaction(transaction=transaction), Done)
                done = True
        finally:
            if not done:
                running().send_to_space(self._space, RollBack(transaction=transaction))


def _ask(space: str, request: AnyRequest, answer: type[_R]) -> _R:
    reply = running().ask_space(space, request)
    if not isinstance(reply, answer):
        detail = f"{type(reply).__name__} is no answer to {type(request).__name__}"
        raise Garbled(key=space or "the space", detail=detail)
    return reply


def _limit(within: float | str | None) -> float:
    return math.inf if within is None else 0.0 if within == 0 else _seconds(within)


def _seconds(given: float | str) -> float:
    """Return a time [s].

    Raises:
        ValueError: it is not positive.
    """
    found = seconds(given)
    if not found > 0:
        raise ValueError(f"{given!r} is no time to wait or to hold something; write more than 0 s")
    return found
