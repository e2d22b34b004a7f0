"""Two links joined by a bad cable. Pure: `now` is an argument, the links are handed in."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.links.loopback import Faults, Loopback, LoopbackEnd
from robotree.protocol.tools.capture.framing import Splitter
from robotree.protocol.tools.capture.replay import carries_secret

if TYPE_CHECKING:
    from robotree.protocol.errors import LinkError
    from robotree.protocol.links.link import Link

MOST_EARLY = 4096
"""Frames that wait for a link that is still being opened; older ones are lost."""

_OTHER = {"near": "far", "far": "near"}


class Traffic(msgspec.Struct, frozen=True):
    """The frames that went in at one side of a joint, and those that left it at the other."""

    taken: int
    """Frames."""
    passed: int
    """Frames; more than were taken if some were passed twice."""
    withheld: int = 0
    """Frames among the taken ones that carry a secret; they are never passed on."""


class _Outlet:
    """Where frames leave the cable."""

    def __init__(self) -> None:
        self.link: Link | None = None
        self.early: deque[bytes] = deque(maxlen=MOST_EARLY)
        self.passed = 0

    def received(self, data: bytes) -> None:
        self.passed += 1
        if self.link is None:
            self.early.append(data)
        else:
            self.link.send(data)

    def closed(self, reason: LinkError) -> None:
        """The cable never ends by itself."""

    def open(self, link: Link) -> None:
        self.link = link
        while self.early:
            link.send(self.early.popleft())


class _Inlet:
    """Where bytes are cut at frames and put into the cable."""

    def __init__(self, end: LoopbackEnd) -> None:
        self._end = end
        self._splitter = Splitter()
        self.taken = self.withheld = 0

    def take(self, data: bytes, *, lose: bool) -> None:
        for piece in self._splitter.feed(data):
            self.taken += 1
            if piece.framed and carries_secret(piece.data):
                self.withheld += 1
            elif not lose:
                self._end.send(piece.data)


class FaultyCable:
    """Joins a near and a far link, with faults.

    Args:
        faults: what happens on the way; may be changed while it runs.
        now: [s], of the clock that all other calls use.
        silent_until: [s] of the same clock; before it everything is lost.
    """

    def __init__(self, faults: Faults, now: float, silent_until: float = 0.0) -> None:
        self._outlets = {"near": _Outlet(), "far": _Outlet()}
        self._loopback = Loopback(
            lambda _: self._outlets["near"], lambda _: self._outlets["far"], faults, now
        )
        self._inlets = {"near": _Inlet(self._loopback.near), "far": _Inlet(self._loopback.far)}
        self._silent_until = silent_until

    @property
    def faults(self) -> Faults:
        """The faults on the way."""
        return self._loopback.faults

    @faults.setter
    def faults(self, faults: Faults) -> None:
        self._loopback.faults = faults

    @property
    def due(self) -> float | None:
        """When to call `advance`, [s]; None: nothing is under way."""
        return self._loopback.due

    @property
    def traffic(self) -> dict[str, Traffic]:
        """The frames that went in, by side."""
        return {
            side: Traffic(one.taken, self._outlets[_OTHER[side]].passed, one.withheld)
            for side, one in self._inlets.items()
        }

    def open(self, side: str, link: Link) -> None:
        """A side has its link; what arrived for it already is sent."""
        self._outlets[side].open(link)

    def take(self, side: str, data: bytes, now: float) -> None:
        """Some bytes came from a side: put them on their way, and deliver what is due."""
        self._loopback.advance(now)
        self._inlets[side].take(data, lose=now < self._silent_until)
        self._loopback.advance(now)

    def cut(self, until: float) -> None:
        """Lose everything that comes before `until` [s], as if the cable were pulled."""
        self._silent_until = until

    def advance(self, now: float) -> None:
        """Deliver what is due."""
        self._loopback.advance(now)
