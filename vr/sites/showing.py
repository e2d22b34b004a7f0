"""Who is present at the other side of a gateway: agents of other sites here, those of this machine there."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.errors import TooManyKeys, VrError
from robotree.vr.base.places import CALLER, OWN, place_key, silent_key, site_key
from robotree.vr.base.policy import BY_NAME, Policy, PolicyTarget
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    Describe,
    Described,
    Listed,
    OperatorHere,
    decode_event,
    encode,
)
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.network.mesh import TakeFrame
from robotree.vr.sites.frames import Announced, OneNews, SitePolicy
from robotree.vr.sites.networks import Ground
from robotree.vr.sites.sealing import Lane
from robotree.vr.sites.site import Site, WaysToSites

_log = logging.getLogger(__name__)


class Showing:
    """What the people of another site may see of this machine, and the policy on its way between sites.

    Each robot refuses who may not ask it (`vr/exchange/authority.py`). What nobody asks for, names that are
    announced and states that are published, the gateway keeps back: a site gets what anybody there may see.
    Who asks a robot of another site is announced there, seen or not: a parent must be, for its lease.

    A line about a kind needs the kind of a robot, which its name does not tell: the gateway asks the robot,
    once. On the event loop.
    """

    def __init__(self, gateway: WaysToSites, transport: Transport) -> None:
        """Take the ways to the sites and to the agents of this machine."""
        self._gateway, self._transport, self._gate = gateway, transport, transport.gate
        self._policy: Policy | None = self._gate.policy
        self._kinds: dict[str, tuple[str, ...]] = {}
        """Of the robots that were asked, by key."""
        self._asking: dict[str, asyncio.Task[None]] = {}

    # -- the policy -------------------------------------------------------------------------------

    def look(self) -> None:
        """See whether another policy is in force, and hand it on. Often."""
        now = self._gateway.now()
        if now >= self._gate.due:
            self._gate.refresh(now)
        if self._gate.policy is not self._policy:
            self._policy = self._gate.policy
            for site in self._gateway.sites.values():
                self.send_policy(site)
                self._show_anew(site)

    def send_policy(self, site: Site) -> None:
        """Tell a site which policy is in force here."""
        if self._gate.data:
            self._gateway.send(site, SitePolicy(self._gate.data), Lane.URGENT)

    def take_policy(self, data: bytes) -> None:
        """Put a policy in force that another site has sent, if it is newer and signed."""
        try:
            newer = self._gate.offer(data)
        except (VrError, OSError) as error:
            _log.warning("a policy of another site is not used: %s", error)
            return
        if newer:
            self.look()

    # -- who is there -----------------------------------------------------------------------------

    def begin(self, site: Site) -> list[str]:
        """Return the keys of this machine that a site is told when a session begins."""
        site.introduced.clear()
        site.told = {key for key in self._gateway.local if self._sees(site, key)}
        return sorted(site.told)

    def tell(self, site: Site, key: str, *, there: bool) -> None:
        """Tell a site that an agent of this machine has come or gone, if it may know it."""
        if not there:
            self._kinds.pop(key, None)
            site.introduced.discard(key)
        if there != (key in site.told) and (not there or self._sees(site, key)):
            self._announce(site, key, there=there)

    def introduce(self, site: Site, sender: str) -> None:
        """Tell a site of who asks there."""
        if self._policy is not None and sender in self._gateway.local:
            site.introduced.add(sender)
            if sender not in site.told:
                self._announce(site, sender, there=True)

    def shown(self, site: Site, key: str, body: bytes) -> bytes | None:
        """Return what a site may hear of what is published under a key; None: nothing."""
        if self._policy is None:
            return body
        address = Address.parse("/".join(key.split("/", 3)[:3]))
        if key.startswith(CALLER) or (address is not None and address.role == "lookup"):
            return self._shown_event(site, key, body)
        return body if address is None or self._sees(site, address.key) else None

    def _shown_event(self, site: Site, key: str, body: bytes) -> bytes | None:
        """Return what a site may hear of an operator, or of what a lookup service lists."""
        try:
            news = decode_event(body, key=key)
        except VrError:
            return None
        if isinstance(news, OperatorHere):  # the page, not of which robot
            page = news.page.partition(" of ")[0]
            return encode(msgspec.structs.replace(news, page=page, robot=""))
        if not isinstance(news, Listed):
            return body
        return body if self._allowed(site, news.listing.address, tuple(news.listing.kinds)) else None

    def _announce(self, site: Site, key: str, *, there: bool) -> None:
        rank = self._gateway.rank(key) if there else 0
        if self._gateway.send(site, OneNews(Announced.PRESENT, key, there, rank), Lane.URGENT):
            (site.told.add if there else site.told.discard)(key)

    def _show_anew(self, site: Site) -> None:
        """Another policy is in force: tell what may be seen now, and take back what may not."""
        for key in sorted(self._gateway.local - site.introduced):
            if (there := self._sees(site, key)) != (key in site.told):
                self._announce(site, key, there=there)

    def _sees(self, site: Site, key: str) -> bool:
        if self._policy is None:
            return True
        address = Address.parse(key)
        if address is None or address.role not in BY_NAME["see"].roles or address.role == "host":
            return True
        return self._allowed(site, address, self._kinds_of(address))

    def _allowed(self, site: Site, address: Address, kinds: tuple[str, ...]) -> bool:
        policy, member = self._policy, site.member
        if policy is None:
            return True
        target = PolicyTarget(address.name, address.role, kinds, "", self._gate.site)
        return policy.may_anybody_of(site.name, "see", target, () if member is None else member.may)

    def _kinds_of(self, address: Address) -> tuple[str, ...]:
        """Return the kinds of an agent; none, if they are not known yet: then they will be."""
        key, policy = address.key, self._policy
        if policy is None or address.role != "robot" or not policy.asks_for_kinds("see"):
            return ()
        if key not in self._kinds and key not in self._asking:
            self._asking[key] = asyncio.ensure_future(self._learn(key))
        return self._kinds.get(key, ())

    async def _learn(self, key: str) -> None:
        try:
            found = await ask(self._transport, key, Describe(), Described, timeout=ANSWER_WITHIN)
            self._kinds[key] = found.robot.kinds
        except VrError:
            return  # it is asked again at the next look at it
        finally:
            self._asking.pop(key, None)
        for site in self._gateway.sites.values():
            if key in self._gateway.local and self._sees(site, key):
                self.tell(site, key, there=True)


class Standing:
    """The keys of other sites' agents, under which the gateway is present for the processes of its machine.

    What a site says of itself is its *claim*. Two sites may claim one key for a while, when a robot has
    moved: the news of its new site may come before the old one's. The highest rank counts, the number of its
    moves, then the newest claim, and when it goes the other one does again. A key that a process of this
    machine holds is not announced, unless a claim has a higher rank: the robot has left that process, which
    goes on as long as somebody may ask it, so nobody sees it absent.

    Where each agent is, and which site is not heard, is announced beside it (`vr/base/places.py`). On the
    event loop.
    """

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
