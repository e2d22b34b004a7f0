"""What a robot looks for in the lookup: children for its own slots, and roles that services lend to it.

A virtual robot asks candidates for bids, and binds the best that agrees. Slots with `choose="free"` are
filled while the robot lives; those of a script only while it leads, and it releases what it has chosen when
it is over. A child that is lost is waited for as long as the slot says (`returns`), then another one is
chosen. What a person has released by hand stays released.

Roles are offered while a service is listed, and taken back when it leaves: it lists them (`Listing.roles`),
so what ends the listing ends the loan: its end, the death of its process, a lease of the lookup that ran
out. A robot knows them as SERVICE-ROLE; the name of a service is its own in the realm, and that of a role
has no `-`, so none can lend under the name of another one. Only services of the same user and the same site
lend: what stands in a role is said and done by the robot.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import random
from collections.abc import Sequence
from itertools import islice
from typing import TYPE_CHECKING

from robotree.vr.agents.children import ChildKeeper
from robotree.vr.agents.shared import DirectoryTask, Shared
from robotree.vr.base.address import Address, user_of
from robotree.vr.base.chance import bits
from robotree.vr.base.description import SlotSpec, Template
from robotree.vr.base.errors import (
    BondError,
    LeaseError,
    NobodyFits,
    TransportClosed,
    TransportError,
    VrError,
)
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.transport import Transport
from robotree.vr.core.machine import RobotState
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.union import Change
from robotree.vr.network.group_file import groups_beside
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.scripts import chooser
from robotree.vr.scripts.requirement import Requirement, requirement

AGAIN = 1.0
"""[s] before an empty slot is looked at again when no list has changed."""
LOOK = 0.05
"""[s] between two looks at whether a script leads."""
ANSWER = 1.0
"""[s] for a bid; who is later does not take part."""
FREE = "free"
LEADS = "start"
"""The command of a script that leads its partners."""


class Choosing:
    """Chooses the children of one virtual robot. Lives on the event loop."""

    def __init__(
        self, runtime: RobotRuntime, children: ChildKeeper, transport: Transport, shared: Shared
    ) -> None:
        """Choose nobody yet."""
        self._runtime, self._children, self._transport = runtime, children, transport
        self._shared = shared
        self._chance = random.Random(bits(64)).random  # a tie-break, no secret
        self._released: set[str] = set()
        """Slots of which a person has released the child."""
        failed = f"{runtime.name} chooses nobody any more"
        self._task = DirectoryTask(shared, transport, self._look, failed=failed)
        self._led = False
        self._said: dict[str, str] = {}
        """Why a slot is empty, as it was logged."""

    def begin(self) -> None:
        """Fill the slots from now on, if any wants that; look again: it has another page."""
        self._task.wake()
        if self._runtime.look(_chooses):
            self._task.begin()

    async def close(self) -> None:
        """Choose nobody any more."""
        await self._task.close()

    def wake(self) -> None:
        """Look again: a slot is empty, or somebody may be free."""
        self._task.wake()

    def released(self, slot: str) -> None:
        """Take note that a person has released the child in a slot, or all of a group."""
        self._released.add(slot)

    async def enslave(self, slot: str, where: str, asker: Principal) -> None:
        """Choose a child for a slot because a person asks for it.

        Raises:
            RequirementUnreadable: `where` cannot be read.
            NobodyFits: there is nobody.
            BondError: there is no such slot, or it is occupied.
        """
        place = self._runtime.look(lambda state: state.slots.place(slot, ""))
        spec = self._runtime.look(lambda state: state.slots[place].spec)
        self._released -= {slot, place}
        async with self._shared.directory(self._transport) as directory:
            why = await self._fill(directory, place, spec, requirement(where or spec.where), asker)
        if why:
            raise NobodyFits(robot=self._runtime.name, slot=slot, reason=why)

    # -- by itself --------------------------------------------------------------------------------

    async def _look(self, directory: Directory) -> float | None:
        """Fill what is empty; return after how many seconds to look again, None: after the next change."""
        script = "Script" in self._runtime.robot.kinds()
        leads = self._runtime.look(lambda state: state.calls.of(LEADS) is not None) if script else True
        if self._led and not leads:
            self._released.clear()
            await self._let_go()
        self._led = leads
        empty = self._runtime.look(_empty) if leads else ()
        empty = tuple(spec for spec in empty if not self._keeps(spec))
        for spec in empty:
            try:
                why = await self._fill(directory, spec.name, spec, requirement(spec.where), ITSELF)
            except TransportClosed:
                raise
            except VrError as error:
                why = str(error)
            if why and self._said.get(spec.name) != why:
                self._runtime.log.say("info", f"{spec.name} stays empty: {why}")
            self._said[spec.name] = why
        if script:
            return LOOK
        return AGAIN * (0.5 + self._chance()) if self._runtime.look(_empty) else None

    def _keeps(self, spec: SlotSpec) -> bool:
        """Whether a slot is to stay empty: its child may come back, or a person has released it."""
        return bool(self._released & {spec.name, spec.group}) or self._children.awaits(spec.name)

    async def _let_go(self) -> None:
        """Release those that were chosen."""
        for slot in self._runtime.look(_chosen):
            with contextlib.suppress(VrError):
                await self._children.free(slot)

    # -- one slot ---------------------------------------------------------------------------------

    async def _fill(
        self, directory: Directory, slot: str, spec: SlotSpec, wanted: Requirement, asker: Principal
    ) -> str:
        """Put the best one into a slot; return why nobody was, empty: somebody was."""
        listings = directory.find(Template(role="robot", kind=spec.kind))
        wanted = wanted.expanded(groups_beside(self._transport.gate).find)
        may = chooser.candidates(listings, spec.kind, wanted, self._chance)
        bids: list[chooser.Bid] = []
        portion = chooser.ASKED
        while asked := list(islice(may, portion)):
            portion *= 2
            addresses = [one.address for one in asked if one.name != self._runtime.name]
            answers = await self._bids(addresses, wanted)
            bids += answers
            for bid in chooser.in_order(answers, self._chance):
                why = chooser.sentence(bid, bids, wanted, len(listings))
                try:
                    await self._children.choose(slot, bid.address, why, asker)
                except (LeaseError, TransportError) as error:
                    if isinstance(error, TransportClosed):
                        raise
                    bids[bids.index(bid)] = refused(bid, error)
                except BondError as error:
                    if self._runtime.look(lambda state: state.slots[slot].child) is not None:
                        raise
                    bids[bids.index(bid)] = refused(bid, error)
                else:
                    self._runtime.log.say("info", f"{slot}: {why}")
                    self._said.pop(slot, None)
                    return ""
        unfit = [bid for bid in bids if bid.reason]
        return chooser.vain(unfit, spec.kind, wanted, len(listings), stale=directory.stale)

    async def _bids(self, addresses: Sequence[Address], wanted: Requirement) -> list[chooser.Bid]:
        """Ask robots for their bids, at the same time."""

        async def ask(address: Address) -> chooser.Bid:
            client = RobotClient(self._transport, address, patience=ANSWER, sender=self._runtime.key)
            try:
                return chooser.bid_of(await client.describe(), wanted)
            except TransportClosed:
                raise
            except VrError as error:
                return refused(chooser.Bid(address=address), error)

        return list(await asyncio.gather(*map(ask, addresses)))


def refused(bid: chooser.Bid, error: VrError) -> chooser.Bid:
    """Return the bid of a robot that was not to be had."""
    reason = "does not answer" if isinstance(error, TransportError) else f"refuses ({error})"
    return chooser.Bid(address=bid.address, reason=reason)


def _chooses(state: RobotState) -> bool:
    slots = state.slots
    specs = [*(slot.spec for slot in slots.by_name.values()), *slots.groups.values()]
    return any(spec.choose == FREE for spec in specs)


def _empty(state: RobotState) -> tuple[SlotSpec, ...]:
    """Return the slots that are to be filled and are not; of a group as many as it needs."""
    return tuple(
        slot.spec
        for slot in state.slots.by_name.values()
        if slot.spec.choose == FREE and slot.child is None and not (slot.spec.group and slot.spec.optional)
    )


def _chosen(state: RobotState) -> list[str]:
    return [name for name, bond in state.slots.bonds().items() if bond.why]


if TYPE_CHECKING:
    from robotree.vr.scripts.roles.profile import Profile

_SERVICES = Template(role="robot", kind="Service")
_log = logging.getLogger(__name__)


def _is_of_a_service(change: Change) -> bool:
    return change.listing is not None and _SERVICES.matches(change.listing)


class LentRoles:
    """Has one robot know the roles of the services that are here. Lives on the event loop."""

    def __init__(self, runtime: RobotRuntime, transport: Transport, shared: Shared) -> None:
        """Look at nothing yet."""
        self._runtime = runtime
        failed = f"{runtime.name} is lent no more roles"
        self._task = DirectoryTask(shared, transport, self._look, concerns=_is_of_a_service, failed=failed)
        self._said: list[str] = []
        """What was logged at the last look."""

    def begin(self) -> None:
        """Look from now on, if the robot plays roles; look again: it has another page."""
        self._task.wake()
        if "RolePlayer" in self._runtime.robot.kinds():
            self._task.begin()

    async def close(self) -> None:
        """Look no more."""
        await self._task.close()

    async def _look(self, directory: Directory) -> None:
        from robotree.vr.scripts.roles.player import RolePlayer  # loaded already where one is

        robot = self._runtime.robot
        if not isinstance(robot, RolePlayer):
            return
        before = robot.attributes
        try:
            offered, said = self._offered(directory)
            said += robot.lend(offered)
        except VrError as error:  # it has just left for another host, where its next agent looks
            _log.debug("%s: %s", self._runtime.name, error)
            return
        for sentence in said:
            if sentence not in self._said:
                self._runtime.log.say("warning", sentence)
        self._said = said
        if robot.attributes != before:
            self._runtime.changed()

    def _offered(self, directory: Directory) -> tuple[dict[str, Profile], list[str]]:
        """Return the roles of the services that are listed, by the names by which robots know them.

        Returns:
            The roles, and a sentence for each service whose roles cannot be lent, whatever it has published.
        """
        from robotree.vr.scripts.roles.profile import lent_by

        user, offered, refused = user_of(self._runtime.key), dict[str, "Profile"](), list[str]()
        for listing in directory.find(_SERVICES):
            key = listing.address.key
            if not listing.roles or user_of(key) != user or directory.places.site_of(key):
                continue
            try:
                offered |= lent_by(listing.address.plain_name, listing.roles)
            except (VrError, TypeError) as error:
                refused.append(f"it does not take the roles of {listing.name}: {error}")
        return offered, refused
