"""A link: a way for bytes in both directions, with callbacks.

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


class Unsent(Protocol):
    """A frame that is completed when it is sent, such as a `robotree.protocol.endpoint.UnsentFrame`."""

    def __len__(self) -> int:
        """[bytes] that it will have."""
        ...

    def encode(self) -> bytes:
        """The whole frame. Called once, in the order of sending; not called for a frame that is not sent."""
        ...


def encoded(frame: bytes | Unsent) -> bytes:
    """The bytes of a frame that is sent now."""
    return frame if isinstance(frame, bytes) else frame.encode()


class Link(Protocol):
    """One end of an open link."""

    controller: str
    """Name of the controller at one of the two ends, by which its key is found: the address where it listens,
    or what the option `controller` of the link's URL says. A serial line has another address at each end."""

    @property
    def address(self) -> str:
        """Name of the link for people: scheme, and address of the far end."""
        ...

    @property
    def congested(self) -> bool:
        """Whether frames wait for the far end; what can be left out (a picture) should be."""
        ...

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        ...

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        """Send one whole frame, or queue it. Never blocks, never raises; after the end it only counts.

        Args:
            frame: one whole frame, or one that is completed when it is sent.
            topic: None: must arrive or the link ends. Else telemetry: while it waits, a newer frame of the
                same topic takes its place.
        """
        ...

    def close(self) -> None:
        """End the link; its handler is called. Waiting frames may be lost. May be repeated."""
        ...


@runtime_checkable
class Pausable(Protocol):
    """A link whose far end can be made to wait; datagrams and frames on a bus cannot."""

    def pause_reading(self) -> None:
        """Stop reading; what the far end sends waits there. May be repeated, also after the end."""
        ...

    def resume_reading(self) -> None:
        """Read again. May be repeated, also after the end."""
        ...


class Handler(Protocol):
    """Receives the bytes and the end of a link."""

    def received(self, data: bytes) -> None:
        """Some bytes came, cut anywhere."""
        ...

    def closed(self, reason: LinkError) -> None:
        """The link ended; called exactly once, and last."""
        ...


Accept = Callable[[Link], Handler]
"""Called with every link that opens, before its first byte; returns the link's handler.

It may send and close at once; then only `closed` of the handler is called."""


def handler_of(link: Link, accept: Accept) -> Handler:
    """The handler of a link that has just opened; the link is closed if `accept` fails."""
    try:
        return accept(link)
    except BaseException:
        link.close()
        raise


class Listener(Protocol):
    """Accepts links from outside."""

    @property
    def address(self) -> str:
        """The address that others pass to `connect`, with the port that was really taken."""
        ...

    @property
    def links(self) -> frozenset[Link]:
        """The links that are open now."""
        ...

    async def close(self) -> None:
        """Listen no more and end all links."""
        ...
