"""The parent's side of its bonds, at work: children asked, bound and released, calls and orders passed on."""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from robotree.vr.address import Address
from robotree.vr.agents.bond_link import Link
from robotree.vr.agents.petition import Petitioner
from robotree.vr.bond import Slots
from robotree.vr.confirmation import LEAST, Budget, Confirmations
from robotree.vr.context import CommandContext
from robotree.vr.description import RobotDescription
from robotree.vr.errors import DeadlineExceeded, SlotEmpty, VrError
from robotree.vr.exchange.client import OnProgress, RobotClient
from robotree.vr.lease import DEFAULT_TERM
from robotree.vr.transport import Transport

FAREWELL = 2.0
"""[s] for a child to confirm its release; after that its lease runs out by itself."""

_log = logging.getLogger(__name__)


class BondKeeper:
    """Keeps all children of one virtual robot."""

    def __init__(
        self,
        parent: Address,
        slots: Slots,
        transport: Transport,
        *,
        lineage: Callable[[], tuple[str, ...]],
        on_change: Callable[[], None],
        term: float = DEFAULT_TERM,
    ) -> None:
        """Begin without children.

        Args:
            parent: the virtual robot.
            slots: its slots.
            transport: the way to the children.
            lineage: returns the names from the topmost ancestor down to the virtual robot.
            on_change: told when a slot or what is known of its child has changed.
            term: [s] asked of the children.
        """
        self._parent, self._slots, self._transport = parent, slots, transport
        self._lineage, self._on_change = lineage, on_change
        self._links: dict[str, Link] = {}
        self._closed = False
        self._endings: set[asyncio.Task[None]] = set()
        self._petitioner = Petitioner(parent, transport, lineage=lineage, term=term)

    # -- binding ----------------------------------------------------------------------------------

    async def enslave(self, slot: str, child: Address) -> None:
        """Bind a child to a slot.

        Raises:
            BondError: there is no such slot, it is occupied, or the child is of another kind.
            LeaseError: the child has another parent, or is an ancestor.
            TransportError: the child does not answer.
        """
        reserved = self._slots.begin(slot, child)
        client = RobotClient(self._transport, child)
        try:
            bond = await self._petitioner.ask(client, slot, reserved.spec.kind)
        except BaseException:
            self._slots.abort(slot)
            raise
        self._slots.bind(slot, bond)
        link = self._links[slot] = Link(
            slot,
            bond,
            client,
            parent=self._parent,
            transport=self._transport,
            lineage=self._lineage,
            on_change=self._on_change,
            on_loss=self._lose,
        )
        link.start()
        self._on_change()
        if self._closed:  # it was deleted meanwhile
            await self._free_if_bound(slot)

    async def free(self, slot: str) -> None:
        """Release the child in a slot; it is told, and else its lease runs out.

        Raises:
            BondError: there is no such slot, or it is empty.
        """
        bond = self._slots.free(slot)
        link = self._links[slot]
        self._end(link)
        with contextlib.suppress(VrError):
            await link.client.release(self._parent, bond.lease.epoch, timeout=FAREWELL)

    async def close(self) -> None:
        """Release all children, and take no more."""
        self._closed = True
        await asyncio.gather(*(self._free_if_bound(slot) for slot in self._slots.bonds()))
        await asyncio.gather(*self._endings)
        await self._petitioner.close(FAREWELL)

    async def _free_if_bound(self, slot: str) -> None:
        with contextlib.suppress(SlotEmpty):  # it was lost meanwhile
            await self.free(slot)

    def names(self) -> set[str]:
        """Return the names of the children, of those too that are just being asked."""
        return {child.name for child in self._slots.children()}

    @property
    def depth(self) -> int:
        """Levels of robots below: 1 with children that have none."""
        return max((1 + link.bond.depth for link in self._links.values()), default=0)

    @property
    def ways(self) -> float:
        """[s] that the ways down to the last of those below and back take together."""
        bonds = (link.bond for link in self._links.values())
        return max((bond.lease.round_trip + bond.ways for bond in bonds), default=0.0)

    def hurry(self) -> None:
        """Renew all leases now: the lineage has changed, and a cycle should be found at once."""
        for link in self._links.values():
            link.hurry.set()

    # -- using ------------------------------------------------------------------------------------

    async def call(
        self,
        slot: str,
        command: str,
        arguments: Mapping[str, Any],
        *,
        key: str,
        context: CommandContext,
        oneway: bool = False,
        on_progress: OnProgress | None = None,
    ) -> Any:
        """Call the child in a slot under the bond's epoch, within the deadline. See `Children.call`."""
        bond = self._slots.require(slot)
        link = self._links[slot]
        remaining = context.deadline_at - _now()
        if remaining <= 0:
            raise DeadlineExceeded(robot=self._parent.name, command=context.command)
        send = link.client.tell if oneway else partial(link.client.call, on_progress=on_progress)
        task = asyncio.ensure_future(
            send(
                command,
                arguments,
                deadline=remaining,
                epoch=bond.lease.epoch,
                caller=self._parent.name,
                key=key,
            )
        )
        try:
            await asyncio.wait((task, link.over), return_when=asyncio.FIRST_COMPLETED)
        finally:
            if not task.done():
                task.cancel()
        if task.done():
            return task.result()
        raise self._slots.emptiness(slot)

    async def describe(self, slot: str, *, having: str) -> RobotDescription:
        """Return the description of the child in a slot, asked anew if it lacks a command so far.

        Args:
            slot: the slot.
            having: name of the command.

        Raises:
            SlotEmpty: there is no child.
            TransportError: the child does not answer.
        """
        known = self._slots.require(slot).description
        spec = known.command(having)
        if spec is not None and spec.available:
            return known
        link = self._links[slot]
        link.hurry.set()  # the renewal's answer tells what is new, for good
        return await link.client.describe()

    async def safe_stop(self, reason: str, order: str, confirmations: Confirmations, budget: Budget) -> None:
        """Stop all children, at the same time.

        Args:
            reason: of the stop.
            order: that it is part of.
            confirmations: takes what they answer.
            budget: of time.
        """

        def stop(link: Link) -> Awaitable[Sequence[str]]:
            within = budget.below(link.bond.lease.round_trip)
            return link.client.safe_stop(reason, order=order, timeout=budget.wait, within=within)

        await _tell(self._links.values(), confirmations, stop)

    async def resume(
        self,
        seen: Mapping[str, int] | None,
        confirmations: Confirmations,
        budget: Budget,
        *,
        waited: float,
    ) -> None:
        """Release the stop of all children, at the same time.

        Args:
            seen: which stops; see `Resume.seen`.
            confirmations: takes what they answer.
            budget: of time.
            waited: [s] of it that are gone already.
        """
        links: list[Link] = []
        for link in self._links.values():
            if seen is None or link.bond.child.key in seen:
                links.append(link)
            else:
                confirmations.deny(link.bond.child.name, "whoever resumes has not seen it")

        def resume(link: Link) -> Awaitable[Sequence[str]]:
            lease = link.bond.lease
            within = budget.below(lease.round_trip, waited)
            timeout = max(budget.wait - waited, LEAST)
            return link.client.resume(epoch=lease.epoch, seen=seen, timeout=timeout, within=within)

        await _tell(links, confirmations, resume)

    def _end(self, link: Link) -> None:
        del self._links[link.slot]
        if task := link.end():
            self._endings.add(task)
            task.add_done_callback(self._endings.discard)
        self._on_change()

    def _lose(self, link: Link, reason: str) -> None:
        if self._slots.lose(link.slot, link.bond, reason):
            _log.warning("%s.%s lost its child: %s", self._parent.name, link.slot, reason)
            self._end(link)


async def _tell(
    links: Iterable[Link], confirmations: Confirmations, order: Callable[[Link], Awaitable[Sequence[str]]]
) -> None:
    told = list(links)
    answers = await asyncio.gather(*(order(link) for link in told), return_exceptions=True)
    for link, answer in zip(told, answers, strict=True):
        confirmations.take(link.bond.child.name, answer)


def _now() -> float:
    return asyncio.get_running_loop().time()
