"""What a gateway needs of the network of its machine. `Mesh` is one; the World has another."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Protocol

from robotree.vr.base.presence import Presence
from robotree.vr.base.transport import OnReply
from robotree.vr.network.mesh import TakeFrame


class Ground(Protocol):
    """The way to the processes of a machine. All methods may be called from any thread; none waits."""

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
