"""A directory as an agent: it remembers robots, keeps orders and results, and shares both with the others.

It follows presence, and asks each robot once for its description; what a robot publishes later is kept with
its age. Orders are written before they are acknowledged. All that changes here goes to the other directories
at once; to one that comes, or did not answer, everything goes.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Awaitable, Callable, Generator, Iterable, Sequence
from typing import Any

import msgspec

from robotree.vr.base.address import Address, everyone
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import DirectoryUnusable, VrError
from robotree.vr.base.order import DIRECTORIES, KnownAgent, Order
from robotree.vr.base.policy import PolicyTarget
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import (
    CancelOrder,
    ConfirmOrder,
    Done,
    FetchOrders,
    HoldOrders,
    KnownFound,
    LeaveOrder,
    Listed,
    MarkSeen,
    OrderLeft,
    OrdersChanged,
    OrdersFound,
    ReadKnown,
    ReadOrders,
    RecordsShared,
    ReleaseHolds,
    Reply,
    RobotDeleted,
    ShareRecords,
    State,
    TakeAlong,
    TakeOrder,
    TellOrders,
    decode_event,
    encode,
)
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.authority import Here, expect_right
from robotree.vr.exchange.claim import Declarations, claim
from robotree.vr.exchange.client import RobotClient, ViewClient
from robotree.vr.exchange.dispatcher import Dispatcher, not_for
from robotree.vr.orders.book import OrderBook, OrderNews
from robotree.vr.orders.store import OrderStore

SHARE_WITHIN = 1.0
"""[s] for another directory to confirm a record, while somebody waits for it."""
LOOK_WITHIN = 2.0
"""[s] for a robot to describe itself."""
SWEEP = 1.0
"""[s] between two looks for what has expired, and for directories that are behind."""
FLUSH = 5.0
"""[s] after which readings of robots that are here are written."""
REFRESH = 30.0
"""[s] between two pictures of a view, and between two calls of a command that is remembered."""
ANSWER_IN = 5.0
"""[s] that such a command may take."""
PORTION = 100
"""Records in one message."""
PICTURE = (320, 180)
"""[px]"""

_log = logging.getLogger(__name__)


class DirectoryService:
    """See the module."""

    def __init__(
        self,
        transport: Transport,
        name: str,
        store: OrderStore,
        *,
        unix: Callable[[], float] = time.time,
        site: str = "",
    ) -> None:
        """Prepare, on the event loop.

        Args:
            transport: where it serves.
            name: under which people know it.
            store: its memory; closed by who has opened it.
            unix: returns the time [s] since 1970.
            site: name of this machine in a realm of several; empty: there is one machine.
        """
        self.address = Address("directory", name, store.id)
        self.book = OrderBook(name, store, unix, site=site)
        self.book.here = lambda agent: agent.identity in self._here.values()
        self._transport, self._store, self._unix = transport, store, unix
        self._clock = asyncio.get_running_loop().time
        self._declared = Declarations()
        self._tasks: dict[asyncio.Future[Any], None] = {}
        self._here: dict[Address, str] = {}
        """Identity of each robot and view that is here."""
        self._read: dict[str, KnownAgent] = {}
        """What has been read since the last time that it was written, by identity."""
        self._asked: dict[str, dict[str, float]] = {}
        """How each robot read when its commands that are remembered were called last, by identity."""
        self._busy: dict[str, str] = {}
        """What each robot carries out, by identity: when it is done, what it answers is another thing."""
        self._behind: dict[str, None] = {}
        """Keys of directories that may lack something."""
        self._answers: dict[type[Any], Callable[[Any, Principal], Reply | Awaitable[Reply]]] = {
            LeaveOrder: self._leave,
            CancelOrder: self._cancel,
            ConfirmOrder: self._confirm,
            ReadOrders: lambda request, asker: self.book.find(request, self.book.owner_of(asker)),
            MarkSeen: self._seen,
            FetchOrders: lambda request, _: self.book.fetch(request.identity),
            TakeOrder: self._take,
            TellOrders: self._tell,
            ReadKnown: self._known,
            TakeAlong: self._take_along,
            HoldOrders: self._hold,
            ReleaseHolds: self._release,
            RobotDeleted: self._deleted,
            ShareRecords: self._share,
        }

    async def start(self) -> None:
        """Serve, then be there, then look around.

        Raises:
            DuplicateName: another directory has this name.
            TransportError: the transport does not work.
        """
        transport = self._transport
        async with Declarations() as declared:
            declared.push_async_callback(self._end_work)
            here = Here("directory", self.address.name, transport.gate)
            dispatcher = Dispatcher(self.address.name, self._answer, now=self._clock, here=here)
            await declared.keep(transport.serve(self.address.key, dispatcher.take))
            await declared.keep(claim(transport, self.address))
            await declared.keep(transport.subscribe(f"{everyone('robot')}/state", self._state))
            await declared.keep(transport.subscribe(f"{everyone('lookup')}/news", self._listed))
            for pattern, look in (
                (everyone("robot"), self._met),
                (everyone("view"), self._met),
                (DIRECTORIES, self._other),
            ):
                declared.callback(transport.presence.watch(pattern, look))
            for work in (self._sweep(), self._flush(), self._refresh()):
                self._do(work)
            self._declared = declared.pop_all()

    async def close(self) -> None:
        """End it. Twice is once."""
        await self._declared.aclose()

    async def _end_work(self) -> None:
        tasks = list(self._tasks)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with contextlib.suppress(VrError):
            self._write_readings()

    # -- requests ---------------------------------------------------------------------------------

    def _answer(self, received: Received, _: object) -> Reply | Awaitable[Reply]:
        answer = self._answers.get(type(received.request))
        if answer is None:
            raise not_for("directory", received.request)
        return answer(received.request, received.principal)

    async def _leave(self, request: LeaveOrder, principal: Principal) -> Reply:
        order = self.book.leave(request, principal)
        self._expect(principal, "order", order.robot, order.command)
        return await self._acknowledged(order)

    async def _cancel(self, request: CancelOrder, principal: Principal) -> Reply:
        order = self.book.order(request.key)
        if order.who.partition("/")[0] != self.book.owner_of(principal):
            self._expect(principal, "order", order.robot, order.command)
        return await self._acknowledged(self.book.cancel(request.key, _name_of(principal)))

    async def _confirm(self, request: ConfirmOrder, principal: Principal) -> Reply:
        order = self.book.order(request.key)
        self._expect(principal, "order", order.robot, order.command)
        by = _name_of(principal)
        if request.outcome:
            return await self._acknowledged(self.book.settle(request.key, request.outcome, by))
        return await self._acknowledged(self.book.confirm(request.key, by))

    def _expect(self, principal: Principal, right: str, robot: str, command: str = "") -> None:
        """Check a right on a robot that may be away.

        Raises:
            Denied: the policy does not allow it.
        """
        gate = self._transport.gate
        found = (each for each in self._store.agents.values() if each.name == robot and each.robot)
        kinds = next((each.robot.kinds for each in found if each.robot), ())
        expect_right(principal, right, PolicyTarget(robot, "robot", kinds, command, gate.site), gate)

    async def _acknowledged(self, order: Order) -> OrderLeft:
        """Keep an order and give it to all others; returns who has it, and who may have another copy.

        Those to whom it goes are noted before it goes: a cancel knows whom to ask.
        """
        others = self._others()
        labels = {self.book.label, *map(_label, others)}
        holders = tuple(sorted({*order.holders, *labels}))
        order = msgspec.structs.replace(order, holders=holders)
        self._spread_later(self.book.keep(orders=[order]), without=others)
        kept = self._store.orders[order.key]
        news = OrderNews(orders=(kept,))
        answered = await asyncio.gather(*(self._give(key, news, within=SHARE_WITHIN) for key in others))
        confirmed = {self.book.label, *(_label(key) for key, ok in zip(others, answered, strict=True) if ok)}
        kept = self._store.orders[order.key]
        return OrderLeft(
            order=kept,
            now=self._unix(),
            confirmed=tuple(sorted(confirmed)),
            unconfirmed=tuple(sorted(set(kept.holders) - confirmed)),
        )

    def _seen(self, request: MarkSeen, principal: Principal) -> Reply:
        self._spread_later(self.book.seen(request.keys, self.book.owner_of(principal)))
        return Done()

    def _take(self, request: TakeOrder, _: Principal) -> Reply:
        found, news = self.book.take(request.key, request.identity)
        self._spread_later(news)
        return found

    def _tell(self, request: TellOrders, _: Principal) -> Reply:
        found, news = self.book.tell(request)
        self._spread_later(news)
        return found

    def _known(self, request: ReadKnown, _: Principal) -> Reply:
        if not request.brief:
            self._write_readings()
        return KnownFound(now=self._unix(), agents=tuple(self.book.known(request)))

    def _take_along(self, request: TakeAlong, principal: Principal) -> Reply:
        self._write_readings()
        who = self.book.owner_of(principal, request.device)
        for name in request.names:
            self._expect(principal, "order", name)
        agents = tuple(self.book.robot(name) for name in request.names)
        self._spread_later(self.book.take_along(request.names, who))
        return KnownFound(now=self._unix(), agents=agents, who=who)

    def _hold(self, request: HoldOrders, principal: Principal) -> Reply:
        self._spread_later(self.book.hold(request, _name_of(principal)))
        return OrdersFound(now=self._unix(), holds=self.book.holds())

    def _release(self, request: ReleaseHolds, principal: Principal) -> Reply:
        self._expect(principal, "resume", request.robot or "*")
        self._spread_later(self.book.release(request, _name_of(principal)))
        return OrdersFound(now=self._unix(), holds=self.book.holds())

    def _deleted(self, request: RobotDeleted, _: Principal) -> Reply:
        self._read.pop(request.identity, None)
        self._spread_later(self.book.deleted(request.identity))
        return Done()

    def _share(self, request: ShareRecords, _: Principal) -> Reply:
        shared, news = self.book.share(request)
        self._publish(news)
        return shared

    # -- the other directories --------------------------------------------------------------------

    def _others(self) -> list[str]:
        mine = self.address.key
        return [key for key in self._transport.presence.keys(DIRECTORIES) if key != mine]

    def _other(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        if there and key != self.address.key:
            self._behind[key] = None
            self._do(self._catch_up(key))
        elif not there:
            self._behind.pop(key, None)

    async def _catch_up(self, key: str) -> None:
        """Give another directory everything; it does the same."""
        self._behind.pop(key, None)
        self._write_readings()
        store = self._store
        records: list[OrderNews] = [
            *(OrderNews(orders=part) for part in _portions(store.orders.values())),
            *(OrderNews(agents=part) for part in _portions(store.agents.values())),
            *(OrderNews(holds=part) for part in _portions(store.holds.values())),
        ]
        for part in records:
            if part.orders:  # it holds them from now on
                held = [
                    msgspec.structs.replace(each, holders=tuple(sorted({*each.holders, _label(key)})))
                    for each in part.orders
                    if not each.over
                ]
                self.book.keep(orders=held)
                part = OrderNews(orders=tuple(store.orders[each.key] for each in part.orders))  # noqa: PLW2901
            if not await self._give(key, part, within=LOOK_WITHIN):
                return

    async def _give(self, key: str, news: OrderNews, *, within: float) -> bool:
        """Give another directory records, and take what is further on there; returns whether it has them."""
        request = ShareRecords(now=self._unix(), orders=news.orders, agents=news.agents, holds=news.holds)
        try:
            shared = await ask(
                self._transport, key, request, RecordsShared, timeout=within, sender=self.address.key
            )
        except VrError:
            if self._transport.presence.lives(key):
                self._behind[key] = None
            return False
        back = ShareRecords(now=shared.now, orders=shared.orders, agents=shared.agents, holds=shared.holds)
        _, changed = self.book.share(back)
        self._spread_later(changed, without=[key])
        return True

    def _spread_later(self, news: OrderNews, without: Sequence[str] = ()) -> None:
        """Give what has changed to all others but some, and tell everybody that it has."""
        self._publish(news)
        if news:
            for key in self._others():
                if key not in without:
                    self._do(self._give(key, news, within=LOOK_WITHIN))

    def _publish(self, news: OrderNews) -> None:
        if not (news.orders or news.holds):
            return
        identities = () if news.holds else tuple(sorted({each.identity for each in news.orders}))
        results = sum(each.over and not each.seen for each in news.orders)
        with contextlib.suppress(VrError):  # the transport is closing
            self._transport.publish(
                f"{self.address.key}/orders", encode(OrdersChanged(identities=identities, results=results))
            )

    # -- what it remembers ------------------------------------------------------------------------

    def _met(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        address = Address.parse(key)
        if address is None:
            return
        if there:
            self._here.setdefault(address, "")
            self._do(self._describe(address))
            return
        identity = self._here.pop(address, "")
        self._asked.pop(identity, None)
        self._busy.pop(identity, None)
        known = self._latest(identity)
        if known is not None:
            self._read.pop(identity, None)
            gone = msgspec.structs.replace(known, seen=self._unix())
            self._spread_later(self.book.keep(agents=[gone]))

    def _latest(self, identity: str) -> KnownAgent | None:
        return self._read.get(identity) or self._store.agents.get(identity)

    async def _describe(self, address: Address) -> None:
        """Ask an agent who it is, and keep that at once, here and elsewhere."""
        try:
            if address.role == "view":
                await self._look_at(address)
                return
            robot = await RobotClient(
                self._transport, address, patience=LOOK_WITHIN, sender=self.address.key
            ).describe()
        except VrError:
            return  # it has gone, or hangs: it is asked again when it answers
        if address not in self._here:
            return
        now, identity = self._unix(), robot.identity or f"name:{address.name}"
        self._here[address] = identity
        known = KnownAgent(
            name=address.name,
            identity=identity,
            robot=robot,
            described=now,
            readings=_finite(robot.readings),
            read=now,
            online=robot.online,
            seen=now,
        )
        self._read.pop(identity, None)
        self._spread_later(self.book.keep(agents=[known]))
        if identity not in self._asked and robot.online:
            await self._remember(address, robot)

    async def _look_at(self, address: Address) -> None:
        width, height = PICTURE
        client = ViewClient(self._transport, address)
        view = await client.describe()
        picture = await client.look(width=width, height=height, quality=60)
        if address in self._here:
            now, identity = self._unix(), f"view:{address.name}"
            self._here[address] = identity
            known = KnownAgent(
                role="view",
                name=address.name,
                identity=identity,
                described=now,
                readings=_finite(view.readings),
                read=now,
                picture=picture.jpeg,
                pictured=now,
                seen=now,
            )
            self._spread_later(self.book.keep(agents=[known]))

    async def _remember(self, address: Address, robot: RobotDescription) -> None:
        """Call what only reads and may be remembered, unless the robot reads as it did the last time."""
        before = self._latest(self._here.get(address, ""))
        if before is None or self._asked.get(before.identity) == before.readings:
            return
        self._asked[before.identity] = before.readings
        client = RobotClient(self._transport, address, patience=LOOK_WITHIN, sender=self.address.key)
        for spec in robot.commands:
            if spec.offline != "memory" or not spec.available or spec.effect != "read":
                continue
            try:
                value = await client.call(spec.name, {}, deadline=ANSWER_IN, caller=self.address.name)
            except VrError:
                self._asked.pop(before.identity, None)  # its controller is not there yet: once more later
                continue
            known = self._latest(self._here.get(address, ""))
            if known is not None:
                answers = {**known.answers, spec.name: (self._unix(), value)}
                self._read[known.identity] = msgspec.structs.replace(known, answers=answers)

    def _listed(self, key: str, body: bytes) -> None:
        """Ask a robot anew whose listing has changed."""
        with contextlib.suppress(VrError):
            event = decode_event(body, key=key)
            if isinstance(event, Listed) and event.listing.address in self._here:
                self._do(self._describe(event.listing.address))

    def _state(self, key: str, body: bytes) -> None:
        address = Address.parse(key.rpartition("/")[0])
        known = None if address is None else self._latest(self._here.get(address, ""))
        if address is None or known is None or known.robot is None:
            return
        with contextlib.suppress(VrError):  # of another version
            state = decode_event(body, key=key)
            if isinstance(state, State):
                now = self._unix()
                self._read[known.identity] = msgspec.structs.replace(
                    known, readings=_finite(state.readings), read=now, seen=now, online=state.online
                )
                done = self._busy.pop(known.identity, "")
                if state.busy:
                    self._busy[known.identity] = state.busy
                back = not known.online and known.identity not in self._asked
                if state.online and (back or (done and done != state.busy)):
                    self._do(self._remember(address, known.robot))

    def _write_readings(self) -> None:
        read, self._read = self._read, {}
        if read:
            self.book.keep(agents=read.values())

    # -- what goes on -----------------------------------------------------------------------------

    async def _sweep(self) -> None:
        while True:
            await asyncio.sleep(SWEEP)
            with self._noted():
                self._spread_later(self.book.sweep())
            for key in list(self._behind):
                if self._transport.presence.there(key):
                    self._do(self._catch_up(key))

    async def _flush(self) -> None:
        while True:
            await asyncio.sleep(FLUSH)
            with self._noted():
                self._write_readings()

    async def _refresh(self) -> None:
        while True:
            await asyncio.sleep(REFRESH)
            for address, identity in list(self._here.items()):
                known = self._latest(identity)
                with contextlib.suppress(VrError):
                    if address.role == "view":
                        await self._look_at(address)
                    elif known is None:
                        await self._describe(address)
                    elif known.robot is not None:
                        await self._remember(address, known.robot)

    @contextlib.contextmanager
    def _noted(self) -> Generator[None]:
        try:
            yield
        except VrError as error:
            self._say(error)

    def _say(self, error: BaseException) -> None:
        """Tell people what went wrong; that nothing is kept, once until something is."""
        if str(error) != self.book.store.trouble:
            _log.warning("%s", error)
        if isinstance(error, DirectoryUnusable):
            self.book.store.trouble = str(error)

    def _do(self, work: Awaitable[Any]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks[task] = None
        task.add_done_callback(self._ended)

    def _ended(self, task: asyncio.Future[Any]) -> None:
        self._tasks.pop(task, None)
        if not task.cancelled() and (error := task.exception()) is not None:
            self._say(error)


def _label(key: str) -> str:
    """Return the name of a directory among those that hold an order."""
    _, name, id_ = key.split("/")
    return f"{name}.{id_[:4]}"


def _portions(records: Iterable[Any]) -> list[tuple[Any, ...]]:
    found = list(records)
    return [tuple(found[at : at + PORTION]) for at in range(0, len(found), PORTION)]


def _finite(readings: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in readings.items() if math.isfinite(value)}


def _name_of(principal: Principal) -> str:
    """Return who asks, for people."""
    address = Address.parse(principal.agent)
    return principal.person or (principal.user if address is None else address.name)
