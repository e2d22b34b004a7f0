"""A protective stop across sites: one order for each, which its gateway carries out on its own robots.

It never claims more than it knows. The sites that belong to the realm are known durably (`keys.py`), so one
that is silent, or whose gateway has not been heard since this one began, is named as not reached.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable, Sequence

from robotree.vr.base.errors import NoSuchRobot, NotConfirmed, VrError
from robotree.vr.base.requests import Done, SafeStop
from robotree.vr.core.confirmation import Confirmations
from robotree.vr.sites.frames import SiteStopped, StopSite
from robotree.vr.sites.keys import RealmKeys
from robotree.vr.sites.sealing import Lane
from robotree.vr.sites.site import Site, WaysToSites

StopHere = Callable[[str, str], Awaitable[SiteStopped]]
"""Stops all robots of this machine, for an order and a reason; the number in the answer is 0."""

REMEMBERED = 64
"""Orders of which it is remembered what came of them."""


class SiteStops:
    """See the module. On the event loop."""

    def __init__(self, gateway: WaysToSites, keys: RealmKeys, stop_here: StopHere) -> None:
        """Begin with none.

        Args:
            gateway: the way to the sites.
            keys: knows which sites belong to the realm.
            stop_here: stops the robots of this machine.
        """
        self._gateway, self._keys, self._stop_here = gateway, keys, stop_here
        self._numbers = itertools.count(1)
        self._awaited: dict[int, tuple[str, asyncio.Future[SiteStopped]]] = {}
        """By number: the site, and its answer."""
        self._orders: dict[str, asyncio.Future[SiteStopped]] = {}
        """What is carried out here, or was, by order."""

    # -- from this machine to the sites -----------------------------------------------------------

    async def stop_sites(self, stop: SafeStop) -> Done:
        """Stop the robots of all other sites.

        Raises:
            NotConfirmed: a robot has not confirmed it, or a site was not reached; names both.
        """
        names = sorted({site.name for site in self._keys.sites()})
        confirmations, asked = Confirmations("the protective stop"), dict[str, asyncio.Future[SiteStopped]]()
        for name in names:
            number = next(self._numbers)
            site, future = self._gateway.sites.get(name), asyncio.get_running_loop().create_future()
            if site is None or not self._gateway.send(
                site, StopSite(number, stop.order, stop.reason), Lane.URGENT
            ):
                self._miss(confirmations, name)
                continue
            self._awaited[number] = name, future
            asked[name] = future
        if asked:
            await asyncio.wait(asked.values(), timeout=max(stop.within, 0.01))
        for number in [number for number, (_, future) in self._awaited.items() if future in asked.values()]:
            del self._awaited[number]
        for name, future in asked.items():
            if not future.done() or future.cancelled():
                self._miss(confirmations, name)
                continue
            stopped = future.result()
            for robot in stopped.confirmed:
                confirmations.confirm(_there(name, robot))
            for robot, reason in stopped.missed:
                confirmations.deny(_there(name, robot), reason)
            for advice in stopped.advice:
                confirmations.advise(f"at site {name}: {advice}")
        return Done(confirmed=tuple(confirmations.settle()))

    def _miss(self, confirmations: Confirmations, name: str) -> None:
        site = self._gateway.sites.get(name)
        reason = self._gateway.reason()
        if not reason and (site is None or site.stream is None):
            reason = "its gateway is not heard"
        elif not reason and site is not None:
            silence = site.silence(self._gateway.now())
            reason = f"no answer from its gateway, which was heard {silence:.1f} s ago"
        remedy = f"see that `robotree gateway` runs at site {name}, or stop its robots there"
        confirmations.miss(f"site {name}", f"not reached: {reason}", remedy)

    def take_answer(self, site: Site, stopped: SiteStopped) -> None:
        """Take what came of an order at a site."""
        name, future = self._awaited.get(stopped.number, ("", None))
        if future is not None and name == site.name and not future.done():
            future.set_result(stopped)

    def lost(self, site: Site) -> None:
        """A site has gone: its answers come no more."""
        for name, future in self._awaited.values():
            if name == site.name and not future.done():
                future.cancel()

    # -- from a site to this machine --------------------------------------------------------------

    def carry_out(self, site: Site, order: StopSite) -> None:
        """Stop the robots of this machine, once for each order, and answer the site."""
        running = self._orders.get(order.order) if order.order else None
        if running is None:
            running = asyncio.ensure_future(self._stop_here(order.order, order.reason))
            self._orders[order.order] = running
            while len(self._orders) > REMEMBERED:
                del self._orders[next(iter(self._orders))]

        def over(future: asyncio.Future[SiteStopped]) -> None:
            if not future.cancelled() and future.exception() is None:
                found = future.result()
                answer = SiteStopped(order.number, found.confirmed, found.missed, found.advice)
                self._gateway.send(site, answer, Lane.URGENT)

        running.add_done_callback(over)


def _there(site: str, robot: str) -> str:
    """Return a robot's name with its site; where two sites have the name, it has one already."""
    return robot if ":" in robot else f"{site}:{robot}"


def came_of(answer: Sequence[str] | VrError) -> SiteStopped:
    """Return what to tell another site of a stop that was carried out here.

    Args:
        answer: names of those that have confirmed, or the error that names the others.
    """
    if isinstance(answer, NotConfirmed):
        missed = [(name, reason) for name, reason in answer.data["untold"]]
        return SiteStopped(0, list(answer.data["told"]), missed, list(answer.data["advice"]))
    if isinstance(answer, NoSuchRobot):
        return SiteStopped(0, [], [], [])
    if isinstance(answer, VrError):
        return SiteStopped(0, [], [("its robots", str(answer))], [])
    return SiteStopped(0, list(answer), [], [])
