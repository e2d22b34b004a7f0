"""The combined lists of all running lookup services, as one process sees them.

An agent that several services list counts once, so losing one of several changes nothing. What a lost
service held is remembered for a while, and when all are lost, until one returns: the robots are still
there, only the list may be old (`stale`).
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable

from robotree.vr.base.address import Address, Role, everyone, parted, user_of
from robotree.vr.base.description import Listing, Template
from robotree.vr.base.errors import (
    AddressError,
    Hanging,
    NoSpace,
    NoSuchHost,
    NoSuchRobot,
    NoSuchSite,
    NoSuchView,
    SeveralSites,
    SeveralUsers,
    SiteAway,
    VrError,
)
from robotree.vr.base.places import Places
from robotree.vr.base.principal import user_name
from robotree.vr.base.requests import Found, Listed, Query, Unlisted, decode_event
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.claim import Declarations
from robotree.vr.lookup.service import NEWS_PATTERN
from robotree.vr.lookup.union import Change, Union

SYNCHRONISE = 10.0
"""[s] between full comparisons with each service: news that a busy network dropped is made up for."""

RETRY = 0.5
"""[s] before a service that did not answer is asked again."""

QUERY_WITHIN = 2.0
"""[s] to wait for a service's answer."""

FIRST_LOOK = 1.0
"""[s] that `start` waits for the services that are there."""

MEMORY = 3.0
"""[s] for which others may still need what a lost service knew: until all agents have registered again."""

_MISSING: dict[Role, type[AddressError]] = {"robot": NoSuchRobot, "view": NoSuchView, "host": NoSuchHost}
_log = logging.getLogger(__name__)

OnChange = Callable[[Change], None]


class Directory:
    """Sees who is there. Lives on the event loop of its transport."""

    def __init__(self, transport: Transport) -> None:
        """Prepare to look."""
        self._transport, self.places = transport, Places(transport.presence)
        self._union = Union(lambda address: transport.presence.there(address.key))
        self._followers: dict[str, asyncio.Task[None]] = {}
        self._heard: dict[str, list[Listed | Unlisted]] = {}
        self._answered: dict[str, asyncio.Event] = {}
        self._callbacks: list[OnChange] = []
        self._declared = Declarations()
        self._forgetting: asyncio.TimerHandle | None = None

    async def start(self) -> None:
        """Begin to look; returns when the services that are there have sent their lists."""
        # news first: what changes after a service has answered must not be missed
        await self._declared.keep(self._transport.subscribe(NEWS_PATTERN, self._news))
        self._declared.callback(self._transport.presence.watch("*/*/*", self._seen))
        await self.settled(FIRST_LOOK)

    async def settled(self, limit: float) -> None:
        """Wait until all present services have sent their lists, for `limit` [s] at most."""
        waiting = [asyncio.create_task(event.wait()) for event in self._answered.values()]
        if waiting:
            await asyncio.wait(waiting, timeout=limit)
            for task in waiting:
                task.cancel()

    async def close(self) -> None:
        """Look no more. Twice is once."""
        await self._declared.aclose()
        followers, self._followers = self._followers, {}
        for follower in followers.values():
            follower.cancel()
        await asyncio.gather(*followers.values(), return_exceptions=True)
        if self._forgetting is not None:
            self._forgetting.cancel()

    @property
    def listings(self) -> tuple[Listing, ...]:
        """All that are listed, by role and name."""
        return tuple(sorted(self._union.listings.values(), key=lambda listing: listing.address))

    @property
    def services(self) -> tuple[str, ...]:
        """Names of the lookup services that live."""
        parsed = (Address.parse(key) for key in self._union.services)
        return tuple(sorted(address.name for address in parsed if address is not None))

    @property
    def stale(self) -> bool:
        """Whether no lookup service runs, so that the list may be old."""
        return not self._union.services

    def find(self, template: Template) -> tuple[Listing, ...]:
        """Return the listings that match, by role and name."""
        return tuple(listing for listing in self.listings if template.matches(listing))

    def on_change(self, callback: OnChange) -> Callable[[], None]:
        """Call back after each change; returns how to end that."""
        self._callbacks.append(callback)

        def end() -> None:
            if callback in self._callbacks:
                self._callbacks.remove(callback)

        return end

    def present(self, role: Role, name: str = "*") -> tuple[Address, ...]:
        """Return all agents of a role, or of a name, that are seen alive, listed or not.

        Args:
            role: of the agents.
            name: of theirs, or `SITE:NAME`; of several sites all are meant if it has no site.
        """
        site, colon, plain = name.rpartition(":")
        if colon:
            keys = self.places.at(role, site, plain)
        else:
            keys = self._transport.presence.keys(everyone(role, name))
        return tuple(sorted(address for address in map(Address.parse, keys) if address is not None))

    async def resolve(self, name: str, role: Role = "robot") -> Address:
        """Find an agent by its name, also one that is enslaved and therefore not listed.

        Args:
            name: of the agent, or `SITE:NAME`. Without a site the one of this machine is meant, else the only
                one that there is.
            role: of the agent.

        Raises:
            BadName: nobody can have this name.
            NoSuchRobot: or NoSuchHost, NoSuchView: no living agent of this role has the name.
            Hanging: one has it whose process does not answer.
            SeveralSites: none of this machine has it, and those of several other sites have.
            SeveralUsers: none of this user has it, and those of several others have, who share the realm.
            NoSuchSite: the site is none of the realm.
            SiteAway: it is not heard.
        """
        site, plain = parted(name)  # it becomes part of a pattern
        if not self.present(role, name) and not self._is_elsewhere(site):
            await self.expect_awake(everyone(role, plain))  # who is just coming is there afterwards
        if not (found := self.present(role, name)):
            if self._is_elsewhere(site):
                self._expect_heard(site, role, plain)
            if role == "space":
                raise NoSpace(name=f"{name!r} ", example=plain)
            raise _MISSING.get(role, NoSuchRobot)(name=name)
        meant = found if len(found) == 1 else self.nearest(found, role, plain)
        return next((address for address in meant if address in self._union.listings), meant[0])

    def _is_elsewhere(self, site: str) -> bool:
        return bool(site) and site != self.places.own

    def _expect_heard(self, site: str, role: Role, name: str) -> None:
        """Check that another site is heard.

        Raises:
            NoSuchSite: there is no such site.
            SiteAway: it is not heard.
        """
        if site not in (sites := self.places.sites()):
            raise NoSuchSite.among(site, sites)
        if self.places.silent(site):
            raise SiteAway(site=site, role=role, name=name)

    def nearest(self, found: tuple[Address, ...], role: Role, name: str) -> tuple[Address, ...]:
        """Return those of this machine, or of the only site: sites may have chosen the same name.

        Users who share a realm may have done so, too: one's own comes first, as at a site.

        Raises:
            SeveralSites: there is none here, and several elsewhere.
            SeveralUsers: several other users have one.
        """
        users = {address: user_of(address.key) for address in found}
        if len(set(users.values())) > 1 and not any(self.places.site_of(one.key) for one in found):
            own = tuple(address for address in found if users[address] == os.geteuid())
            if own:
                return own
            names = sorted("" if user is None else user_name(user) for user in set(users.values()))
            raise SeveralUsers(role=role, name=name, users=" and ".join(names))
        if not self.places.own:
            return found
        sites = {address: self.places.site_of(address.key) for address in found}
        names = sorted(set(sites.values()))
        if "" in names or len(names) == 1:
            return tuple(address for address in found if sites[address] == names[0])
        examples = " or ".join(f"{site}:{name}" for site in names)
        raise SeveralSites(role=role, name=name, sites=" and at ".join(names), examples=examples)

    async def expect_awake(self, pattern: str) -> None:
        """Check that no agent under a pattern is in a process that hangs.

        Raises:
            Hanging: somebody does.
        """
        for one in await self._transport.presence.hanging(pattern):
            if address := Address.parse(one.key):
                raise Hanging(role=address.role, name=address.name, where=one.in_words, remedy=one.remedy)

    # -- inside -----------------------------------------------------------------------------------

    def _seen(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        address = Address.parse(key)
        if address is None:
            return
        if address.role != "lookup":
            self._tell(self._union.see(address) or [Change("presence")])
        elif there:
            self._union.add_service(key)
            self._answered[key] = asyncio.Event()
            self._followers[key] = asyncio.create_task(self._follow(key), name=f"follows {key}")
            self._tell([Change("services")])
        elif key in self._followers:
            self._followers.pop(key).cancel()
            self._answered.pop(key)
            self._forget_later()
            self._tell([*self._union.lose_service(key), Change("services")])

    def _news(self, key: str, body: bytes) -> None:
        try:
            news = decode_event(body, key=key)
        except VrError as error:
            _log.warning("%s", error)
            return
        service = key.rpartition("/")[0]
        if isinstance(news, Listed | Unlisted):
            if service in self._heard:
                self._heard[service].append(news)
            self._tell(self._union.take_news(service, news))

    async def _follow(self, service: str) -> None:
        """Ask a service for all it holds, again and again."""
        while True:
            # what it reports while it answers may overtake the answer
            heard = self._heard[service] = []
            pause = SYNCHRONISE
            try:
                found = await ask(self._transport, service, Query(), Found, timeout=QUERY_WITHIN)
            except VrError:
                pause = RETRY
            else:
                self._take(service, [listing for listing, _ in found.listings], heard)
            finally:
                if self._heard.get(service) is heard:
                    del self._heard[service]
            await asyncio.sleep(pause)

    def _take(self, service: str, listings: list[Listing], heard: list[Listed | Unlisted]) -> None:
        self._tell(self._union.replace(service, listings, heard))
        if not self._answered[service].is_set():
            self._answered[service].set()
            self._forget_later()

    def _forget_later(self) -> None:
        if self._forgetting is not None:
            self._forgetting.cancel()
        self._forgetting = asyncio.get_running_loop().call_later(MEMORY, self._forget)

    def _forget(self) -> None:
        if any(answered.is_set() for answered in self._answered.values()):
            self._tell(self._union.forget_lost())

    def _tell(self, changes: list[Change]) -> None:
        for change in changes:
            for callback in list(self._callbacks):
                try:
                    callback(change)
                except Exception:  # noqa: BLE001 # one listener's fault is not the others'
                    _log.exception("a listener to the directory raised")
