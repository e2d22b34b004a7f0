"""The orders of a realm, as a person or a program uses them: at whichever directories answer.

What two directories say is merged, so an answer is right as soon as one of them knows. All times are on the
clock of this process.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from robotree.vr.base.address import Address
from robotree.vr.base.chance import token
from robotree.vr.base.errors import (
    NoDirectory,
    NoSuchOrder,
    NotRemembered,
    TransportError,
    VrError,
)
from robotree.vr.base.order import (
    DIRECTORIES,
    ORDER_NEWS,
    KnownAgent,
    Order,
    OrderHold,
    clock_ahead,
    expect_one,
    expect_ticket,
    merged,
    merged_hold,
    merged_known,
    shifted,
    shifted_hold,
    shifted_known,
    the_one,
)
from robotree.vr.base.requests import (
    AnyRequest,
    CancelOrder,
    ConfirmOrder,
    Done,
    HoldOrders,
    KnownFound,
    LeaveOrder,
    MarkSeen,
    OrderLeft,
    OrderOutcome,
    OrdersChanged,
    OrdersFound,
    ReadKnown,
    ReadOrders,
    ReleaseHolds,
    Reply,
    TakeAlong,
    decode_event,
)
from robotree.vr.base.transport import Registration, Transport
from robotree.vr.exchange.asking import ask

WITHIN = 2.5
"""[s] for a directory to answer: it may wait a second for the others."""
MEETING = 1.0
"""[s] in which a directory is heard by a program that has just come."""
USUAL_END = 86400.0
"""[s] in which an order must begin if nobody says."""
NO_KEY = "-"
"""Of no order: who asks for it gets the holds alone."""

_R = TypeVar("_R", bound=Reply)


class OrderBoard(NamedTuple):
    """Orders and holds, as far as directories answer."""

    orders: Sequence[Order]
    """The oldest first."""
    holds: Sequence[OrderHold]
    silent: Sequence[str]
    """Names of the directories that are there and do not answer."""


class OrderDesk:
    """See the module."""

    def __init__(self, transport: Transport, caller: Callable[[], Any]) -> None:
        """Prepare.

        Args:
            transport: the way to the directories.
            caller: returns, when awaited, the key under which this program is present.
        """
        self._transport, self._caller, self._unix = transport, caller, time.time

    @property
    def directories(self) -> Sequence[str]:
        """Keys of the directories that are there."""
        return self._transport.presence.keys(DIRECTORIES)

    async def met(self, within: float = MEETING) -> Sequence[str]:
        """Return the keys of the directories, as soon as one that the machine knows of has been heard.

        Args:
            within: [s] to wait for it.
        """
        presence = self._transport.presence
        if not self.directories and presence.held(DIRECTORIES):
            await presence.until(DIRECTORIES, there=True, within=within)
        return self.directories

    # -- orders -----------------------------------------------------------------------------------

    async def leave(
        self,
        robot: str,
        command: str,
        arguments: Mapping[str, Any],
        *,
        begin_within: float = USUAL_END,
        may_take: float = 120.0,
        identity: str = "",
    ) -> OrderLeft:
        """Leave an order; returns it, with the directories that have it.

        Args:
            robot: its name.
            command: of it.
            arguments: numbers in the declared units, or text with units.
            begin_within: [s] in which it must begin.
            may_take: [s] that it may take then.
            identity: which robot of this name; empty: the only one.

        Raises:
            NoDirectory: none answers.
            OrderError: it was refused, by all that know the robot.
            CommandError: the arguments do not fit, or there is no such command.
        """
        request = LeaveOrder(
            key=token(),
            robot=robot,
            identity=identity,
            command=command,
            arguments=dict(arguments),
            begin_within=begin_within,
            may_take=may_take,
        )
        return await self._first(request, OrderLeft, pass_on=(NotRemembered,))

    async def cancel(self, ticket: str) -> OrderLeft:
        """End an order; returns it as it is then, with the directories that have not confirmed that.

        Raises:
            NoSuchOrder: no directory that answers has it.
            SeveralOrders: several begin like this.
            OrderOver: it is over.
        """
        order = await self.order(ticket)
        return await self._first(CancelOrder(key=order.key), OrderLeft, pass_on=(NoSuchOrder,))

    async def confirm(self, ticket: str) -> OrderLeft:
        """Answer what a robot asks about an order: it may begin.

        Raises:
            NothingToConfirm: it asks nothing.
            OrderError: as `cancel`.
        """
        order = await self.order(ticket)
        return await self._first(ConfirmOrder(key=order.key), OrderLeft, pass_on=(NoSuchOrder,))

    async def settle(self, ticket: str, outcome: OrderOutcome) -> OrderLeft:
        """Say what became of an order in doubt.

        Raises:
            NotInDoubt: it is not.
            OrderError: as `cancel`.
        """
        order = await self.order(ticket)
        request = ConfirmOrder(key=order.key, outcome=outcome)
        return await self._first(request, OrderLeft, pass_on=(NoSuchOrder,))

    async def board(self, *, key: str = "", robot: str = "", mine: bool = False) -> OrderBoard:
        """Return the orders that match.

        Args:
            key: beginning of the key; empty: any.
            robot: name of the robot; empty: any.
            mine: only those of this user.

        Raises:
            NoDirectory: none answers.
        """
        asked = self.directories
        answers = await self._all(ReadOrders(key=key, robot=robot, mine=mine), OrdersFound)
        if not answers:
            raise NoDirectory(detail="")
        orders: dict[str, Order] = {}
        holds: dict[str, OrderHold] = {}
        for found in answers.values():
            by = clock_ahead(self._unix(), found.now)
            for each in found.orders:
                order = shifted(each, by)
                orders[each.key] = merged(orders[each.key], order) if each.key in orders else order
            for one in found.holds:
                hold = shifted_hold(one, by)
                holds[one.id] = merged_hold(holds[one.id], hold) if one.id in holds else hold
        silent = [_name(each) for each in asked if each not in answers]
        by_age = sorted(orders.values(), key=lambda each: (each.left, each.key))
        return OrderBoard(by_age, sorted(holds.values(), key=lambda each: each.at), silent)

    async def holds(self) -> Sequence[OrderHold]:
        """Return the holds that are in force; none if no directory answers."""
        try:
            return (await self.board(key=NO_KEY)).holds
        except NoDirectory:
            return ()

    async def order(self, ticket: str) -> Order:
        """Return the order whose key begins like this.

        Raises:
            OrderError: as `the_one`.
        """
        expect_ticket(ticket)
        return the_one((await self.board(key=ticket)).orders, ticket)

    async def inbox(self) -> Sequence[Order]:
        """Return the results that wait for this user, the oldest first."""
        return [
            each
            for each in (await self.board(mine=True)).orders
            if each.over and not each.seen and each.state != "cancelled"
        ]

    async def mark_seen(self, orders: Iterable[Order]) -> None:
        """Take results out of the inbox."""
        keys = tuple(each.key for each in orders)
        if keys:
            await self._all(MarkSeen(keys=keys), Done)

    async def on_change(self, callback: Callable[[OrdersChanged], None]) -> Registration:
        """Call back whenever orders or holds have changed somewhere."""

        def hear(key: str, body: bytes) -> None:
            try:
                event = decode_event(body, key=key)
            except VrError:
                return
            if isinstance(event, OrdersChanged):
                callback(event)

        return await self._transport.subscribe(ORDER_NEWS, hear)

    # -- what is remembered -----------------------------------------------------------------------

    async def known(self, name: str = "", *, brief: bool = False) -> Sequence[KnownAgent]:
        """Return what the directories remember of robots and views, by name; nothing if none answers."""
        request = ReadKnown(name=name, brief=brief)
        found: dict[str, KnownAgent] = {}
        for answer in (await self._all(request, KnownFound)).values():
            by = clock_ahead(self._unix(), answer.now)
            for each in answer.agents:
                agent = shifted_known(each, by)
                known = found.get(each.identity)
                found[each.identity] = agent if known is None else merged_known(known, agent)
        return sorted(found.values(), key=lambda each: (each.role, each.name, each.identity))

    async def robot(self, name: str) -> KnownAgent | None:
        """Return what is remembered of a robot; None: nothing is.

        Raises:
            SeveralRobots: several of this name are away.
        """
        found = [each for each in await self.known(name) if each.role == "robot"]
        alive = [each for each in found if not each.deleted]
        if not alive:
            return max(found, key=lambda each: each.deleted, default=None)
        return expect_one(alive)

    async def leave_again(self, order: Order, device: str) -> OrderLeft:
        """Leave an order that was left in a memory without a network, under its key; else as `leave`.

        Args:
            order: as it is there.
            device: name of that memory; empty: it has none.
        """
        now = self._unix()
        request = LeaveOrder(
            key=order.key,
            robot=order.robot,
            identity=order.identity,
            command=order.command,
            arguments=order.arguments,
            begin_within=order.begin_by - now,
            may_take=order.may_take,
            ago=now - order.left,
            device=device,
        )
        return await self._first(request, OrderLeft, pass_on=(NotRemembered,))

    async def take_along(self, names: Sequence[str], device: str) -> tuple[str, Sequence[KnownAgent]]:
        """Return what is remembered of robots, and have the directories know who takes them along.

        Args:
            names: of the robots.
            device: name of the machine that takes them; empty: it has none.

        Returns:
            Whose orders those are that are left there, and what is remembered.

        Raises:
            NoDirectory: none answers.
            NotRemembered: one is not known.
        """
        request = TakeAlong(names=tuple(names), device=device)
        found = await self._first(request, KnownFound, pass_on=(NotRemembered,))
        by = clock_ahead(self._unix(), found.now)
        return found.who, [shifted_known(each, by) for each in found.agents]

    # -- stops ------------------------------------------------------------------------------------

    async def hold(self, robot: str = "") -> tuple[Sequence[str], Sequence[str]]:
        """Keep robots that are away from beginning what was ordered, until a person releases that.

        Args:
            robot: its name; empty: all.

        Returns:
            The names of the directories that hold it, and of those that have not confirmed it.
        """
        asked = self.directories
        answers = await self._all(HoldOrders(id=token(), robot=robot), OrdersFound, urgent=True)
        return [_name(each) for each in answers], [_name(each) for each in asked if each not in answers]

    async def release(self, robot: str = "", *, ago: float = 0.0) -> Sequence[str]:
        """Let robots begin again what was ordered; returns the directories that have not confirmed it.

        Args:
            robot: its name; empty: all.
            ago: [s] since the person gave it: a hold that came later stays.
        """
        asked = self.directories
        answers = await self._all(ReleaseHolds(robot=robot, ago=ago), OrdersFound, urgent=True)
        return [_name(each) for each in asked if each not in answers]

    # -- inside -----------------------------------------------------------------------------------

    async def _all(self, request: AnyRequest, answer: type[_R], *, urgent: bool = False) -> dict[str, _R]:
        """Ask all directories at once; returns the answers by key. One that refuses counts as silent."""
        sender = await self._caller()

        async def one(key: str) -> tuple[str, _R] | None:
            try:
                return key, await ask(
                    self._transport, key, request, answer, timeout=WITHIN, sender=sender, urgent=urgent
                )
            except VrError:
                return None

        found = await asyncio.gather(*map(one, self.directories))
        return dict(each for each in found if each is not None)

    async def _first(
        self, request: AnyRequest, answer: type[_R], *, pass_on: tuple[type[VrError], ...]
    ) -> _R:
        """Ask one directory after the other until one does it.

        Raises:
            NoDirectory: none answers.
            VrError: one has refused; of errors in `pass_on` the last one, if all say so.
        """
        refusal: VrError | None = None
        sender, silent = await self._caller(), list[str]()
        for key in self.directories:
            try:
                return await ask(self._transport, key, request, answer, timeout=WITHIN, sender=sender)
            except pass_on as error:
                refusal = error
            except TransportError:
                silent.append(_name(key))
        if refusal is not None:
            raise refusal
        raise NoDirectory(detail=f" ({', '.join(silent)} did not)" if silent else "")


def _name(key: str) -> str:
    address = Address.parse(key)
    return key if address is None else address.name
