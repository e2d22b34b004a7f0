"""One other site, as the gateway of this machine knows it: linked, silent, or gone. On the event loop.

A site that is not heard is *silent* first, and not dead: its keys stay, so nobody loses a parent or a child
by a short cut, and bonds end with their leases. New requests to it are refused at once. Only after `GONE`
seconds it is taken from the lists. The session stays until then, and with it all that is under way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from robotree.vr.base.transport import End, Respond
from robotree.vr.sites.certificates import Certificate
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
