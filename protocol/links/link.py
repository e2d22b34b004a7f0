"""What a link is: a way for bytes to go there and back, told through callbacks.

A link neither knows messages nor cuts the incoming stream at frames; a `Handler`, usually an
`robotree.protocol.endpoint.Endpoint`, does. `check_link` and `check_close_in_accept` of
`robotree.protocol.testing` examine any new one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import msgspec

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.errors import LinkError


class LinkStatistics(msgspec.Struct, frozen=True):
    """One reading of a link's gauges."""

    sent: int
    """[bytes] handed to the system."""
    received: int
    """[bytes] handed to the handler."""
    waiting: int
    """[bytes] that the far end has not made room for."""
    superseded: int
    """Telemetry frames that a newer one of their topic replaced while they waited."""
    dropped: int
    """Frames that were sent after the end of the link."""


class Unsealed(Protocol):
    """A frame that is finished when it leaves, such as a `robotree.protocol.draft.Draft`."""

    def __len__(self) -> int:
        """[bytes] that it will have."""
        ...

    def seal(self) -> bytes:
        """The whole frame. Called once, in the order in which frames leave; never for one that does not."""
        ...


def sealed(frame: bytes | Unsealed) -> bytes:
    """The bytes of a frame that leaves now."""
    return frame if isinstance(frame, bytes) else frame.seal()


class Link(Protocol):
    """One end of an open link."""

    @property
    def address(self) -> str:
        """Names the link for people: scheme, and whom it leads to."""
        ...

    @property
    def congested(self) -> bool:
        """Whether frames wait for the far end; what can be left out (a picture) should be."""
        ...

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        ...

    def send(self, frame: bytes | Unsealed, topic: Hashable | None = None) -> None:
        """Send one whole frame, or queue it. Never blocks, never raises; after the end it only counts.

        Args:
            frame: one whole frame, or one that is sealed when it leaves.
            topic: None: must arrive or the link ends. Else telemetry: while it waits, a newer frame of the
                same topic takes its place.
        """
        ...

    def close(self) -> None:
        """End the link; the handler is told. What waits may be lost. Harmless when repeated."""
        ...


@runtime_checkable
class Pausable(Protocol):
    """A link whose far end can be made to wait. Datagrams and frames on a bus come when they come."""

    def pause_reading(self) -> None:
        """Read no more; what the far end sends waits with it. Harmless when repeated, and after the end."""
        ...

    def resume_reading(self) -> None:
        """Read on. Harmless when repeated, and after the end."""
        ...


class Handler(Protocol):
    """Hears a link."""

    def received(self, data: bytes) -> None:
        """Some bytes came, cut anywhere."""
        ...

    def closed(self, reason: LinkError) -> None:
        """The link ended; told exactly once, and nothing is told after it."""
        ...


Accept = Callable[[Link], Handler]
"""Called with every link that opens, before any byte is told; what it returns hears the link.

It may send and close at once; then what it returns is told of the end, once, and of nothing else."""


def handler_of(link: Link, accept: Accept) -> Handler:
    """Return who hears a link that has just opened; nobody is left with an open link that nobody hears."""
    try:
        return accept(link)
    except BaseException:
        link.close()
        raise


class Listener(Protocol):
    """Waits for links from outside."""

    @property
    def address(self) -> str:
        """What others pass to `connect`, with the port that was really taken."""
        ...

    @property
    def links(self) -> frozenset[Link]:
        """The links that are open now."""
        ...

    async def close(self) -> None:
        """Listen no more and end all links."""
        ...
