"""What can be asked of one robot, and what it answers: all but the calls of its commands, at once."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from robotree.vr.address import Address
from robotree.vr.agents.bonds import BondKeeper
from robotree.vr.agents.commands import CommandDesk
from robotree.vr.agents.hooks import Hooks
from robotree.vr.agents.lease import LeaseKeeper
from robotree.vr.agents.portrait import Portrait
from robotree.vr.confirmation import Confirmations, share
from robotree.vr.description import CommandSpec
from robotree.vr.errors import CycleOfBonds, NotVirtual, StillBonded, Unreachable, WrongKind
from robotree.vr.exchange.answering import Say, not_for
from robotree.vr.requests import (
    Call,
    Cancel,
    Delete,
    Describe,
    Described,
    Done,
    Enslave,
    Free,
    Granted,
    Petition,
    Release,
    Renew,
    Reply,
    Request,
    Resume,
    Retract,
    SafeStop,
)
from robotree.vr.robot import Robot


class Life(Protocol):
    """What the requests need of the agent that lives."""

    address: Address

    @property
    def open(self) -> bool:
        """Whether it takes anything new."""
        ...

    def changed(self) -> None:
        """Take note that others may see the robot differently."""
        ...

    def lineage(self) -> tuple[str, ...]:
        """Return the names from the topmost ancestor down to the robot."""
        ...

    def lineage_changed(self) -> None:
        """Take note that the robot has another line of ancestors."""
        ...

    async def delete(self, last_words: Callable[[str], None]) -> None:
        """End; returns when it is gone.

        Args:
            last_words: called while the way to whoever asked is open, with a sentence on what is left.
        """
        ...


class AgentRequests:
    """Answers for one robot."""

    def __init__(
        self, robot: Robot, life: Life, lease: LeaseKeeper, desk: CommandDesk, portrait: Portrait
    ) -> None:
        """Take what the answers are made of.

        Args:
            robot: that is asked.
            life: its agent's.
            lease: the right to command it.
            desk: its commands, and its children if it is a virtual robot.
            portrait: its looks.
        """
        self._robot, self._life = robot, life
        self._lease, self._desk, self._bonds = lease, desk, desk.bonds
        self._hooks, self._portrait = Hooks(robot), portrait
        self._told: tuple[CommandSpec, ...] = ()
        self._releases = 0
        """How many resumes wait for what stands behind the robot."""
        self._handlers: dict[type, Callable[[Any], Awaitable[Reply]]] = {
            Describe: self._describe,
            Cancel: self._cancel,
            Petition: self._petition,
            Retract: self._retract,
            Renew: self._renew,
            Release: self._release,
            SafeStop: self._safe_stop,
            Resume: self._resume,
            Enslave: self._enslave,
            Free: self._free,
        }

    async def answer(self, request: Request, say: Say) -> None:
        """Answer one request.

        Raises:
            VrError: it is refused.
        """
        if not self._life.open and not isinstance(request, Describe | Release | SafeStop | Delete):
            raise Unreachable(key=self._life.address.key)
        if isinstance(request, Call):
            await self._desk.answer(request, say)
        elif isinstance(request, Delete):
            await self._delete(say)
        elif handler := self._handlers.get(type(request)):
            say(await handler(request))
        else:
            raise not_for("robot", request)

    # -- what it is -------------------------------------------------------------------------------

    async def _describe(self, _: Describe) -> Reply:
        return Described(robot=self._portrait.description())

    # -- what it does -----------------------------------------------------------------------------

    async def _cancel(self, request: Cancel) -> Reply:
        self._lease.check(request.epoch)
        reason = request.reason or "on request"
        if request.key:
            self._desk.jobs.cancel(request.key, reason)
        else:
            self._desk.jobs.cancel_all(reason)
        return Done()

    async def _safe_stop(self, request: SafeStop) -> Reply:
        reason, seconds = request.reason or "protective stop", share(request.within)
        self._desk.stop(reason)
        confirming = self._hooks.safe_stop(reason)
        self._life.changed()
        confirmations, own = Confirmations("the protective stop"), confirming.doubt(seconds)
        if self._bonds is None:
            self._take_own(confirmations, await own)
        else:
            below = self._bonds.safe_stop(reason, confirmations, timeout=seconds)
            doubt, _ = await asyncio.gather(own, below)
            self._take_own(confirmations, doubt)
        return Done(told=tuple(confirmations.settle()))

    async def _resume(self, request: Resume) -> Reply:
        """Release those below first: nobody may use a child that is still stopped."""
        name, seconds, desk = self._robot.name, share(request.within), self._desk
        self._lease.check(request.epoch)
        confirmations, stops = Confirmations("the resume"), self._stops_seen(request)
        if self._bonds is not None and stops == desk.stops:
            await self._bonds.resume(request.seen, confirmations, timeout=seconds)
            self._lease.check(request.epoch)  # once more: what was awaited may have taken time
        allowed = stops == desk.stops and confirmations.complete
        doubt = await self._release_own(seconds) if allowed else ""
        if stops != desk.stops:
            confirmations.deny(name, "it was stopped again after that had been asked for")
        elif not confirmations.complete:
            confirmations.deny(name, "it waits for those below it")
        else:
            self._take_own(confirmations, doubt)
            if not doubt:
                desk.ordered = ""
                self._life.changed()
        return Done(told=tuple(confirmations.settle()))

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
        return request.seen.get(self._life.address.key, 0)

    def _take_own(self, confirmations: Confirmations, doubt: str) -> None:
        if doubt:
            offline = "" if self._robot.online else "it is offline, and "
            confirmations.deny(self._robot.name, f"{offline}{doubt}")
        else:
            confirmations.take(self._robot.name, ())

    # -- who commands it --------------------------------------------------------------------------

    async def _petition(self, request: Petition) -> Reply:
        name, parent, kinds = self._robot.name, request.parent.name, self._robot.kinds()
        if self._bonds is not None and parent in self._bonds.names():
            raise CycleOfBonds(parent=parent, child=name, lineage=f"{name} > {parent}")
        if request.kind not in kinds:
            raise WrongKind(robot=parent, slot=request.slot, wanted=request.kind, child=name, kind=kinds[0])
        tenure = self._lease.petition(request)
        self._desk.jobs.cancel_all(f"{parent} has enslaved {name}", but_readers=True)
        self._life.lineage_changed()
        description = self._portrait.description()
        self._told = description.commands
        return Granted(epoch=tenure.epoch, term=self._lease.lessor.term_granted, robot=description)

    async def _renew(self, request: Renew) -> Reply:
        before = self._life.lineage()
        tenure = self._lease.renew(request)
        if self._life.lineage() != before:
            self._life.lineage_changed()
        description = self._portrait.description()
        news = None if description.commands == self._told else description
        self._told = description.commands
        return Granted(epoch=tenure.epoch, term=self._lease.lessor.term_granted, robot=news)

    async def _retract(self, request: Retract) -> Reply:
        self._lease.retract(request.parent, request.key)
        return Done()

    async def _release(self, request: Release) -> Reply:
        self._lease.release(request.parent, request.epoch)
        return Done()

    # -- whom it commands -------------------------------------------------------------------------

    async def _enslave(self, request: Enslave) -> Reply:
        await self._children("enslave others").enslave(request.slot, request.child)
        return Described(robot=self._portrait.description())

    async def _free(self, request: Free) -> Reply:
        await self._children("release children").free(request.slot)
        return Described(robot=self._portrait.description())

    async def _delete(self, say: Say) -> None:
        self._children("be deleted; end the process of its proxy instead")
        tenure = self._lease.tenure
        if tenure is not None:
            raise StillBonded(robot=self._robot.name, holder=tenure.parent.name, slot=tenure.slot)
        await self._life.delete(lambda left: say(Done(note=left)))

    def _children(self, what: str) -> BondKeeper:
        if self._bonds is None:
            raise NotVirtual(robot=self._robot.name, what=what)
        return self._bonds
