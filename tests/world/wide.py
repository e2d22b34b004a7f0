"""Lines between sites, in virtual time: slow, lossy, cut, and led over hubs that die.

Each site has one line to the hub. A message takes the line of its sender and that of its receiver; each of
them may delay it, lose it, bring it twice, or be cut. What is under way when the hub dies is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

import msgspec

from robotree.vr.base.pattern import matches
from robotree.vr.base.transport import Incoming, OnReply
from robotree.vr.network.mesh import TakeFrame
from robotree.vr.sites.networks import LinkState, OnArrival
from robotree.vr.world.network import Agenda, MemoryTransport


class MemoryGround:
    """What a gateway needs of the network of its machine, besides a transport: see `vr/sites/networks.py`."""

    def __init__(self, transport: MemoryTransport) -> None:
        """Speak as this member."""
        self._transport, self.presence = transport, transport.presence
        self.end_serving, self.announce, self.withdraw = (
            transport.end_serving,
            transport.be_present,
            transport.unannounce,
        )
        self.subscribe, self.unsubscribe = transport.begin_hearing, transport.end_hearing
        self.publish = transport.publish

    def serve(self, key: str, answer: TakeFrame, *, rank: int = 0) -> None:
        """Take the requests to a key; nobody says here which are urgent.

        Raises:
            ValueError: this member serves it already.
        """

        def take(incoming: Incoming) -> None:
            answer(incoming.body, incoming.credentials, True, incoming.reply, incoming.end)

        self._transport.begin_serving(key, take, rank=rank)

    def held_elsewhere(self, keys: Collection[str]) -> set[str]:
        """Return those of these keys under which another member is present and seen."""
        return set(filter(self._transport.held_by_others, keys))

    def rank_elsewhere(self, key: str) -> int:
        """Return the highest rank by which another member serves a key; 0: none does."""
        others = [one for one in self._transport.network.members if one is not self._transport]
        return max((one.ranks.get(key, 0) for one in others if key in one.served), default=0)

    def wanted(self) -> set[str]:
        """Return the patterns to which the other members subscribe."""
        others = [one for one in self._transport.network.members if one is not self._transport]
        return {pattern for one in others for pattern in one.patterns()}

    def ask(self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool, on_reply: OnReply) -> None:
        """Ask the member that serves a key."""
        self._transport.ask(key, body, void_at=void_at, urgent=urgent, on_reply=on_reply)


class Line(msgspec.Struct):
    """The line of one site to the hub. May be changed at any time."""

    delay: float = 0.02
    """[s] one way."""
    jitter: float = 0.0
    """[s] by which a message may take longer; so one overtakes another."""
    loss: float = 0.0
    """Probability that a message does not arrive."""
    duplication: float = 0.0
    """Probability that it arrives twice."""
    up: bool = True


class WideArea:
    """The hub and all lines."""

    def __init__(self, agenda: Agenda, chance: Callable[[], float]) -> None:
        """Begin with no sites; `chance` draws from 0 to 1."""
        self._agenda, self._chance = agenda, chance
        self.lines: dict[str, Line] = {}
        self.pipes: list[WidePipe] = []
        self.hub_life = 1
        """How often the hub was started; 0: it is not there."""
        self._lives = 1
        self.bytes_sent: dict[str, int] = {}
        """[bytes] that each site has sent."""
        self.on_way: Callable[[str, str, bytes], bool] = lambda _site, _topic, _body: True
        """Whether a message may pass, of which site and topic; a story looks at them here."""

    def line(self, site: str) -> Line:
        """Return the line of a site."""
        return self.lines.setdefault(site, Line())

    def kill_hub(self) -> None:
        """End the hub, with all that is under way."""
        self.hub_life = 0

    def start_hub(self) -> None:
        """Start it again: who has a line hears that somebody may be there."""
        if not self.hub_life:
            self._lives += 1
            self.hub_life = self._lives
            for pipe in list(self.pipes):
                pipe.hear_of_arrival()

    def carry(self, site: str, topic: str, body: bytes) -> None:
        """Take a message from a site to all who subscribe to its topic."""
        self.bytes_sent[site] = self.bytes_sent.get(site, 0) + len(body)
        if self.on_way(site, topic, body):
            self._over(self.line(site), partial(self._spread, topic, body))

    def _spread(self, topic: str, body: bytes) -> None:
        for pipe in list(self.pipes):
            if pipe.wants(topic):
                self._over(self.line(pipe.site), partial(pipe.take, topic, body))

    def _over(self, line: Line, arrive: Callable[[], None]) -> None:
        life = self.hub_life

        def at_the_end() -> None:
            if line.up and self.hub_life == life:
                arrive()

        if life and line.up and self._chance() >= line.loss:
            for _ in range(2 if self._chance() < line.duplication else 1):
                late = line.jitter * self._chance() if line.jitter else 0.0
                self._agenda.at(self._agenda.now() + line.delay + late, at_the_end)


class WidePipe:
    """The pipe of one site's gateway: see `Pipe`."""

    def __init__(self, area: WideArea, site: str) -> None:
        """Join the area."""
        self.area, self.site = area, site
        self._subscribed: list[tuple[str, OnArrival]] = []
        self._hints: list[Callable[[], None]] = []
        area.pipes.append(self)

    def publish(self, topic: str, body: bytes, *, to_all: bool = False) -> None:
        """See `Pipe`."""
        del to_all  # there is one hub
        if self in self.area.pipes:
            self.area.carry(self.site, topic, body)

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        """See `Pipe`."""
        self._subscribed.append((pattern, on_message))

    def hint(self, on_arrival: Callable[[], None]) -> None:
        """See `Pipe`."""
        self._hints.append(on_arrival)

    def state(self) -> LinkState:
        """See `Pipe`."""
        up = bool(self.area.hub_life) and self.area.line(self.site).up
        return LinkState(up, "the hub", "" if up else "no hub answers")

    def close(self) -> None:
        """See `Pipe`."""
        if self in self.area.pipes:
            self.area.pipes.remove(self)

    def wants(self, topic: str) -> bool:
        """Whether anybody here subscribes to a topic."""
        return any(matches(pattern, topic) for pattern, _ in self._subscribed)

    def take(self, topic: str, body: bytes) -> None:
        """Hand on what has arrived."""
        if self in self.area.pipes:
            for pattern, on_message in self._subscribed:
                if matches(pattern, topic):
                    on_message(topic, body)

    def hear_of_arrival(self) -> None:
        """The hub is back."""
        for on_arrival in self._hints:
            on_arrival()
