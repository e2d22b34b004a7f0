"""Stops and resumes as one robot carries them out: itself first or last, those below it, and what is told."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from robotree.vr.address import Address
from robotree.vr.agents.commands import CommandDesk
from robotree.vr.agents.hooks import STILL_STOPPING, Confirming, Hooks
from robotree.vr.agents.lease import LeaseKeeper
from robotree.vr.confirmation import Budget, Confirmations
from robotree.vr.errors import NoAnswer
from robotree.vr.requests import Done, Reply, Resume, SafeStop
from robotree.vr.robot import Robot

MOST_ORDERS = 64
"""Stops in force that are remembered by their order; a copy of an older one counts as a new stop."""


class Stopping:
    """Stops one robot and releases it. Lives on the event loop."""

    def __init__(
        self,
        robot: Robot,
        address: Address,
        lease: LeaseKeeper,
        desk: CommandDesk,
        *,
        on_change: Callable[[], None],
    ) -> None:
        """Begin.

        Args:
            robot: that is stopped.
            address: of its agent.
            lease: knows who may release it.
            desk: its commands, and its children if it is a virtual robot.
            on_change: told when it is stopped or released.
        """
        self._robot, self._address, self._lease, self._desk = robot, address, lease, desk
        self._on_change, self._hooks = on_change, Hooks(robot)
        self._orders: dict[str, asyncio.Task[tuple[str, ...]]] = {}
        """The answers to the stops in force, by the order that they are part of."""
        self._releases = 0
        """How many resumes wait for what stands behind the robot."""

    async def safe_stop(self, request: SafeStop) -> Reply:
        """Stop now; answer when everything below has confirmed it, or when the time is over.

        Who orders a stop tells all robots of a tree at once, and each passes it on. Such a copy of an order
        that is obeyed already waits for the same answer: to stop again would be as much work as there are
        ways to the robot, and would count as a new stop.

        Raises:
            NotConfirmed: not everything below has confirmed it.
        """
        budget = self._budget(request.within)
        answer = self._orders.get(request.order) if self._desk.ordered else None
        if answer is None:
            return Done(told=await asyncio.shield(self._begin(request, budget)))
        done, _ = await asyncio.wait([answer], timeout=budget.within)
        if not done:  # the copy before this one has more time
            raise NoAnswer(key=self._address.key, seconds=budget.within)
        return Done(told=answer.result())

    async def resume(self, request: Resume) -> Reply:
        """Release those below first: nobody may use a child that is still stopped.

        Raises:
            NotConfirmed: not everything is released.
            LeaseError: whoever asks may not command the robot.
        """
        name, desk, began = self._robot.name, self._desk, _now()
        budget = self._budget(request.within)
        self._lease.check(request.epoch)
        confirmations, stops = Confirmations("the resume"), self._stops_seen(request)
        if stops == desk.stops and not await self._hooks.has_stopped(budget.wait / 2):
            confirmations.deny(name, STILL_STOPPING)
        if desk.bonds is not None and stops == desk.stops and confirmations.complete:
            await desk.bonds.resume(request.seen, confirmations, budget, waited=_now() - began)
            self._lease.check(request.epoch)  # once more: what was awaited may have taken time
        allowed = stops == desk.stops and confirmations.complete
        doubt = await self._release_own(budget.wait - (_now() - began)) if allowed else ""
        if stops != desk.stops:
            confirmations.deny(name, "it was stopped again after that had been asked for")
        elif not confirmations.complete:
            if not confirmations.names(name):
                confirmations.deny(name, "it waits for those below it")
        else:
            self._take_own(confirmations, doubt)
            if not doubt:
                desk.ordered = ""
                self._orders.clear()
                self._on_change()
        return Done(told=tuple(confirmations.settle()))

    # -- inside -----------------------------------------------------------------------------------

    def _budget(self, within: float) -> Budget:
        bonds = self._desk.bonds
        return Budget(within) if bonds is None else Budget(within, depth=bonds.depth, ways=bonds.ways)

    def _begin(self, request: SafeStop, budget: Budget) -> asyncio.Task[tuple[str, ...]]:
        if not self._desk.ordered:
            self._orders.clear()  # those before the last release
        reason = request.reason or "protective stop"
        self._desk.stop(reason)
        confirming = self._hooks.safe_stop(reason)
        self._on_change()
        answer = asyncio.ensure_future(self._confirmed(confirming, reason, request.order, budget))
        if request.order:
            self._orders[request.order] = answer
            while len(self._orders) > MOST_ORDERS:
                del self._orders[next(iter(self._orders))]
        return answer

    async def _confirmed(
        self, confirming: Confirming, reason: str, order: str, budget: Budget
    ) -> tuple[str, ...]:
        confirmations, own, bonds = Confirmations("the protective stop"), budget.wait, self._desk.bonds
        if bonds is None:
            doubt = await confirming.doubt(own)
        else:
            below = bonds.safe_stop(reason, order, confirmations, budget)
            doubt, _ = await asyncio.gather(confirming.doubt(own), below)
        self._take_own(confirmations, doubt)
        return tuple(confirmations.settle())

    async def _release_own(self, within: float) -> str:
        """Release what stands behind the robot, within [s]; return why that is not confirmed, or nothing."""
        if not (self._desk.stopped or self._releases):
            return ""  # nobody has stopped it: what is offline need not confirm that
        self._releases += 1
        try:
            return await self._hooks.resume().doubt(within)
        finally:
            self._releases -= 1

    def _stops_seen(self, request: Resume) -> int:
        """How many stops whoever resumes knows of; all, where it does not say so or none is in force."""
        if request.seen is None or not self._desk.stopped:
            return self._desk.stops
        return request.seen.get(self._address.key, 0)

    def _take_own(self, confirmations: Confirmations, doubt: str) -> None:
        if doubt:
            offline = "" if self._robot.online else "it is offline, and "
            confirmations.deny(self._robot.name, f"{offline}{doubt}")
        else:
            confirmations.take(self._robot.name, ())


def _now() -> float:
    return asyncio.get_running_loop().time()
