"""A relay: for each link that comes, one is opened to the other program, and a bad cable joins the two."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import LinkError
from robotree.protocol.links.loopback import Faults, Loopback, LoopbackEnd
from robotree.protocol.links.url import connect, listen, parse
from robotree.protocol.tools.capture.framing import Splitter
from robotree.protocol.tools.capture.replay import carries_secret

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable

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


class _Side:
    """Hears one link of a pair."""

    def __init__(self, pair: _Pair, name: str) -> None:
        self._pair, self._name = pair, name

    def received(self, data: bytes) -> None:
        self._pair.take(self._name, data)

    def closed(self, reason: LinkError) -> None:  # noqa: ARG002  whatever ended one ends both
        self._pair.close()


class _Pair:
    """A link that came and the one that was opened for it."""

    def __init__(self, relay: Relay, near: Link, faults: Faults, silent_until: float) -> None:
        self._relay = relay
        self._loop = asyncio.get_running_loop()
        self.cable = FaultyCable(faults, self._loop.time(), silent_until)
        self._links = [near]
        self._timer: asyncio.TimerHandle | None = None
        self._over = False
        self.cable.open("near", near)
        self._opening = self._loop.create_task(self._open(), name=f"relay for {near.address}")

    async def _open(self) -> None:
        try:
            far = await connect(self._relay.target, lambda _: _Side(self, "far"))
        except LinkError as error:
            self._relay.refuse(error)
            self.close()
            return
        self._relay.joined += 1
        if self._over:
            far.close()
            return
        self._links.append(far)
        self.cable.open("far", far)

    def take(self, side: str, data: bytes) -> None:
        self.cable.take(side, data, self._loop.time())
        self._schedule()

    def _schedule(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due = self.cable.due
        self._timer = None if due is None or self._over else self._loop.call_at(due, self._wake)

    def _wake(self) -> None:
        # The loop may wake a little early, by the resolution of its clock.
        self.cable.advance(max(self._loop.time(), self.cable.due or 0.0))
        self._schedule()

    def close(self) -> None:
        if not self._over:
            self._over = True
            if self._timer is not None:
                self._timer.cancel()
            for link in self._links:
                link.close()
            self._relay.forget(self)


class Relay:
    """Stands between others. Made by `relaying`.

    Args:
        target: where to connect for everyone who comes.
        faults: what happens on the way.
    """

    def __init__(self, target: str, faults: Faults) -> None:
        self.target = target
        self._accidents = faults
        self._silent_until = 0.0  # kept here, for who comes during a cut is cut, too
        self._pairs: list[_Pair] = []
        self._met = 0
        self._ended: dict[str, Traffic] = {side: Traffic(0, 0) for side in ("near", "far")}
        self.refused = 0
        """Links for which none could be opened to the target."""
        self.joined = 0
        """Links that were joined with one to the target."""
        self.on_refused: Callable[[LinkError], None] = lambda _: None
        """Told why none could be opened."""
        self.address = ""
        """Where it listens."""

    def accept(self, link: Link) -> _Side:
        """Somebody has come."""
        seed = self._accidents.seed + self._met
        faults = msgspec.structs.replace(self._accidents, seed=seed)
        pair = _Pair(self, link, faults, self._silent_until)
        self._met += 1
        self._pairs.append(pair)
        return _Side(pair, "near")

    @property
    def faults(self) -> Faults:
        """The faults on the way; set them to change all links that run, and those that come."""
        return self._accidents

    @faults.setter
    def faults(self, faults: Faults) -> None:
        self._accidents = faults
        for pair in self._pairs:
            pair.cable.faults = faults

    @property
    def traffic(self) -> dict[str, Traffic]:
        """The frames of all links, by the side they came from: `near` dialled the relay."""
        every = [self._ended, *(pair.cable.traffic for pair in self._pairs)]
        return {side: _sum([one[side] for one in every]) for side in ("near", "far")}

    def cut(self, duration: float) -> None:
        """Lose everything for `duration` [s], also of those who come meanwhile; the links stay open."""
        self._silent_until = asyncio.get_running_loop().time() + duration
        for pair in self._pairs:
            pair.cable.cut(self._silent_until)

    @property
    def cut_left(self) -> float:
        """How long everything is still lost, [s]."""
        return max(self._silent_until - asyncio.get_running_loop().time(), 0.0)

    def end(self) -> None:
        """End all links that run; others may come."""
        for pair in [*self._pairs]:
            pair.close()

    def refuse(self, reason: LinkError) -> None:
        """No link could be opened to the target."""
        self.refused += 1
        self.on_refused(reason)

    def forget(self, pair: _Pair) -> None:
        """A pair has ended."""
        self._ended = {side: _sum([self._ended[side], one]) for side, one in pair.cable.traffic.items()}
        if pair in self._pairs:
            self._pairs.remove(pair)


def _sum(parts: list[Traffic]) -> Traffic:
    return Traffic(
        sum(part.taken for part in parts),
        sum(part.passed for part in parts),
        sum(part.withheld for part in parts),
    )


@asynccontextmanager
async def relaying(url: str, target: str, faults: Faults, *, exposed: bool = False) -> AsyncGenerator[Relay]:
    """A relay that is up inside the block.

    Args:
        url: where to listen.
        target: where to connect for everyone who comes.
        faults: what happens on the way.
        exposed: allow an address that other machines reach.

    Yields:
        The relay.

    Raises:
        BadUrl: the target means nothing.
        LinkError: the address cannot be listened on.
    """
    parse(target)
    relay = Relay(target, faults)
    listener = await listen(url, relay.accept, exposed=exposed)
    relay.address = listener.address
    try:
        yield relay
    finally:
        relay.end()
        await listener.close()
