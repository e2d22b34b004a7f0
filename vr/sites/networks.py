"""What a gateway needs of the network between machines, and of that of its own machine, and nothing more.

A pipe delivers bytes by topic, at most once, and vouches for nothing: who is at the other end, whether it
arrived, and whether it was changed on the way, the sealed stream knows (`stream.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple, Protocol

from robotree.vr.base.presence import Presence
from robotree.vr.base.transport import OnReply
from robotree.vr.network.mesh import TakeFrame

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


class Ground(Protocol):
    """The way to the processes of a machine: `Mesh` is one; the World has another.

    All methods may be called from any thread; none waits.
    """

    presence: Presence

    def serve(self, key: str, answer: TakeFrame, *, rank: int = 0) -> None:
        """Take the requests to a key; `rank` as in `Transport.serve`.

        Raises:
            ValueError: this process serves it already.
            TooManyKeys: it announces as many keys as others take.
        """
        ...

    def end_serving(self, key: str) -> None:
        """Take no more requests to a key."""
        ...

    def announce(self, key: str) -> None:
        """Be present under a key.

        Raises:
            TooManyKeys: as in `serve`.
        """
        ...

    def withdraw(self, key: str) -> None:
        """Be present under a key no longer."""
        ...

    def held_elsewhere(self, keys: Collection[str]) -> set[str]:
        """Return those of these keys under which another process of this machine is present and awake."""
        ...

    def rank_elsewhere(self, key: str) -> int:
        """Return the highest rank by which another process of this machine serves a key; 0: none does."""
        ...

    def wanted(self) -> set[str]:
        """Return the patterns to which the other processes subscribe."""
        ...

    def subscribe(self, pattern: str, on_sample: Callable[[str, bytes], None]) -> int:
        """Take the samples under a pattern; returns a number for `unsubscribe`."""
        ...

    def unsubscribe(self, number: int) -> None:
        """Take them no longer."""
        ...

    def publish(self, key: str, body: bytes) -> None:
        """Tell all who want the samples of a key."""
        ...

    def ask(self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool, on_reply: OnReply) -> None:
        """Ask the process that serves a key: see `Transport.ask`."""
        ...
