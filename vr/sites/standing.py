"""The keys of other sites' agents, under which the gateway is present for the processes of its machine.

What a site says of itself is its *claim*. Two sites may claim one key for a while, when a robot has moved:
the news of its new site may come before the old one's. The highest rank counts, the number of its moves, then
the newest claim, and when it goes the other one does again. A key that a process of this machine holds is not
announced, unless a claim has a higher rank: the robot has left that process, which goes on as long as
somebody may ask it, so nobody sees it absent.

Where each agent is, and which site is not heard, is announced beside it (`vr/base/places.py`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable

from robotree.vr.base.address import Address
from robotree.vr.base.errors import TooManyKeys
from robotree.vr.base.places import CALLER, OWN, place_key, silent_key, site_key
from robotree.vr.network.mesh import TakeFrame
from robotree.vr.sites.ground import Ground
from robotree.vr.sites.site import Site

_log = logging.getLogger(__name__)


class Standing:
    """See the module. On the event loop."""

    def __init__(self, ground: Ground, take: Callable[[str], TakeFrame]) -> None:
        """Begin with nothing.

        Args:
            ground: the network of this machine.
            take: returns what takes the requests to a key.
        """
        self._ground, self._take = ground, take
        self.local = set[str]()
        """Keys that processes of this machine hold."""
        self.where: dict[str, Site] = {}
        """The site of each key that is announced here."""
        self._claims: dict[str, dict[Site, int]] = {}
        """The sites that claim a key and the rank that each says, the newest last."""
        self._ranks: dict[str, int] = {}
        """By which keys are served here in the name of a site, unless it is 0."""
        self._said = set[str]()
        """Keys about sites that are announced."""

    def claim(self, site: Site, key: str, rank: int = 0) -> bool:
        """A site says that it has an agent, moved so often; returns whether that can be."""
        if key.startswith(OWN):
            return False
        site.keys.add(key)
        claims = self._claims.setdefault(key, {})
        claims.pop(site, None)
        claims[site] = rank
        self._settle(key)
        return True

    def drop(self, site: Site, key: str) -> None:
        """A site says that it has it no longer."""
        if key not in site.keys:
            return
        site.keys.discard(key)
        claims = self._claims[key]
        del claims[site]
        if not claims:
            del self._claims[key]
        self._settle(key)

    def look(self, key: str) -> bool | None:
        """Look whether a process of this machine holds a key; returns whether it does, None: as before."""
        there = bool(self._ground.held_elsewhere((key,)))
        if there == (key in self.local):
            return None
        (self.local.add if there else self.local.discard)(key)
        self._settle(key)
        return there

    def come_here(self) -> list[str]:
        """Return the keys of other sites that a process of this machine holds since the last look."""
        held = self._ground.held_elsewhere(self.where.keys())
        return [key for key in sorted(held - self.local) if self.look(key)]

    def tell_of(self, site: str, *, silent: bool) -> None:
        """Let the machine know that a site belongs to the realm, and whether it is heard."""
        self._say(site_key(site), there=True)
        self._say(silent_key(site), there=silent)

    def forget(self, site: str) -> None:
        """A site belongs to the realm no longer."""
        self._say(site_key(site), there=False)
        self._say(silent_key(site), there=False)

    # -- inside -----------------------------------------------------------------------------------

    def _say(self, key: str, *, there: bool) -> None:
        if there == (key in self._said):
            return
        (self._said.add if there else self._said.discard)(key)
        (self._ground.announce if there else self._ground.withdraw)(key)

    def _counts(self, key: str) -> Site | None:
        """Return the site whose claim to a key counts; None: none does."""
        claims = self._claims.get(key)
        if claims is None:
            return None
        highest = max(claims.values())
        if key in self.local and self._ground.rank_elsewhere(key) >= highest:
            return None
        return [site for site, rank in claims.items() if rank == highest][-1]

    def _settle(self, key: str) -> None:
        """Announce a key for the site whose claim counts, or no more."""
        site, before = self._counts(key), self.where.get(key)
        if before is None:
            if site is not None:
                self._begin(site, key)
        elif site is None:
            del self.where[key]
            self._ground.withdraw(key)
            self._end_serving(key)
            self._place(before, key, there=False)
        elif site is not before or self._rank(site, key) != self._ranks.get(key, 0):
            self.where[key] = site
            if self._rank(site, key) != self._ranks.get(key, 0):
                self._end_serving(key)
                self._serve(site, key)
            if site is not before:
                self._place(site, key, there=True)
                self._place(before, key, there=False)

    def _rank(self, site: Site, key: str) -> int:
        return self._claims.get(key, {}).get(site, 0)

    def _serve(self, site: Site, key: str) -> None:
        rank = self._rank(site, key)
        self._ground.serve(key, self._take(key), rank=rank)
        if rank:
            self._ranks[key] = rank

    def _end_serving(self, key: str) -> None:
        self._ground.end_serving(key)
        self._ranks.pop(key, None)

    def _place(self, site: Site, key: str, *, there: bool) -> None:
        if Address.parse(key) is not None or key.startswith(CALLER):
            self._say(place_key(site.name, key), there=there)

    def _begin(self, site: Site, key: str) -> None:
        self.where[key] = site
        try:
            self._serve(site, key)
            self._place(site, key, there=True)  # before its agent, which nobody takes for a local one then
            self._ground.announce(key)
        except (TooManyKeys, ValueError) as error:
            del self.where[key]
            self._place(site, key, there=False)
            self._end_serving(key)
            _log.warning("%s", error)
