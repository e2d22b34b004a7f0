"""What the people of another site may see of this machine, and the policy on its way between sites.

Each robot refuses who may not ask it (`vr/exchange/authority.py`). What nobody asks for, names that are
announced and states that are published, the gateway keeps back: a site gets what anybody there may see. Who
asks a robot of another site is announced there, seen or not: a parent must be, for its lease.

A line about a kind needs the kind of a robot, which its name does not tell: the gateway asks the robot, once.
"""

from __future__ import annotations

import asyncio
import logging
from typing import NamedTuple

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.errors import VrError
from robotree.vr.base.places import CALLER
from robotree.vr.base.policy import BY_NAME, Policy, PolicyTarget
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    Describe,
    Described,
    Listed,
    OperatorHere,
    SiteSeen,
    decode_event,
    encode,
)
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.sites.certificates import MemberKind
from robotree.vr.sites.frames import Announced, OneNews, SitePolicy
from robotree.vr.sites.sealing import Lane
from robotree.vr.sites.site import Site, WaysToSites

_log = logging.getLogger(__name__)


class Showing:
    """See the module. On the event loop."""

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


class RememberedSite(NamedTuple):
    """What this machine remembers of a site."""

    name: str
    kind: MemberKind = "site"
    ends: float = 0.0


def seen(known: RememberedSite, site: Site | None, now: float, trouble: tuple[str, str]) -> SiteSeen:
    """Return how a site is.

    Args:
        known: what is remembered of it.
        site: what is seen of it since this gateway began; None: nothing.
        now: [s]
        trouble: why no site can be reached, as a clause, and the remedy; empty: the hub answers.
    """
    stream = None if site is None else site.stream
    if site is None or stream is None:
        reason, remedy = trouble
        if site is not None and site.refused and not reason:
            reason, remedy = site.refused, f"what it says helps, at site {known.name} or here"
        return SiteSeen(
            name=known.name,
            kind=known.kind,
            ends=known.ends,
            heard=-1.0 if site is None or not site.was_heard else now - site.was_heard,
            reason=reason or "the hub is reached, and nothing comes from there",
            remedy=remedy
            or f"see that `robotree gateway` runs at site {known.name} and reaches the same hub",
        )
    linked = site.linked(now)
    reason, remedy = ("", "") if linked else trouble
    if not linked and not reason:
        reason = "its gateway, or its line to the hub, has fallen silent"
        remedy = f"wait: it is dialed for ever; or look at the gateway of site {known.name}"
    hung = ((address, where, cure) for key, where, cure in site.hung if (address := Address.parse(key)))
    return SiteSeen(
        name=known.name,
        kind=known.kind,
        state="linked" if linked else "silent",
        heard=stream.silence(now),
        way=stream.way,
        round_trip=stream.round_trip,
        rate=stream.rate,
        agents=sum(Address.parse(key) is not None for key in site.keys),
        reason=reason,
        remedy=remedy,
        version=site.version,
        clock=site.clock,
        ends=known.ends if site.member is None else site.member.ends,
        hung=tuple((address.name, where, cure) for address, where, cure in hung),
    )
