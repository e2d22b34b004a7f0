"""How much a robot and each of its peers have to do with each other: calls and bytes a second.

Each call weighs less with its age, with `FADES`: the sum of the weights, divided by the sum that one call a
second would have since the first one, is the rate. So a robot that has only begun has a rate at once, and one
that has ended something has none any more soon after.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import NamedTuple

FADES = 10.0
"""[s] in which what was counted weighs 1/e."""
LEAST_SPAN = 1.0
"""[s] over which a rate is taken at least: two calls at once are no thousand a second."""
FORGOTTEN = 0.01
"""Weight below which a peer is as if it had never been there."""
MOST_PEERS = 256
"""Peers that are counted; the one that was heard longest ago makes room."""


class Flow(NamedTuple):
    """What goes to and fro between a robot and a peer."""

    calls: float
    """[1/s]"""
    size: float
    """[bytes/s] Of requests and replies, renewals too."""


NO_FLOW = Flow(0.0, 0.0)


class _Meter:
    """The counts of one peer."""

    __slots__ = ("at", "calls", "since", "size")

    def __init__(self, now: float) -> None:
        self.since, self.at = now, now
        self.calls, self.size = 0.0, 0.0

    def fade(self, now: float) -> None:
        """Let what was counted weigh less."""
        left = math.exp(min(self.at - now, 0.0) / FADES)
        self.calls, self.size, self.at = self.calls * left, self.size * left, max(self.at, now)

    def span(self, now: float) -> float:
        """[s] of which a rate is the mean."""
        return FADES * -math.expm1(-max(now - self.since, LEAST_SPAN) / FADES)


class BondTraffic:
    """See the module."""

    def __init__(self, now: Callable[[], float], lock: AbstractContextManager[object]) -> None:
        """Begin with nothing.

        Args:
            now: [s] on any monotonic clock.
            lock: held for moments.
        """
        self._now, self._lock = now, lock
        self._meters: dict[str, _Meter] = {}

    def carried(self, peer: str, size: int) -> None:
        """Count so many bytes that went to a peer, or came from it, now."""
        self.note(peer, self._now(), size=size)

    def note(self, peer: str, now: float, *, calls: int = 0, size: int = 0) -> None:
        """Count. From any thread.

        Args:
            peer: key of who is called, or calls.
            now: [s]
            calls: how many.
            size: [bytes]
        """
        with self._lock:
            meter = self._meters.get(peer)
            if meter is None:
                if len(self._meters) >= MOST_PEERS:
                    del self._meters[min(self._meters, key=lambda key: self._meters[key].at)]
                meter = self._meters[peer] = _Meter(now)
            meter.fade(now)
            if calls and meter.calls < FORGOTTEN:
                meter.since = now
            meter.calls += calls
            meter.size += size

    def flows(self, now: float) -> dict[str, Flow]:
        """Return what goes to and fro between the robot and each peer, by key."""
        found: dict[str, Flow] = {}
        with self._lock:
            for peer, meter in self._meters.items():
                meter.fade(now)
                span = meter.span(now)
                calls = meter.calls if meter.calls >= FORGOTTEN else 0.0
                found[peer] = Flow(calls / span, meter.size / span)
        return found
