"""The parent's side of its bonds: children asked, bound, kept and released, and orders passed on to them.

Everything here runs on the event loop. A renewal is a task of its own, ahead of everything on the wire, and
may overlap with others: a slow way or a busy robot never makes it queue.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence

from robotree.vr.address import Address
from robotree.vr.core import events as on
from robotree.vr.core.bonds import Bond, Slots
from robotree.vr.core.confirmation import LEAST, Budget, Confirmations
from robotree.vr.core.lease import DEFAULT_TERM, Lessee
from robotree.vr.description import RobotDescription
from robotree.vr.errors import (
    CycleOfBonds,
    Garbled,
    LeaseError,
    NoSuchCommand,
    SlotEmpty,
    TransportError,
    Unreachable,
    VrError,
)
from robotree.vr.exchange.client import RobotClient, fresh_key
from robotree.vr.requests import Granted
from robotree.vr.running.live import LiveRobot
from robotree.vr.transport import Registration, Transport

FAREWELL = 2.0
"""[s] for a child to confirm its release; after that its lease runs out by itself."""
RECEIPT = 2.0
"""[s] for a child to confirm that a petition is taken back, before it is told again."""
RETRY = 0.2
"""[s] before a child that cannot be reached is told again that a petition is taken back."""
REUNION = 2.0
"""[s] for the link to a child that lives to come back: it is dialled at least once a second."""
TICK = 0.001
"""[s] Shorter waits are none."""

_log = logging.getLogger(__name__)

Lineage = Callable[[], tuple[str, ...]]
"""Returns the names from the topmost ancestor down to the parent."""


class Children:
    """Keeps all children of one virtual robot."""

    def __init__(
        self,
        live: LiveRobot,
        transport: Transport,
        *,
        lineage: Lineage,
        on_change: Callable[[], None],
        term: float = DEFAULT_TERM,
    ) -> None:
        """Begin without children.

        Args:
            live: the virtual robot.
            transport: the way to the children.
            lineage: of the virtual robot.
            on_change: called when a slot or what is known of its child has changed.
            term: [s] asked of the children.
        """
        self._live, self._transport = live, transport
        self._parent: Address = live.core.state.address
        self._lineage, self._on_change, self._term = lineage, on_change, term
        self._bonds: dict[str, _KeptBond] = {}
        self._retracting: set[asyncio.Task[None]] = set()
        self._endings: set[asyncio.Task[None]] = set()
        self._closed = False

    @property
    def _slots(self) -> Slots:
        return self._live.core.state.slots

    # -- binding ----------------------------------------------------------------------------------

    async def enslave(self, slot: str, child: Address) -> None:
        """Bind a child to a slot, or to one of a group.

        Raises:
            BondError: there is no such slot, it is occupied, or the child is of another kind.
            LeaseError: the child has another parent, or is an ancestor.
            TransportError: the child does not answer; it will be told that nobody heard, should it have
                agreed.
        """
        slot = self._slots.place(slot, child.name)
        self._live.post(on.Reserve(slot=slot, child=child))
        client = RobotClient(self._transport, child)
        key = fresh_key()
        try:
            bond = await self._ask(client, slot, key)
        except BaseException as error:
            self._live.post(on.Unreserve(slot=slot))
            if isinstance(error, TransportError) or not isinstance(error, VrError):
                self._retract(client, key)
            raise
        self._live.post(on.Bind(slot=slot, bond=bond))
        kept = self._bonds[slot] = _KeptBond(self, slot, bond, client)
        kept.start()
        self._on_change()
        if self._closed:  # the parent was deleted meanwhile
            await self._free_if_bound(slot)

    async def free(self, slot: str) -> None:
        """Release the child in a slot, or all of a group; it is told, and else its lease runs out.

        Raises:
            BondError: there is no such slot, or it is empty.
        """
        await asyncio.gather(*map(self._free, self._slots.filled(slot)))

    async def _free(self, slot: str) -> None:
        self._live.post(on.Free(slot=slot))
        kept = self._bonds[slot]
        self._end(kept)
        with contextlib.suppress(VrError):
            await kept.client.release(self._parent, kept.epoch, timeout=FAREWELL)

    async def close(self) -> None:
        """Release all children, and take no more."""
        self._closed = True
        await asyncio.gather(*(self._free_if_bound(slot) for slot in list(self._bonds)))
        await asyncio.gather(*self._endings)
        if self._retracting:
            _, late = await asyncio.wait(self._retracting, timeout=FAREWELL)
            for task in late:
                task.cancel()

    async def _free_if_bound(self, slot: str) -> None:
        with contextlib.suppress(SlotEmpty):  # it was lost meanwhile
            await self.free(slot)

    def lose(self, kept: _KeptBond, reason: str) -> None:
        """A child is lost."""
        if self._bonds.get(kept.slot) is kept:
            self._live.post(
                on.Lose(slot=kept.slot, child=kept.client.address, epoch=kept.epoch, reason=reason)
            )
            _log.warning("%s.%s lost its child: %s", self._parent.name, kept.slot, reason)
            self._end(kept)

    def _end(self, kept: _KeptBond) -> None:
        del self._bonds[kept.slot]
        if task := kept.end():
            self._endings.add(task)
            task.add_done_callback(self._endings.discard)
        self._on_change()

    # -- asking -----------------------------------------------------------------------------------

    async def _ask(self, client: RobotClient, slot: str, key: str) -> Bond:
        lineage, child = self._lineage(), client.address
        if child.name in lineage:
            raise CycleOfBonds(parent=self._parent.name, child=child.name, lineage=" > ".join(lineage))
        kind = self._slots[slot].spec.kind

        async def petition() -> tuple[float, Granted]:
            return _now(), await client.petition(
                self._parent, slot, kind=kind, lineage=lineage, term=self._term, key=key
            )

        try:
            sent, granted = await petition()
        except Unreachable:
            if not await self._lives(child.key):
                raise
            await self._reunion(child.key)
            sent, granted = await petition()  # the same one: a child that has granted it grants it again
        if granted.robot is None:
            raise Garbled(key=child.key, detail="it grants a lease but does not say who it is")
        lease = Lessee.begin(epoch=granted.epoch, term=granted.term, sent=sent, now=_now())
        return Bond(
            child=child, lease=lease, description=granted.robot, depth=granted.depth, ways=granted.ways
        )

    async def _lives(self, key: str) -> bool:
        """Whether somebody lives under a key, heard or not: after one of two hung, their link is gone."""
        return bool(await self._transport.silent(key) or await self._transport.present(key))

    async def _reunion(self, key: str) -> None:
        """Wait until the process that serves a key can be heard, or for long enough."""
        heard = asyncio.Event()
        watching = await self._transport.watch(key, lambda _, there: heard.set() if there else None)
        try:
            async with asyncio.timeout(REUNION):
                await heard.wait()
        except TimeoutError:
            return
        finally:
            await watching.close()

    def _retract(self, client: RobotClient, key: str) -> None:
        async def tell() -> None:
            latest = _now() + self._term  # then the lease is over, if there is one
            while _now() < latest:
                try:
                    await client.retract(self._parent, key, timeout=RECEIPT)
                except TransportError:
                    await asyncio.sleep(RETRY)
                else:
                    return

        task = asyncio.ensure_future(tell())
        self._retracting.add(task)
        task.add_done_callback(self._retracting.discard)

    # -- keeping ----------------------------------------------------------------------------------

    @property
    def depth(self) -> int:
        """Levels of robots below: 1 with children that have none."""
        return max((1 + bond.depth for bond in self._slots.bonds().values()), default=0)

    @property
    def ways(self) -> float:
        """[s] that the ways down to the last of those below and back take together."""
        bonds = self._slots.bonds().values()
        return max((bond.lease.round_trip + bond.ways for bond in bonds), default=0.0)

    def renew_now(self) -> None:
        """Renew all leases now: the lineage has changed, and a cycle should be found at once."""
        for kept in self._bonds.values():
            kept.hurry.set()

    async def describe(self, slot: str, command: str) -> RobotDescription:
        """Ask the child in a slot anew who it is.

        Raises:
            SlotEmpty: there is no child.
            NoSuchCommand: it lacks the command.
            TransportError: it does not answer.
        """
        bond = self._slots.require(slot)
        kept = self._bonds[slot]
        kept.hurry.set()
        description = await kept.client.describe()
        if description.command(command) is None:
            known = ", ".join(spec.name for spec in description.commands) or "none"
            raise NoSuchCommand(robot=description.name, command=command, known=known)
        lease = bond.lease
        self._live.post(
            on.Renewed(
                slot=slot,
                child=bond.child,
                epoch=lease.epoch,
                sent=lease.confirmed,
                term=lease.term,
                depth=bond.depth,
                ways=bond.ways,
                description=description,
            )
        )
        return description

    def lease_of(self, kept: _KeptBond) -> Lessee:
        """Return the lease of a bond in force."""
        bond = self._slots[kept.slot].bond
        assert bond is not None  # noqa: S101 # a bond ends together with what keeps it
        return bond.lease

    def note_renewal(self, kept: _KeptBond) -> None:
        """A request to prolong a lease leaves."""
        self._live.post(on.Renewing(slot=kept.slot, child=kept.client.address, epoch=kept.epoch))

    async def renew(self, kept: _KeptBond) -> None:
        """Prolong the lease of one child, or notice that it is lost."""
        sent, epoch, child = _now(), kept.epoch, kept.client.address
        try:
            granted = await kept.client.renew(
                self._parent, epoch, lineage=self._lineage(), timeout=kept.lease.term
            )
        except LeaseError as error:
            self.lose(kept, str(error))
        except Unreachable:
            with contextlib.suppress(VrError):
                if not await self._transport.present(child.key):
                    self.lose(kept, f"{child.name} has ended")
        except TransportError:
            pass  # the next one may get through
        except VrError as error:
            _log.warning("%s: renewal for %s: %s", self._parent.name, kept.slot, error)
        else:
            self._live.post(
                on.Renewed(
                    slot=kept.slot,
                    child=child,
                    epoch=epoch,
                    sent=sent,
                    term=granted.term,
                    depth=granted.depth,
                    ways=granted.ways,
                    description=granted.robot,
                )
            )
            if granted.robot is not None:
                self._on_change()

    async def watch(self, kept: _KeptBond) -> Registration:
        """Notice when a child's presence goes."""
        child = kept.client.address

        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a presence handler
            if not there:
                self.lose(kept, f"{child.name} has ended or cannot be reached")

        return await self._transport.watch(child.key, look)

    # -- orders -----------------------------------------------------------------------------------

    async def safe_stop(self, reason: str, order: str, confirmations: Confirmations, budget: Budget) -> None:
        """Stop all children, at the same time.

        Args:
            reason: of the stop.
            order: that it is part of.
            confirmations: takes what they answer.
            budget: of time.
        """

        def stop(kept: _KeptBond) -> Awaitable[Sequence[str]]:
            within = budget.below(kept.lease.round_trip)
            return kept.client.safe_stop(reason, order=order, timeout=budget.wait, within=within)

        await _tell(self._bonds.values(), confirmations, stop)

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
        chosen: list[_KeptBond] = []
        for kept in self._bonds.values():
            if seen is None or kept.client.address.key in seen:
                chosen.append(kept)
            else:
                confirmations.deny(kept.client.address.name, "whoever resumes has not seen it")

        def resume(kept: _KeptBond) -> Awaitable[Sequence[str]]:
            within = budget.below(kept.lease.round_trip, waited)
            timeout = max(budget.wait - waited, LEAST)
            return kept.client.resume(epoch=kept.epoch, seen=seen, timeout=timeout, within=within)

        await _tell(chosen, confirmations, resume)


class _KeptBond:
    """One bond in force, with what keeps it so."""

    def __init__(self, children: Children, slot: str, bond: Bond, client: RobotClient) -> None:
        self.slot, self.client, self.epoch = slot, client, bond.lease.epoch
        self.hurry = asyncio.Event()
        """Set to renew now."""
        self._children = children
        self._tasks: set[asyncio.Task[None]] = set()
        self._watching: Registration | None = None

    @property
    def lease(self) -> Lessee:
        """The lease, as long as the bond is in force."""
        return self._children.lease_of(self)

    def start(self) -> None:
        """Renew the lease and watch the child from now on."""
        self._spawn(self._keep())
        self._spawn(self._watch())

    def end(self) -> asyncio.Task[None] | None:
        """Keep it no more; returns what is left to be waited for."""
        for task in self._tasks - {asyncio.current_task()}:
            task.cancel()
        return None if self._watching is None else asyncio.ensure_future(self._watching.close())

    def _spawn(self, work: Awaitable[None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _keep(self) -> None:
        while (left := self.lease.expires - _now()) > TICK:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(min(max(self.lease.due - _now(), TICK), left)):
                    await self.hurry.wait()
            if self.hurry.is_set() or self.lease.due - _now() < TICK:
                self.hurry.clear()
                self._children.note_renewal(self)
                self._spawn(self._children.renew(self))
        self._children.lose(self, f"{self.client.address.name} did not answer for {self.lease.term:.3g} s")

    async def _watch(self) -> None:
        with contextlib.suppress(VrError):
            self._watching = await self._children.watch(self)


async def _tell(
    bonds: Iterable[_KeptBond],
    confirmations: Confirmations,
    order: Callable[[_KeptBond], Awaitable[Sequence[str]]],
) -> None:
    told = list(bonds)
    answers = await asyncio.gather(*(order(kept) for kept in told), return_exceptions=True)
    for kept, answer in zip(told, answers, strict=True):
        confirmations.take(kept.client.address.name, answer)


def _now() -> float:
    return asyncio.get_running_loop().time()
