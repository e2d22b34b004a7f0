"""The table of one lookup service: leased listings, and who of them is alive.

Everything in it is soft state. A listing stays as long as its agent renews it, and is shown as long as its
agent is seen alive. Listings carry revisions, which only their agent makes, and a withdrawal is a revision
too: so a renewal that was delayed on its way never brings a withdrawn listing back, and several tables that
learn the same things in different orders end up equal.

Pure: `now` is any monotonic clock [s] of the caller.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from robotree.vr.address import Address
from robotree.vr.description import Listing, Template
from robotree.vr.requests import Listed, Unlisted

SHORTEST_TERM = 1.0
LONGEST_TERM = 60.0
"""[s] A lease is granted for what was asked for, within these bounds."""

REMEMBERED = 2 * LONGEST_TERM
"""[s] for which a withdrawal is remembered: nothing that was sent before it is under way any more."""

LOST = 0
"""Revision in the news of a listing that ran out or whose agent is out of sight: that is only what this table
knows. A withdrawal is news with its own revision, and holds for all tables."""

News = Listed | Unlisted


class _Entry(msgspec.Struct):
    listing: Listing
    expires: float
    alive: bool = True


class _Withdrawal(msgspec.Struct):
    revision: int
    forgotten: float


class LookupTable:
    """Who can be found. Each change returns the news of it, for those who listen."""

    def __init__(self) -> None:
        """Begin empty."""
        self._entries: dict[Address, _Entry] = {}
        self._withdrawals: dict[Address, _Withdrawal] = {}

    def register(self, listing: Listing, term: float, now: float) -> tuple[float, list[News]]:
        """Enter, change or renew a listing, as its agent asks.

        Args:
            listing: as the agent wants it to be.
            term: [s] asked for.
            now: [s].

        Returns:
            The term granted [s], 0 when the listing is older than what is known; and the news.
        """
        if not term > 0:  # NaN is not either
            term = SHORTEST_TERM
        term = min(max(term, SHORTEST_TERM), LONGEST_TERM)
        if self._is_old(listing):
            return 0.0, []
        return term, self._enter(listing, now + term, alive=True, now=now)

    def fill(self, listing: Listing, remaining: float, now: float, *, alive: bool) -> list[News]:
        """Take over a listing from another table.

        Args:
            listing: as the other has it.
            remaining: [s] of its lease there.
            now: [s].
            alive: whether its agent is seen here.
        """
        if not 0 < remaining <= LONGEST_TERM or self._is_old(listing):
            return []
        entry = self._entries.get(listing.address)
        if entry is not None and entry.listing.revision == listing.revision:
            entry.expires = max(entry.expires, now + remaining)
            return []
        return self._enter(listing, now + remaining, alive=alive, now=now)

    def withdraw(self, address: Address, revision: int, now: float) -> list[News]:
        """Take a listing out, as its agent asks; everything up to this revision is over."""
        known = self._withdrawals.get(address)
        entry = self._entries.get(address)
        if (known is not None and known.revision >= revision) or (
            entry is not None and entry.listing.revision > revision
        ):
            return []
        self._entries.pop(address, None)
        self._withdrawals[address] = _Withdrawal(revision, now + REMEMBERED)
        return [Unlisted(address=address, revision=revision)]

    def see(self, address: Address, alive: bool, now: float) -> list[News]:  # noqa: FBT001 # it is a fact
        """Take notice that an agent has come to life or died. A dead one's lease runs on, unseen."""
        entry = self._entries.get(address)
        if entry is None or entry.alive == alive or entry.expires <= now:
            return []
        entry.alive = alive
        if alive:
            return [Listed(listing=entry.listing)]
        return [Unlisted(address=address, revision=LOST)]

    def expire(self, now: float) -> list[News]:
        """Drop what is over."""
        over = [entry for entry in self._entries.values() if entry.expires <= now]
        for entry in over:
            del self._entries[entry.listing.address]
        for address in [a for a, known in self._withdrawals.items() if known.forgotten <= now]:
            del self._withdrawals[address]
        return [Unlisted(address=entry.listing.address, revision=LOST) for entry in over if entry.alive]

    def next_expiry(self) -> float | None:
        """Return when `expire` will have something to do [s], or None."""
        ends: Iterable[float] = (
            *(entry.expires for entry in self._entries.values()),
            *(known.forgotten for known in self._withdrawals.values()),
        )
        return min(ends, default=None)

    def find(self, template: Template, now: float) -> tuple[tuple[Listing, float], ...]:
        """Return the listings that match, by name, with what remains of their leases [s]."""
        found = [
            (entry.listing, entry.expires - now)
            for entry in self._entries.values()
            if entry.alive and entry.expires > now and template.matches(entry.listing)
        ]
        return tuple(sorted(found, key=lambda pair: pair[0].address))

    def _is_old(self, listing: Listing) -> bool:
        known = self._withdrawals.get(listing.address)
        entry = self._entries.get(listing.address)
        return (known is not None and known.revision >= listing.revision) or (
            entry is not None and entry.listing.revision > listing.revision
        )

    def _enter(self, listing: Listing, expires: float, *, alive: bool, now: float) -> list[News]:
        before = self._entries.get(listing.address)
        shown = before is not None and before.alive and before.expires > now and before.listing == listing
        self._entries[listing.address] = _Entry(listing, expires, alive)
        return [Listed(listing=listing)] if alive and not shown else []
