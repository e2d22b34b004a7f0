"""Two ends of a link in one process, with seeded faults and a clock of its own.

Nothing arrives by itself: `Loopback.advance` moves the clock and delivers, in order of arrival, what is due
by then. The same seed and the same calls give the same faults.
"""

from __future__ import annotations

import heapq
import random
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError
from robotree.protocol.links.link import LinkStatistics, encoded

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.links.link import Accept, Handler, Unsent


class Faults(msgspec.Struct, frozen=True, kw_only=True):
    """The faults that may happen to a frame on its way."""

    loss: float = 0.0
    """Probability that it never arrives."""
    duplication: float = 0.0
    """Probability that it arrives twice."""
    delay: float = 0.0
    """[s] that every frame takes."""
    jitter: float = 0.0
    """[s] that it takes longer at most; with jitter, frames overtake each other."""
    seed: int = 0


class LoopbackEnd:
    """One end. Made by `Loopback`."""

    def __init__(self, network: Loopback, name: str) -> None:
        self._network = network
        self.address, self.controller = f"loop:{name}", "loop:"
        self.handler: Handler | None = None
        self.other: LoopbackEnd | None = None
        self._sent = self.arrived = self._dropped = 0

    @property
    def congested(self) -> bool:
        """Never: the far end always reads."""
        return False

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        return LinkStatistics(
            sent=self._sent, received=self.arrived, waiting=0, superseded=0, dropped=self._dropped
        )

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:  # noqa: ARG002  nothing ever waits
        """Send one whole frame on its way."""
        if self._network.open and self.other is not None:
            data = encoded(frame)
            self._sent += len(data)
            self._network.carry(data, self.other)
        else:
            self._dropped += 1

    def close(self) -> None:
        """End the link, for both ends at the next `advance`."""
        self._network.end({self: LinkClosed(self.address, by_us=True)}, LinkClosed(self.address, by_us=False))


class Loopback:
    """A pair of ends, `near` and `far`.

    Args:
        near: hears the near end.
        far: hears the far end.
        faults: what happens to frames on the way, both ways.
        now: where the clock starts, [s].
    """

    def __init__(self, near: Accept, far: Accept, faults: Faults | None = None, now: float = 0.0) -> None:
        self.faults = faults or Faults()
        self.now = now
        self.open = True
        self._random = random.Random(self.faults.seed)
        self._under_way: list[tuple[float, int, bytes, LoopbackEnd]] = []
        self._count = 0
        self._ending: list[tuple[LoopbackEnd, LinkError]] = []
        self.near, self.far = LoopbackEnd(self, "near"), LoopbackEnd(self, "far")
        self.near.other, self.far.other = self.far, self.near
        self.near.handler, self.far.handler = near(self.near), far(self.far)

    @property
    def due(self) -> float | None:
        """When the next frame arrives, on the clock of `advance`; None: nothing is under way."""
        return self._under_way[0][0] if self._under_way else None

    def carry(self, frame: bytes, to: LoopbackEnd) -> None:
        """Put a frame on its way."""
        a, chance = self.faults, self._random.random
        if chance() < a.loss:
            return
        for _ in range(2 if chance() < a.duplication else 1):
            self._count += 1
            arrival = self.now + a.delay + a.jitter * chance()
            heapq.heappush(self._under_way, (arrival, self._count, frame, to))

    def cut(self, cause: str = "the cable was pulled") -> None:
        """Break the link; what is under way is lost."""
        self.end({}, LinkBroken("loop:", cause))

    def end(self, special: dict[LoopbackEnd, LinkError], reason: LinkError) -> None:
        """End the link with a reason for each end."""
        if self.open:
            self.open = False
            self._under_way.clear()
            self._ending = [(each, special.get(each, reason)) for each in (self.near, self.far)]

    def advance(self, to: float | None = None) -> None:
        """Move the clock to a moment (None: leave it) and deliver what is due by then."""
        moment = self.now if to is None else to
        while self._under_way and self._under_way[0][0] <= moment:
            self.now, _, frame, end = heapq.heappop(self._under_way)
            end.arrived += len(frame)
            if end.handler is not None:
                end.handler.received(frame)
        self.now = moment
        ending, self._ending = self._ending, []
        for end, reason in ending:
            if end.handler is not None:
                end.handler.closed(reason)
