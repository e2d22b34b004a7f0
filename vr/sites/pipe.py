"""What a gateway needs of the network between machines, and nothing more; and one in memory, for tests.

A pipe delivers bytes by topic, at most once, and vouches for nothing: who is at the other end, whether it
arrived, and whether it was changed on the way, the sealed stream knows (`stream.py`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from robotree.vr.base.pattern import matches

OnArrival = Callable[[str, bytes], None]
"""Takes a topic and what was published there, in any thread. Must not block."""


class Topics(NamedTuple):
    """Where the members of a realm hear each other."""

    realm: str

    def to(self, name: str) -> str:
        """Messages to one gateway."""
        return f"robotree/{self.realm}/to/{name}"

    @property
    def here(self) -> str:
        """Hints that somebody is there."""
        return f"robotree/{self.realm}/here"

    def authority(self, about: str, number: str) -> str:
        """Requests to the authority: `join` with the number of the invitation, `renew` with a name."""
        return f"robotree/{self.realm}/authority/{about}/{number}"

    def answer(self, about: str, number: str) -> str:
        """Its answers to these."""
        return f"robotree/{self.realm}/answer/{about}/{number}"


GRANTED = b"+"
"""First byte of an answer of the authority that is no error."""


class LinkState(NamedTuple):
    """Whether the network between machines can be used now."""

    up: bool
    where: str
    """The hub, for people."""
    reason: str = ""
    """Why it cannot, as a clause."""


class Pipe(Protocol):
    """The way to other machines."""

    def publish(self, topic: str, body: bytes, *, to_all: bool = False) -> None:
        """Send to who subscribes to a topic now. From any thread; never blocks for long; may lose it.

        Args:
            topic: where.
            body: what.
            to_all: whether all who subscribe are meant, and not only one: they may be at several hubs.
        """
        ...

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        """Take what is published under a pattern, `*` for one chunk, from now on, also over a new link."""
        ...

    def hint(self, on_arrival: Callable[[], None]) -> None:
        """Call when somebody may have arrived: nothing but a reason to greet sooner."""
        ...

    def state(self) -> LinkState:
        """Return whether it can be used now."""
        ...

    def close(self) -> None:
        """Leave. Twice is once."""
        ...


class MemoryHub:
    """What joins the pipes of a test: it can lose, delay by holding back, repeat, reorder and inject."""

    def __init__(self) -> None:
        """Begin with no pipes, and deliver all."""
        self.pipes: list[MemoryPipe] = []
        self.on_way: Callable[[str, bytes], list[bytes]] = lambda _topic, body: [body]
        """What becomes of a message on its way."""
        self.up = True

    def carry(self, topic: str, body: bytes) -> None:
        """Deliver what was published."""
        if self.up:
            for one in self.on_way(topic, body):
                self.inject(topic, one)

    def inject(self, topic: str, body: bytes) -> None:
        """Deliver something, whoever made it."""
        for pipe in list(self.pipes):
            pipe.take(topic, body)


class MemoryPipe:
    """A pipe to a `MemoryHub`."""

    def __init__(self, hub: MemoryHub) -> None:
        """Join the hub."""
        self._hub = hub
        self._subscribed: list[tuple[str, OnArrival]] = []
        hub.pipes.append(self)

    def publish(self, topic: str, body: bytes, *, to_all: bool = False) -> None:
        del to_all  # there is one hub
        self._hub.carry(topic, body)

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        self._subscribed.append((pattern, on_message))

    def hint(self, on_arrival: Callable[[], None]) -> None:
        del on_arrival  # nobody arrives unheard

    def state(self) -> LinkState:
        return LinkState(self._hub.up, "memory", "" if self._hub.up else "it is cut")

    def close(self) -> None:
        if self in self._hub.pipes:
            self._hub.pipes.remove(self)

    def take(self, topic: str, body: bytes) -> None:
        """Hand on what the hub delivers."""
        for pattern, on_message in self._subscribed:
            if matches(pattern, topic):
                on_message(topic, body)
