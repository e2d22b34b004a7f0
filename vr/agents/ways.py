"""How far others are from this process: round trips, measured by questions that take no work.

A robot is asked for lines of its log that do not exist yet, a host for its description, which it needs to
know anyway. What is measured is what a call takes beside its work: both ways, and the turn of both processes.
Smoothed as TCP does (RFC 6298: 1/8); a way that has become much longer or shorter is believed the second
time. Lives on the event loop.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterable

from robotree.vr.agents.shared import loop_now
from robotree.vr.base.address import Address
from robotree.vr.base.errors import NoHostBeside, VrError
from robotree.vr.base.places import Places
from robotree.vr.base.presence import Presence
from robotree.vr.base.requests import ANSWER_WITHIN, DescribeHost, HostDescribed, Logged, ReadLog
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask

FRESH = 2.0
"""[s] for which a measurement is good."""
SMOOTHING = 1 / 8
"""Weight of a new measurement."""
CHANGED = 2.0
"""Factor by which a measurement differs that tells of another way, and not of chance."""
MOST = 256
"""Agents to which ways are remembered."""
AT_ONCE = 64
"""Agents to which the ways are measured for one who asks."""
_BEYOND = sys.maxsize
"""Number of a line that no log has."""


class _Way:
    """The way to one agent."""

    def __init__(self) -> None:
        self.round_trip = self.at = self.doubtful = 0.0

    def take(self, sample: float, now: float) -> None:
        """Take a measurement [s]."""
        known, before, self.doubtful, self.at = self.round_trip, self.doubtful, 0.0, now
        if not known:
            self.round_trip = sample
        elif known / CHANGED < sample < known * CHANGED:
            self.round_trip += (sample - known) * SMOOTHING
        elif before and (before > known) == (sample > known):
            self.round_trip = min(before, sample)
        else:
            self.doubtful = sample


class Ways:
    """See the module."""

    def __init__(self, transport: Transport, sender: str) -> None:
        """Know none.

        Args:
            transport: the way to the others.
            sender: key of who asks.
        """
        self._transport, self._sender = transport, sender
        self._known: dict[str, _Way] = {}
        self._asking: dict[str, asyncio.Task[HostDescribed | None]] = {}

    def round_trips(self, keys: Iterable[str]) -> dict[str, float]:
        """Return the ways [s] that are known, by key."""
        return {key: way.round_trip for key in keys if (way := self._known.get(key)) and way.round_trip}

    async def measure(self, keys: Iterable[str]) -> dict[str, float]:
        """Return the ways [s] to agents, by key; who does not answer is missing."""
        keys, now = list(dict.fromkeys(keys))[:AT_ONCE], loop_now()
        stale = [key for key in keys if key not in self._known or now - self._known[key].at > FRESH]
        await asyncio.gather(*map(self.ask, stale))
        return self.round_trips(keys)

    async def ask(self, key: str, ways_to: tuple[str, ...] = ()) -> HostDescribed | None:
        """Measure the way to an agent now; of a host, return what it says of itself.

        Args:
            key: of the agent.
            ways_to: keys of agents to which a host is to measure; then its answer says nothing of the way.
        """
        if ways_to:
            return await self._asked(key, ways_to)
        if key not in self._asking:
            task = self._asking[key] = asyncio.ensure_future(self._asked(key, ()))
            task.add_done_callback(lambda _: self._asking.pop(key, None))
        return await asyncio.shield(self._asking[key])

    async def _asked(self, key: str, ways_to: tuple[str, ...]) -> HostDescribed | None:
        began, host = loop_now(), key.startswith("host/")
        question = DescribeHost(ways_to=ways_to) if host else ReadLog(after=_BEYOND)
        within = 2 * ANSWER_WITHIN if ways_to else ANSWER_WITHIN
        try:
            answer: HostDescribed | Logged = await ask(
                self._transport,
                key,
                question,
                HostDescribed if host else Logged,
                timeout=within,
                sender=self._sender,
            )
        except VrError:  # it has gone, or may not be seen from here: its way is not known
            if not ways_to:
                self._known.pop(key, None)
            return None
        if not ways_to:
            self._note(key, loop_now() - began)
        return answer if isinstance(answer, HostDescribed) else None

    def _note(self, key: str, sample: float) -> None:
        if key not in self._known and len(self._known) >= MOST:
            del self._known[min(self._known, key=lambda one: self._known[one].at)]
        self._known.setdefault(key, _Way()).take(sample, loop_now())


def host_beside(presence: Presence, robot: Address, host: str, home: str) -> str:
    """Return the host on which a robot lives, or one at its site; as `migrate` takes it.

    Args:
        presence: who is there.
        robot: its address.
        host: the name of its host, as it says itself; empty: it is a proxy, and lives on none.
        home: the name of the host of whom asks.

    Raises:
        NoHostBeside: there is no host at its site.
    """
    places = Places(presence)
    site = places.site_of(robot.key)
    if not host and not site:
        return home
    if not host:
        hosts = sorted(key.split("/")[1] for key in places.at("host", site))
        if not hosts:
            raise NoHostBeside(robot=robot.name, reason=f"no host is at site {site}")
        host = hosts[0]
    name = host.rpartition(":")[2]
    return f"{site}:{name}" if site else name
