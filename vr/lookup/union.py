"""One list made from the lists of several lookup services: pure.

Each service has its view. A listing counts once, in its latest revision, unless its agent has withdrawn it,
and if the agent is present.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing
from robotree.vr.base.requests import Listed, Unlisted
from robotree.vr.lookup.table import LOST

MOST_ABSENT = 1024
"""Withdrawals that are remembered of agents that are not present: such an agent may appear (again)
before every service has the withdrawal."""


class Change(msgspec.Struct, frozen=True):
    """One change of the list, of the services behind it, or of who is present without being listed."""

    kind: Literal["arrived", "changed", "departed", "services", "presence"]
    listing: Listing | None = None


class Union:
    """The lists of the services, put together. Each method returns what it changed."""

    def __init__(self, alive: Callable[[Address], bool]) -> None:
        """Begin with no service; `alive` returns whether an agent is present now."""
        self.listings: dict[Address, Listing] = {}
        """The combined list."""
        self._alive = alive
        self._views: dict[str, dict[Address, Listing]] = {}
        self._memory: dict[Address, Listing] = {}
        self._withdrawn: dict[Address, int] = {}
        self._absent: dict[Address, None] = {}
        """Agents of these that are not present, the latest last."""

    @property
    def services(self) -> tuple[str, ...]:
        """The services that are counted, by key."""
        return tuple(sorted(self._views))

    def add_service(self, service: str) -> None:
        """Count a service from now on. It has sent no list yet."""
        self._views.setdefault(service, {})

    def lose_service(self, service: str) -> list[Change]:
        """Count it no longer, but keep its entries: its agents are not gone."""
        view = self._views.pop(service, {})
        for address, listing in view.items():
            known = self._memory.get(address)
            if known is None or known.revision < listing.revision:
                self._memory[address] = listing
        return self._look(view)

    def forget_lost(self) -> list[Change]:
        """Forget the entries of lost services: the others have the current ones."""
        memory, self._memory = self._memory, {}
        return self._look(memory)

    def replace(
        self, service: str, listings: Iterable[Listing], heard: Iterable[Listed | Unlisted] = ()
    ) -> list[Change]:
        """Take the whole list of a service, and then the news that came while it was sent."""
        if service not in self._views:
            return []
        touched = set(self._views[service])
        self._views[service] = {listing.address: listing for listing in listings}
        touched.update(self._views[service])
        touched.update(self._apply(service, news) for news in heard)
        return self._look(sorted(touched))

    def take_news(self, service: str, news: Listed | Unlisted) -> list[Change]:
        """Take a service's news; also of one that is not counted yet, if an agent withdrew."""
        return self._look((self._apply(service, news),))

    def see(self, address: Address) -> list[Change]:
        """Note that an agent has appeared or ended."""
        if not self._alive(address):
            self._memory.pop(address, None)
        self._bound_withdrawn(address)
        return self._look((address,))

    def _apply(self, service: str, news: Listed | Unlisted) -> Address:
        view = self._views.get(service, {})
        if isinstance(news, Listed):
            view[news.listing.address] = news.listing
            return news.listing.address
        view.pop(news.address, None)
        self._memory.pop(news.address, None)
        if news.revision != LOST:
            self._withdrawn[news.address] = max(news.revision, self._withdrawn.get(news.address, 0))
            self._bound_withdrawn(news.address)
        return news.address

    def _bound_withdrawn(self, address: Address) -> None:
        """Forget the oldest withdrawals, if one is too many now: most who are not alive never come back."""
        self._absent.pop(address, None)
        if address in self._withdrawn and not self._alive(address):
            self._absent[address] = None
        if len(self._absent) > MOST_ABSENT:
            oldest = next(iter(self._absent))
            del self._absent[oldest], self._withdrawn[oldest]

    def _look(self, addresses: Iterable[Address]) -> list[Change]:
        """Compare what is to be seen of some agents with what was."""
        changes: list[Change] = []
        for address in addresses:
            before, now = self.listings.get(address), self._best(address)
            if now is None:
                if before is not None:
                    del self.listings[address]
                    changes.append(Change("departed", before))
            elif now != before:
                self.listings[address] = now
                changes.append(Change("arrived" if before is None else "changed", now))
        return changes

    def _best(self, address: Address) -> Listing | None:
        if not self._alive(address):
            return None
        said = [view[address] for view in (self._memory, *self._views.values()) if address in view]
        latest = max(said, key=lambda listing: listing.revision, default=None)
        if latest is None or latest.revision <= self._withdrawn.get(address, 0):
            return None
        return latest
