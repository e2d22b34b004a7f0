"""The parent's side of its bonds: children asked, bound, kept and released, and orders passed on to them.

When a lease is to be renewed, and what an answer means for it, the core knows. A renewal goes ahead of
everything on the wire and may overlap with others: a slow way or a busy robot never makes it wait.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Sequence

from robotree.vr.agents.shared import Beside, loop_now
from robotree.vr.author.virtual_robot import VirtualRobot, slots_of
from robotree.vr.base.address import Address, everyone
from robotree.vr.base.description import RobotDescription, SlotSpec, offered
from robotree.vr.base.errors import (
    CycleOfBonds,
    Garbled,
    LeaseError,
    NoAnswer,
    NoSuchCommand,
    NothingHeld,
    NotPaused,
    SlotEmpty,
    TransportClosed,
    TransportError,
    Unreachable,
    VrError,
    WrongKind,
)
from robotree.vr.base.places import Places
from robotree.vr.base.presence import Undo
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import ANSWER_WITHIN, Granted, Petition, Raised, Renew, Reply, Resume
from robotree.vr.base.transport import Transport
from robotree.vr.core import events as on
from robotree.vr.core.bonds import DEFAULT_TERM, FRESH, RETURN, Bond, HeldLease, proof_of, seal_of
from robotree.vr.core.confirmation import HOPELESS, LEAST, Budget, Confirmations
from robotree.vr.core.machine import RobotState
from robotree.vr.exchange.asking import ask, fresh_key
from robotree.vr.exchange.client import RobotClient
from robotree.vr.running.robot_runtime import RobotRuntime

FAREWELL = 2.0
"""[s] for a child to confirm its release; after that its lease runs out by itself."""
RECEIPT = 2.0
"""[s] for a child to confirm that a petition is taken back, before the message is repeated."""
ENTRUSTED_WITHIN = 3.0
"""[s] for a child to confirm that it knows by what it knows the next process of its parent."""
RETRY = 0.2
"""[s] before that message is repeated to a child that cannot be reached."""
REUNION = 2.0
"""[s] for the link to a running child to come back: it is dialled at least once a second."""

_log = logging.getLogger(__name__)


class ChildKeeper:
    """Keeps all children of one virtual robot. Lives on the event loop, except `renew`."""

    def __init__(
        self,
        runtime: RobotRuntime,
        transport: Transport,
        *,
        term: float = DEFAULT_TERM,
    ) -> None:
        """Begin without children.

        Args:
            runtime: the virtual robot.
            transport: the way to the children; shows which of them live.
            term: [s] asked of the children.
        """
        self._runtime, self._transport, self._presence = runtime, transport, transport.presence
        self._parent = runtime.address
        self._term = term
        self._watching: dict[str, Undo] = {}
        """The children whose presence is watched, by slot."""
        self._retracting = Beside()
        self._returning: dict[str, asyncio.Task[None]] = {}
        """Those that bind a lost child again, by slot."""
        self._lives: dict[str, Undo] = {}
        """The robots whose lives are watched, by slot that watches."""
        self._homes: dict[str, tuple[str, str]] = {}
        """Site and identity of each robot that is watched, as it was seen last, by slot."""
        self._considering = Beside()
        """Looks whether a robot that has come is one that is watched."""
        self._closed = self._keeps = False
        self._entrusted = ""
        """The secret of a move under way, from which the children have what they know the next process by."""
        secret, bonds = self._runtime.look(lambda state: (state.secret, state.slots.copied()))
        self._unproven = {bond.child.key for bond in bonds.values()} if secret else set[str]()
        """Children that have not heard yet that this process has the robot now."""
        self.on_room: Callable[[], None] = lambda: None
        """Called when a slot has become empty and its child does not come back."""
        self._anew = set(self._bonds())
        """Slots whose child may come back as another incarnation: those that a restored robot had, until the
        child is heard. It may have been restarted with its parent."""

    def _bonds(self) -> dict[str, Bond]:
        """Return copies of the bonds in force, by slot."""
        return self._runtime.look(lambda state: state.slots.copied())

    def _spec(self, slot: str) -> SlotSpec:
        return self._runtime.look(lambda state: state.slots[slot].spec)

    def _client(self, child: Address) -> RobotClient:
        return RobotClient(self._transport, child, sender=self._runtime.key)

    # -- binding ----------------------------------------------------------------------------------

    async def enslave(self, slot: str, child: Address, asker: Principal = ITSELF) -> None:
        """Bind a child to a slot, or to one of a group; a child that was lost there does not return to it.

        Args:
            slot: name of the slot, or of the group.
            child: who.
            asker: who asks for it.

        Raises:
            BondError: there is no such slot, it is occupied, or the child is of another kind.
            LeaseError: the child has another parent, or is an ancestor.
            TransportError: the child does not answer; the petition is taken back, should it have agreed.
        """
        place = self._runtime.look(lambda state: state.slots.place(slot, child.name))
        if self._spec(place).watch:
            await self._begin_to_watch(place, child, asker)
            return
        if returning := self._returning.get(place):
            returning.cancel()
            await asyncio.wait([returning])
        await self._bind(place, child, None, asker)

    async def choose(self, slot: str, child: Address, why: str, asker: Principal = ITSELF) -> None:
        """Bind a child to a slot, for which it was chosen, if it still has nothing to do.

        Args:
            slot: name of the slot.
            child: who.
            why: it was chosen, as a sentence.
            asker: who asks for it.

        Raises:
            BondError: there is no such slot, it is occupied, or the child is of another kind.
            LeaseError: the child has another parent, or something to do.
            TransportError: the child does not answer.
        """
        await self._bind(slot, child, None, asker, why)

    def awaits(self, slot: str) -> bool:
        """Whether the child that was lost in an empty slot may still come back, as far as is settled."""
        return slot in self._returning or slot in self._watching

    async def _bind(
        self, slot: str, child: Address, returns: int | None, asker: Principal = ITSELF, why: str = ""
    ) -> None:
        """Bind a child; `returns` is the epoch of a lost lease, or `FRESH`; None: it is a new bond.

        With a reason `why` it was chosen as one that has nothing to do.
        """
        self._runtime.post(on.Reserve(slot=slot, child=child, principal=asker))
        client = self._client(child)
        key = fresh_key()
        try:
            bond = await self._ask(client, slot, key, returns, asker, idle=why != "" and returns is None)
            bond.why = why
        except BaseException as error:
            self._runtime.post(on.Unreserve(slot=slot))
            if isinstance(error, TransportError) or not isinstance(error, VrError):
                self._retract(client, key)
            raise
        self._runtime.post(on.Bind(slot=slot, bond=bond, principal=asker))
        self._watch(slot, child)
        self._runtime.changed()
        if self._closed:  # the parent was deleted meanwhile
            await self._free_if_bound(slot)

    async def _begin_to_watch(self, slot: str, robot: Address, asker: Principal) -> None:
        """Watch a robot in a slot that is made for it; the robot itself is only asked who it is.

        Raises:
            BondError: another one is watched there, or it is of another kind.
            TransportError: the robot does not answer.
        """
        wanted, found = self._spec(slot).kind, await self._client(robot).describe()
        if wanted not in found.kinds:
            raise WrongKind(
                robot=self._parent.name, slot=slot, wanted=wanted, child=robot.name, kind=found.kind
            )
        self._runtime.post(on.Watching(slot=slot, robot=robot, principal=asker))
        self._follow_lives(slot, robot, found.identity)
        self._runtime.changed()

    def _follow_lives(self, slot: str, robot: Address, identity: str = "") -> None:
        """Watch the next lives of a robot, too, as soon as they are there, at whichever host or site.

        Another site may have a robot of the same name: it is followed there only by its identity.
        """
        self._homes[slot] = Places(self._presence).site_of(robot.key), identity

        def look(_key: str, _there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            watched = self._watched().get(slot)
            if watched is None:
                return
            if self._presence.there(watched.key):
                _, known = self._homes.get(slot, ("", ""))
                self._homes[slot] = Places(self._presence).site_of(watched.key), known
            else:
                for key in self._presence.keys(everyone(watched.role, watched.name)):
                    if life := Address.parse(key):
                        self._considering.begin(self._consider(slot, watched, life))
            self._runtime.changed()

        if before := self._lives.pop(slot, None):
            before()
        self._lives[slot] = self._presence.watch(everyone(robot.role, robot.name), look)

    async def _consider(self, slot: str, watched: Address, life: Address) -> None:
        """Watch a robot of the name of one that has gone, if it is that one."""
        try:
            found = await self._client(life).describe()
        except VrError:
            return  # it has gone again, or hangs: its presence will tell
        site, identity = self._homes.get(slot, ("", ""))
        here = Places(self._presence).site_of(life.key)
        same = identity and identity == found.identity
        if self._watched().get(slot) != watched or self._presence.there(watched.key):
            return
        if not same and here != site:
            return  # another robot of this name
        self._homes[slot] = here, found.identity
        self._runtime.post(on.Watching(slot=slot, robot=life))
        self._runtime.changed()

    def _watched(self) -> dict[str, Address]:
        """Return who is watched, by slot."""
        return self._runtime.look(lambda state: state.slots.watched())

    async def free(self, slot: str, asker: Principal = ITSELF) -> None:
        """Release the child in a slot, or all of a group; if it does not hear it, its lease runs out.

        Args:
            slot: name of the slot, or of the group.
            asker: who asks for it.

        Raises:
            BondError: there is no such slot, or it is empty.
        """
        if self._runtime.look(lambda state: slot not in state.slots.groups and state.slots[slot].spec.watch):
            self._runtime.post(on.WatchEnded(slot=slot, principal=asker))
            if unwatch := self._lives.pop(slot, None):
                unwatch()
            self._runtime.changed()
            return
        filled = self._runtime.look(lambda state: state.slots.filled(slot))
        await asyncio.gather(*(self._free(each, asker) for each in filled))

    async def _free(self, slot: str, asker: Principal) -> None:
        bond = self._runtime.bond_in(slot)
        self._runtime.post(on.FreeAsked(slot=slot, principal=asker))
        with contextlib.suppress(VrError):
            await self._client(bond.child).release(self._parent, bond.lease.epoch, timeout=FAREWELL)

    def keep(self) -> None:
        """Release nobody at the end: the robot will be started again."""
        self._keeps = True

    async def take_back(self) -> None:
        """Hold the children of a restored robot again, or try to bind those that have let go."""
        for slot, robot in self._watched().items():
            self._follow_lives(slot, robot)
            if self._presence.there(robot.key):
                with contextlib.suppress(VrError):
                    found = await self._client(robot).describe()
                    self._homes[slot] = self._homes[slot][0], found.identity
        await asyncio.gather(*(self._take_back_one(slot, bond) for slot, bond in self._bonds().items()))

    async def _take_back_one(self, slot: str, bond: Bond) -> None:
        child, epoch, confirmed = bond.child, bond.lease.epoch, bond.lease.confirmed
        if not await self._presence.until(child.key, there=True, within=REUNION):
            if bond.returns:
                self._returning[slot] = asyncio.ensure_future(self._await_child(slot, bond))
                return
            reason = f"{child.name} has ended while its parent was away"
            self._runtime.post(on.Lose(slot=slot, child=child, epoch=epoch, reason=reason))
            return
        self._watch(slot, child)
        self.renew(on.RenewLease(slot=slot, child=child, epoch=epoch, sent=loop_now()))
        until = loop_now() + FAREWELL
        while loop_now() < until:  # the answer comes in another thread
            now = self._bonds().get(slot)
            if now is None:
                return
            if now.lease.confirmed != confirmed:
                self._anew.discard(slot)
                return
            await asyncio.sleep(0.002)

    async def _await_child(self, slot: str, bond: Bond) -> None:
        """Hold a child again whose host is starting, too, or lose it when it does not come in time."""
        if await self._presence.until(bond.child.key, there=True, within=bond.returns):
            self._watch(slot, bond.child)
            self.renew(on.RenewLease(slot=slot, child=bond.child, epoch=bond.lease.epoch, sent=loop_now()))
        self._returning.pop(slot, None)

    async def close(self) -> None:
        """Release all children, and take no more."""
        self._closed = True
        for unwatch in self._lives.values():
            unwatch()
        self._considering.cancel()
        self._lives.clear()
        for task in self._returning.values():
            task.cancel()
        if self._keeps:
            return
        await asyncio.gather(*map(self._free_if_bound, self._bonds()))
        if self._retracting.tasks:
            await asyncio.wait(self._retracting.tasks, timeout=FAREWELL)
            self._retracting.cancel()

    async def _free_if_bound(self, slot: str) -> None:
        with contextlib.suppress(SlotEmpty):  # it was lost meanwhile
            await self.free(slot)

    def _watch(self, slot: str, child: Address) -> None:
        """Lose a child when its presence goes."""

        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            bond = None if there else self._bonds().get(slot)
            epoch = 0 if bond is None or bond.child != child else bond.lease.epoch
            if epoch and not self._waits_for(slot, child, epoch):
                hangs = not self._presence.left(child.key) and self._presence.lives(child.key)
                how = "hung: its process did not answer" if hangs else "has ended or cannot be reached"
                reason = f"{child.name} {how}"
                self._runtime.post(on.Lose(slot=slot, child=child, epoch=epoch, reason=reason))

        self._watching[slot] = self._presence.watch(child.key, look)

    def _waits_for(self, slot: str, child: Address, epoch: int) -> bool:
        """Whether a child that is gone comes back: then it is lost when its lease runs out, not before."""
        bond = self._runtime.look(lambda state: state.slots.held(slot, child, epoch))
        return bond is not None and bond.returns > 0.0 and not self._presence.lives(child.key)

    def gone(self, effect: on.ChildGone) -> None:
        """A slot is empty again."""
        if effect.slot not in self._bonds() and (unwatch := self._watching.pop(effect.slot, None)):
            unwatch()
        if effect.reason:
            _log.warning("%s.%s lost its child: %s", self._parent.name, effect.slot, effect.reason)
            task = self._returning[effect.slot] = asyncio.ensure_future(self._take_back(effect))
            task.add_done_callback(lambda done: self._forget(effect.slot, done))
        else:
            self.on_room()
        self._runtime.changed()

    def _forget(self, slot: str, returning: asyncio.Task[None]) -> None:
        if self._returning.get(slot) is returning:
            del self._returning[slot]
            self.on_room()

    async def _take_back(self, lost: on.ChildGone) -> None:
        """Bind a child again that was lost, when it is heard and if nobody has used it since.

        Whether the lease can return the child decides. One whose process has ended comes back as another
        incarnation, and only to a slot that states a time for that.
        """
        stated = self._spec(lost.slot).returns or (RETURN if lost.slot in self._anew else 0.0)
        self._anew.discard(lost.slot)
        latest = loop_now() + (stated or RETURN)
        while not self._closed and loop_now() < latest:
            try:
                if not (stated or self._presence.lives(lost.child.key)):
                    return
                child = await self._heard(lost.child, anew=stated > 0.0, within=latest - loop_now())
                if child is None:
                    return
                returns = lost.epoch if child == lost.child else FRESH
                why = f"{child.name} came back in time" if self._spec(lost.slot).choose else ""
                await self._bind(lost.slot, child, returns, why=why)
            except TransportClosed:
                return
            except TransportError:
                await asyncio.sleep(RETRY)
            except VrError:  # it has another parent, was used meanwhile, or the slot is filled or gone
                return
            else:
                _log.warning("%s.%s has %s again", self._parent.name, lost.slot, lost.child.name)
                return

    async def _heard(self, child: Address, *, anew: bool, within: float) -> Address | None:
        """Wait until a child is heard, or also a later incarnation of it; None: it was not in time."""
        heard, pattern = asyncio.Event(), everyone(child.role, child.name) if anew else child.key
        unwatch = self._presence.watch(pattern, lambda _, there: heard.set() if there else None)
        try:
            async with asyncio.timeout(within):
                await heard.wait()
        except TimeoutError:
            return None
        finally:
            unwatch()
        keys = self._presence.keys(pattern)
        return child if child.key in keys or not keys else Address.parse(keys[-1])

    # -- asking -----------------------------------------------------------------------------------

    async def _ask(
        self, client: RobotClient, slot: str, key: str, returns: int | None, asker: Principal, *, idle: bool
    ) -> Bond:
        lineage, child = self._runtime.look(lambda state: state.lineage), client.address
        gate = self._runtime.here.gate
        if child.name in lineage:
            raise CycleOfBonds(parent=self._parent.name, child=child.name, lineage=" > ".join(lineage))
        spec = self._spec(slot)
        declared = slots_of(type(self._runtime.robot)).get(spec.group or slot)
        promises = () if declared is None else declared.promises()
        promised = {promise.name for promise in promises}
        uses = tuple(name for name in spec.commands if name not in promised)

        petition = Petition(
            parent=self._parent,
            slot=slot,
            kind=spec.kind,
            promises=promises,
            uses=uses,
            lineage=lineage,
            term=self._term,
            key=key,
            returns=returns,
            patience=spec.returns,
            waits=self._runtime.process.returns,
            life=self._runtime.process.kept_life,
            asker=gate.asker(asker) if gate.closed and (asker.person or asker.site) else None,
            idle=idle,
        )
        sent = loop_now()
        try:
            granted = await client.petition(petition)
        except Unreachable:
            if not self._presence.lives(child.key):  # after one of two hung, their link is gone
                raise
            await self._presence.until(child.key, there=True, within=REUNION)
            sent = loop_now()
            granted = await client.petition(
                petition
            )  # the same one: a child that has granted it grants it again
        if granted.robot is None:
            raise Garbled(key=child.key, detail="it grants a lease but does not say who it is")
        lease = HeldLease.begin(epoch=granted.epoch, term=granted.term, sent=sent, now=loop_now())
        return Bond(
            child=child,
            lease=lease,
            description=granted.robot,
            depth=granted.depth,
            ways=granted.ways,
            returns=granted.returns,
        )

    def _retract(self, client: RobotClient, key: str) -> None:
        async def tell() -> None:
            latest = loop_now() + self._term  # then the lease is over, if there is one
            while loop_now() < latest:
                try:
                    await client.retract(self._parent, key, timeout=RECEIPT)
                except TransportError:
                    await asyncio.sleep(RETRY)
                else:
                    return

        self._retracting.begin(tell())

    # -- keeping ----------------------------------------------------------------------------------

    def renew(self, effect: on.RenewLease) -> None:
        """Ask a child to prolong its lease, and hand on what it answers. In any thread."""
        slot, child, epoch = effect.slot, effect.child, effect.epoch
        answered, key = False, child.key

        def lose(reason: str) -> None:
            self._runtime.post(on.Lose(slot=slot, child=child, epoch=epoch, reason=reason))

        def take(reply: Reply | None) -> None:
            nonlocal answered
            if reply is None:
                gone = not (answered or self._presence.there(child.key))
                if gone and not self._waits_for(slot, child, epoch):
                    lose(f"{child.name} has ended")
                return
            answered = True
            if isinstance(reply, Granted):
                self._unproven.discard(key)
                self._renewed(effect, reply)
                return
            error = reply.revive() if isinstance(reply, Raised) else reply
            if isinstance(error, LeaseError):
                lose(str(error))
            elif not isinstance(error, TransportError):  # of these the next one may get through
                _log.warning("%s: renewal for %s: %s", self._parent.name, slot, error)

        renewal = self._renewal(epoch, key)
        self._runtime.ask(child.key, renewal, take, now=effect.sent, within=self._term, urgent=True)

    def _renewal(self, epoch: int, child: str) -> Renew:
        """Return the request of a parent for the lease of a child, as it is now."""
        heir, proves = seal_of(proof_of(self._entrusted, child)), child in self._unproven

        def renewal(parent: RobotState) -> Renew:
            return Renew(
                parent=parent.address,
                epoch=epoch,
                lineage=parent.lineage,
                paused=parent.pause.in_force,
                pauses=parent.pause.changes,
                life=self._runtime.process.kept_life,
                heir=heir,
                proof=proof_of(parent.secret, child) if proves else "",
            )

        return self._runtime.look(renewal)

    def _renewed(self, effect: on.RenewLease, granted: Granted) -> None:
        self._runtime.post(
            on.Renewed(
                slot=effect.slot,
                child=effect.child,
                epoch=effect.epoch,
                sent=effect.sent,
                term=granted.term,
                depth=granted.depth,
                ways=granted.ways,
                description=granted.robot,
                stopped=granted.stopped,
                granted=granted.epoch,
            )
        )
        if granted.robot is not None:
            self._runtime.changed()

    async def describe(self, slot: str, command: str) -> RobotDescription:
        """Ask the child in a slot anew who it is.

        Raises:
            SlotEmpty: there is no child.
            NoSuchCommand: it lacks the command.
            TransportError: it does not answer.
        """
        bond = self._runtime.bond_in(slot)
        description = await self._client(bond.child).describe()
        if description.command(command) is None:
            known = offered((spec.name for spec in description.commands), command)
            raise NoSuchCommand(robot=description.name, command=command, known=known)
        self._runtime.post(
            on.ChildDescribed(slot=slot, child=bond.child, epoch=bond.lease.epoch, description=description)
        )
        return description

    # -- moving -----------------------------------------------------------------------------------

    def moves_with(self, secret: str) -> None:
        """Have children told by what they know the next process of the robot; empty: it does not move."""
        self._entrusted = secret

    async def entrust(self, secret: str) -> frozenset[tuple[str, str]]:
        """Tell each child by what it knows the next process of the robot; returns slots and keys.

        Raises:
            VrError: a child does not answer, or is on its way itself.
        """
        self._entrusted = secret

        async def tell(slot: str, bond: Bond) -> tuple[str, str]:
            key, sent = bond.child.key, loop_now()
            granted = await ask(
                self._transport,
                key,
                self._renewal(bond.lease.epoch, key),
                Granted,
                timeout=ENTRUSTED_WITHIN,
                urgent=True,
                sender=self._runtime.key,
            )
            effect = on.RenewLease(slot=slot, child=bond.child, epoch=bond.lease.epoch, sent=sent)
            self._unproven.discard(key)
            self._renewed(effect, granted)
            return slot, key

        told = await asyncio.gather(*(tell(slot, bond) for slot, bond in self._bonds().items()))
        return frozenset(told)

    def renew_all(self) -> None:
        """Ask all children to prolong their leases now: the core does not while the robot is on its way."""
        for slot, bond in self._bonds().items():
            self.renew(on.RenewLease(slot=slot, child=bond.child, epoch=bond.lease.epoch, sent=loop_now()))

    def stop_all(self, reason: str, order: str) -> None:
        """Pass a stop on to all children; nobody waits for their answers."""

        async def stop(slot: str) -> None:
            budget = Budget(ANSWER_WITHIN, depth=0, round_trips=0.0)
            with contextlib.suppress(VrError):
                await self.safe_stop(slot, reason, order, budget)

        for slot in self._bonds():
            self._retracting.begin(stop(slot))

    def leave(self) -> None:
        """Watch nobody any more: another process keeps the children."""
        self._closed = True
        for task in self._returning.values():
            task.cancel()
        for unwatch in self._watching.values():
            unwatch()
        self._watching.clear()

    # -- orders -----------------------------------------------------------------------------------

    async def safe_stop(self, slot: str, reason: str, order: str, budget: Budget) -> Sequence[str]:
        """Stop the child in a slot, and all below it; one whose process is stopped is not waited for long.

        Args:
            slot: of the child.
            reason: of the stop.
            order: that it is part of.
            budget: of time.

        Returns:
            The names of those that have confirmed it.

        Raises:
            VrError: not all have.
        """
        bond = self._runtime.bond_in(slot)
        within, acknowledged = budget.below(bond.lease.round_trip), asyncio.Event()
        asking = asyncio.ensure_future(
            self._client(bond.child).safe_stop(
                reason, order=order, timeout=budget.wait, within=within, accepted=acknowledged.set
            )
        )
        try:
            await asyncio.wait([asking], timeout=HOPELESS)
            if not (asking.done() or acknowledged.is_set()) and self._asleep(bond.child):
                raise NoAnswer(key=bond.child.key, seconds=HOPELESS)
            return await asking
        finally:
            asking.cancel()

    def _asleep(self, child: Address) -> bool:
        """Whether the process of a child is stopped, as the kernel says: a slow one is not."""
        return any(held.asleep for held in self._presence.held(child.key))

    async def resume(
        self,
        order: Resume,
        confirmations: Confirmations,
        budget: Budget,
        *,
        waited: float,
    ) -> None:
        """Release the stop of all children, at the same time.

        Args:
            order: which stops; its `seen`, `given` and `clock` go down unchanged.
            confirmations: takes what they answer.
            budget: of time.
            waited: [s] of it that are gone already.
        """
        chosen: list[Bond] = []
        seen, given, clock = order.seen, order.given, order.clock
        for bond in self._bonds().values():
            if seen is None or bond.child.key in seen:
                chosen.append(bond)
            else:
                confirmations.deny(bond.child.name, "the resume was sent without having seen it")

        async def resume(bond: Bond) -> None:
            within = budget.below(bond.lease.round_trip, waited)
            timeout, epoch = max(budget.wait - waited, LEAST), bond.lease.epoch
            answer: Sequence[str] | VrError
            try:
                answer = await self._client(bond.child).resume(
                    epoch=epoch, seen=seen, given=given, clock=clock, timeout=timeout, within=within
                )
            except VrError as error:
                answer = error
            confirmations.take(bond.child.name, answer)

        await asyncio.gather(*map(resume, chosen))

    async def step(self, within: float) -> str:
        """Let one step of one of those below pass; returns which, in words, empty: none waits."""
        pages = [bond for bond in self._bonds().values() if VirtualRobot.__name__ in bond.description.kinds]
        for bond in pages:
            with contextlib.suppress(NothingHeld, NotPaused):
                return await self._client(bond.child).step(epoch=bond.lease.epoch, within=within)
        return ""
