"""The table of one lookup service: listings, and the leases that they depend on.

Everything in it is soft state. Each process has one lease, and its listings stay as long as it renews that
lease; whether an agent lives, presence says. Listings carry revisions, which only their process makes, and a
withdrawal is a revision too: so a request that was delayed on its way never brings a withdrawn listing back,
and several tables that learn the same things in different orders end up equal.

Pure: `now` is any monotonic clock [s] of the caller.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, Template
from robotree.vr.base.requests import Listed, Register, Registered, Unlisted

SHORTEST_TERM = 1.0
LONGEST_TERM = 60.0
"""[s] A lease is granted for what was asked for, within these bounds."""

REMEMBERED = 2 * LONGEST_TERM
"""[s] for which a withdrawal is remembered: nothing that was sent before it is under way any more."""

MOST_REMEMBERED = 4096
"""Withdrawals that are remembered; of more, the oldest are forgotten before their time. Nearly all are of
agents that never come back."""

LOST = 0
"""Revision in the news of a listing that ran out: that is only what this table knows. A withdrawal is news
with its own revision, and holds for all tables."""

Update = Listed | Unlisted
"""The publication of one change by a lookup service."""


class _Entry(msgspec.Struct):
    listing: Listing
    holder: str
    """Of the lease on which it depends."""


class _Lease(msgspec.Struct):
    expires: float
    addresses: set[Address]
    """The addresses that depend on it; a lease on which none depends is forgotten."""


class _Withdrawal(msgspec.Struct):
    revision: int
    forgotten: float


class LookupTable:
    """The agents that can be found. Each change returns the news of it, for listeners."""

    def __init__(self) -> None:
        """Begin empty."""
        self._entries: dict[Address, _Entry] = {}
        self._names: dict[str, set[Address]] = {}
        self._leases: dict[str, _Lease] = {}
        self._withdrawals: dict[Address, _Withdrawal] = {}
        """The oldest first."""

    def register(self, request: Register, now: float) -> tuple[Registered, list[Update]]:
        """Enter, change and take out listings, and renew the lease of all that its holder has listed.

        Args:
            request: of the process.
            now: [s].

        Returns:
            The answer, and the news.
        """
        holder, term = request.holder, request.term
        if not term > 0:  # NaN is not either
            term = SHORTEST_TERM
        term = min(max(term, SHORTEST_TERM), LONGEST_TERM)
        lease = self._leases.get(holder)
        news: list[Update] = []
        if lease is not None and lease.expires <= now:
            news += self._end(holder)
        elif lease is not None:
            lease.expires = now + term
        for address, revision in request.withdrawn:
            news += self.withdraw(address, revision, now)
        outdated: list[tuple[Address, int]] = []
        for listing in request.listings:
            if latest := self._later(listing):
                outdated.append((listing.address, latest))
            else:
                news += self._enter(listing, holder, now + term)
        lease = self._leases.get(holder)
        count = 0 if lease is None else len(lease.addresses)
        return Registered(term=term, count=count, outdated=tuple(outdated)), news

    def fill(self, listing: Listing, remaining: float, now: float) -> list[Update]:
        """Take over a listing from another table, until its process registers it here itself.

        Args:
            listing: as the other has it.
            remaining: [s] of its lease there.
            now: [s].
        """
        address = listing.address
        if not 0 < remaining <= LONGEST_TERM or self._later(listing):
            return []
        entry = self._entries.get(address)
        if entry is not None and entry.listing.revision == listing.revision:
            if entry.holder == address.key:
                lease = self._leases[address.key]
                lease.expires = max(lease.expires, now + remaining)
            return []
        holder = address.key if entry is None else entry.holder
        return self._enter(listing, holder, now + remaining)

    def withdraw(self, address: Address, revision: int, now: float) -> list[Update]:
        """Take a listing out, as its agent asks; everything up to this revision is over."""
        known = self._withdrawals.get(address)
        entry = self._entries.get(address)
        if (known is not None and known.revision >= revision) or (
            entry is not None and entry.listing.revision > revision
        ):
            return []
        self._remove(address)
        self._withdrawals.pop(address, None)
        self._withdrawals[address] = _Withdrawal(revision, now + REMEMBERED)
        if len(self._withdrawals) > MOST_REMEMBERED:
            del self._withdrawals[next(iter(self._withdrawals))]
        return [Unlisted(address=address, revision=revision)]

    def expire(self, now: float) -> list[Update]:
        """Drop what is over."""
        over = [holder for holder, lease in self._leases.items() if lease.expires <= now]
        for address in [a for a, known in self._withdrawals.items() if known.forgotten <= now]:
            del self._withdrawals[address]
        return [news for holder in over for news in self._end(holder)]

    def next_expiry(self) -> float | None:
        """Return when `expire` will have something to do [s], or None."""
        ends: Iterable[float] = (
            *(lease.expires for lease in self._leases.values()),
            *(known.forgotten for known in self._withdrawals.values()),
        )
        return min(ends, default=None)

    def find(self, template: Template, now: float) -> tuple[tuple[Listing, float], ...]:
        """Return the listings that match, by name, with what remains of their leases [s]."""
        addresses = self._names.get(template.name, set()) if template.name else self._entries.keys()
        found = [
            (entry.listing, left)
            for entry in map(self._entries.__getitem__, addresses)
            if (left := self._leases[entry.holder].expires - now) > 0
            if template.matches(entry.listing)
        ]
        return tuple(sorted(found, key=lambda pair: pair[0].address))

    # -- inside -----------------------------------------------------------------------------------

    def _later(self, listing: Listing) -> int:
        """Return the revision that is known and makes a listing old; 0: none does."""
        known = self._withdrawals.get(listing.address)
        entry = self._entries.get(listing.address)
        if known is not None and known.revision >= listing.revision:
            return known.revision
        return entry.listing.revision if entry and entry.listing.revision > listing.revision else 0

    def _enter(self, listing: Listing, holder: str, expires: float) -> list[Update]:
        """Enter a listing under a lease, which begins with it if need be."""
        address = listing.address
        before = self._entries.get(address)
        known = before is not None and before.listing == listing
        if before is None or before.holder != holder:
            self._remove(address)
            self._leases.setdefault(holder, _Lease(expires, set())).addresses.add(address)
        self._entries[address] = _Entry(listing, holder)
        self._names.setdefault(address.name, set()).add(address)
        return [] if known else [Listed(listing=listing)]

    def _end(self, holder: str) -> list[Update]:
        """End a lease, and all that depends on it."""
        over = sorted(self._leases[holder].addresses)
        for address in over:
            self._remove(address)
        return [Unlisted(address=address, revision=LOST) for address in over]

    def _remove(self, address: Address) -> None:
        entry = self._entries.pop(address, None)
        if entry is None:
            return
        lease, named = self._leases[entry.holder], self._names[address.name]
        lease.addresses.discard(address)
        named.discard(address)
        if not lease.addresses:
            del self._leases[entry.holder]
        if not named:
            del self._names[address.name]
