"""What can be asked of one robot, and what it answers: all but the calls of its commands, at once."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any, Protocol

from robotree.vr.address import Address
from robotree.vr.agents.bonds import BondKeeper
from robotree.vr.agents.commands import CommandDesk
from robotree.vr.agents.lease import LeaseKeeper
from robotree.vr.agents.portrait import Portrait
from robotree.vr.agents.stopping import Stopping
from robotree.vr.description import CommandSpec, RobotDescription
from robotree.vr.errors import CycleOfBonds, NotVirtual, StillBonded, Unreachable, WrongKind
from robotree.vr.exchange.answering import Say, not_for
from robotree.vr.lease import Tenure
from robotree.vr.requests import (
    Accepted,
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
        self._portrait = portrait
        self._told: tuple[CommandSpec, ...] = ()
        self._stopping = stopping = Stopping(robot, life.address, lease, desk, on_change=life.changed)
        self._handlers: dict[type, Callable[[Any], Awaitable[Reply]]] = {
            Describe: self._describe,
            Cancel: self._cancel,
            Petition: self._petition,
            Retract: self._retract,
            Renew: self._renew,
            Release: self._release,
            Resume: stopping.resume,
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
        elif isinstance(request, SafeStop):
            say(Accepted(key=request.order))  # who orders it must know at once whom it has reached
            say(await self._stopping.safe_stop(request))
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
        return self._granted(tenure, description)

    async def _renew(self, request: Renew) -> Reply:
        before = self._life.lineage()
        tenure = self._lease.renew(request)
        if self._life.lineage() != before:
            self._life.lineage_changed()
        description = self._portrait.description()
        news = None if description.commands == self._told else description
        self._told = description.commands
        return self._granted(tenure, news)

    def _granted(self, tenure: Tenure, news: RobotDescription | None) -> Granted:
        return Granted(
            epoch=tenure.epoch,
            term=self._lease.lessor.term_granted,
            robot=news,
            depth=0 if self._bonds is None else self._bonds.depth,
            ways=0.0 if self._bonds is None else self._bonds.ways,
        )

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
