"""One other site, as the gateway of this machine knows it: linked, silent, or gone. On the event loop.

A site that is not heard is *silent* first, and not dead: its keys stay, so nobody loses a parent or a child
by a short cut, and bonds end with their leases. New requests to it are refused at once. Only after `GONE`
seconds it is taken from the lists. The session stays until then, and with it all that is under way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from robotree.vr.base.address import Address
from robotree.vr.base.requests import SiteSeen
from robotree.vr.base.transport import End, Respond
from robotree.vr.sites.certificates import Certificate, MemberKind
from robotree.vr.sites.frames import SiteAsk, SiteFrame
from robotree.vr.sites.sealing import Lane
from robotree.vr.sites.stream import SiteStream
from robotree.vr.sites.summary import Mirrors, Summaries

SILENT = 1.6
"""[s] without a sign of life after which a site is silent: it has missed three beats."""

GONE = 6.0
"""[s] without one after which its session ends, and it is in no list: longer than a lease."""

ARRIVAL = 1.0
"""[s] for which a request waits for the news that its asker is present, or where an agent is now."""


@dataclass(slots=True)
class SiteExchange:
    """A request to the site that it has yet to answer."""

    key: str
    respond: Respond
    end: End
    void_at: float
    again: Callable[[], None]
    """Sends a request to the agent that has the key now."""


class Site:
    """See the module."""

    def __init__(self, name: str) -> None:
        """Begin: it has not been heard."""
        self.name = name
        self.member: Certificate | None = None
        """Who it is, proved; None: it has not been heard since this gateway began."""
        self.stream: SiteStream | None = None
        self.keys = set[str]()
        """Under which its agents are present; announced here."""
        self.told = set[str]()
        """Keys of this machine of which it knows: see `Showing`."""
        self.introduced = set[str]()
        """Those of them that have asked there."""
        self.fresh = set[str]()
        """Of these: what it has said since the session began, while it goes on to say."""
        self.patterns: dict[str, Callable[[], None]] = {}
        """What it wants to hear, and how to hear it for it no longer."""
        self.exchanges: dict[int, SiteExchange] = {}
        self.early: deque[tuple[float, SiteAsk]] = deque()
        """Requests whose asker is not known to be present yet, and when they came [s]."""
        self.summaries, self.mirrors = Summaries(0.0), Mirrors()
        """The states of robots that go there, and those that come."""
        self.was_heard = 0.0
        """[s] When it was heard last, before its session ended; 0: never."""
        self.refused = ""
        """Why what it last said of itself was not believed, as a clause; empty: it was."""
        self.answered = float("-inf")
        """[s] When that was answered last."""
        self.version, self.clock = "", 0.0
        """Of robotree there, and by how much its clock is ahead [s]."""
        self.hung: list[tuple[str, str, str]] = []
        """Its agents that hang there: key, process, and the remedy for a person there."""
        self.tried, self.tries = float("-inf"), 0
        """[s] When this side greeted it last, and how often since it was heard."""

    def linked(self, now: float) -> bool:
        """Whether it is heard [now in s]."""
        return self.stream is not None and self.stream.silence(now) < SILENT

    def silence(self, now: float) -> float:
        """Return for how long it was not heard [s]."""
        return GONE if self.stream is None else self.stream.silence(now)


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


class WaysToSites(Protocol):
    """What the parts of a gateway need of it."""

    sites: dict[str, Site]

    @property
    def local(self) -> set[str]:
        """The keys that are present here and of this machine."""
        ...

    def send(self, site: Site, frame: SiteFrame, lane: Lane, *, until: float = ...) -> bool:
        """Send a frame to a site; returns whether there is a session with it."""
        ...

    def rank(self, key: str) -> int:
        """Return how often an agent of this machine has moved."""
        ...

    def now(self) -> float:
        """[s] on this machine's monotonic clock."""
        ...

    def reason(self) -> str:
        """Return why no site can be reached, as a clause; empty: the hub answers."""
        ...
