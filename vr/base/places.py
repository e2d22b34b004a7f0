"""The sites of agents, as the gateway of a machine lets its processes know them: by keys that are present.

    site/NAME           a site of the realm, besides this one
    silent/NAME         it is not heard now
    at/NAME/KEY         the agent under KEY is there

Where no gateway runs, all agents are here, and a question costs one look into an empty group.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from robotree.vr.base.address import Address, Role, everyone
from robotree.vr.base.presence import Presence

SITE: Final = "site"
SILENT: Final = "silent"
AT: Final = "at"

CALLER: Final = "caller/"
"""Begin of the keys of programs that ask for a person."""

OWN: Final = ("site/", "silent/", "at/", "gateway/")
"""Begins of keys that a gateway uses itself: they never leave its machine."""


def site_key(site: str) -> str:
    """Return the key that says that a site belongs to the realm."""
    return f"{SITE}/{site}"


def silent_key(site: str) -> str:
    """Return the key that says that a site is not heard."""
    return f"{SILENT}/{site}"


def place_key(site: str, key: str) -> str:
    """Return the key that says at which site an agent is."""
    return f"{AT}/{site}/{key}"


def here_of(presence: Presence, keys: Iterable[str]) -> list[str]:
    """Return those of the keys whose agents are on this machine."""
    places = Places(presence)
    return [key for key in keys if not places.site_of(key)]


class _Seen:
    """What follows from the table while it does not change."""

    def __init__(self, presence: Presence) -> None:
        self.revision = presence.revision
        found = map(Address.parse, presence.keys(everyone("gateway")))
        self.own = next((address.name for address in found if address is not None), "")
        self.sites = tuple(key.removeprefix(f"{SITE}/") for key in presence.keys(f"{SITE}/*"))
        self.shown: dict[Address, Address] = {}


class Places:
    """See the module. May be asked from any thread."""

    def __init__(self, presence: Presence) -> None:
        """Look into this table."""
        self._presence = presence
        self._last: _Seen | None = None

    @property
    def own(self) -> str:
        """The name of this machine's site; empty: no gateway runs here."""
        return self._seen().own

    def sites(self) -> tuple[str, ...]:
        """Return the other sites of the realm, by name, heard or not."""
        return self._seen().sites

    def silent(self, site: str) -> bool:
        """Whether a site is not heard now."""
        return self._presence.there(silent_key(site))

    def site_of(self, key: str) -> str:
        """Return the other site at which an agent is; empty: it is of this machine, or nobody knows it."""
        there = self._presence.there
        return next((site for site in self.sites() if there(place_key(site, key))), "")

    def shown(self, address: Address) -> Address:
        """Return an address as people are shown it: with its site, if another site has the same name, too."""
        seen = self._seen()
        found = seen.shown.get(address)
        if found is None:
            found = seen.shown[address] = self._look(address, seen.own)
        return found

    def at(self, role: Role, site: str, name: str = "*") -> list[str]:
        """Return the keys of the agents of a role at a site, this machine's included."""
        keys = self._presence.keys(everyone(role, name))
        wanted = "" if site == self.own else site
        return [key for key in keys if self.site_of(key) == wanted]

    def _seen(self) -> _Seen:
        last = self._last
        if last is None or last.revision != self._presence.revision:
            last = self._last = _Seen(self._presence)
        return last

    def _look(self, address: Address, own: str) -> Address:
        if not own or ":" in address.name:
            return address
        here = self.site_of(address.key)
        others = self._presence.keys(everyone(address.role, address.name))
        if all(self.site_of(key) == here for key in others):
            return address
        return address.shown(here or own)
