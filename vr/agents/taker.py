"""The robot's side of orders: it fetches them, when it may move, and carries each out once.

An order begins when its robot is here and free, when no stop and no pause is in force, nothing waits, its
controller is there, and no directory says otherwise. The robot writes its intent into the ledger first, then
tells the directories that it takes the order; one in which the order was cancelled meanwhile says so, and
nothing begins. Then it calls its own command under the key of the order, with the rights of the one who left
it. So a robot that is killed at any moment knows on its return what may have begun: its journal or its
controller tells whether it has, else the order is in doubt, and a person decides.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import msgspec

from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import lacking
from robotree.vr.base.errors import (
    Busy,
    CommandInDoubt,
    LeaseError,
    LedgerUnusable,
    Stopped,
    TransportError,
    Unreachable,
    VrError,
)
from robotree.vr.base.order import (
    DIRECTORIES,
    ORDER_NEWS,
    Order,
    OrderHold,
    clock_ahead,
    mark_of,
    merged,
    shifted,
)
from robotree.vr.base.requests import (
    AnyRequest,
    Call,
    Done,
    FetchOrders,
    OrdersChanged,
    OrdersFound,
    Raised,
    Reply,
    Returned,
    RobotDeleted,
    TakeOrder,
    TellOrders,
    decode_event,
)
from robotree.vr.base.transport import Registration, Transport
from robotree.vr.core.machine import RobotState
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.authority import expect_right
from robotree.vr.orders.book import EXPIRED, by_age
from robotree.vr.orders.ledger import Ledger, LedgerEntry
from robotree.vr.running.robot_runtime import NotDescribed, RobotRuntime
from robotree.vr.running.runner import soon

ANSWER_WITHIN = 1.0
"""[s] for a directory to answer a robot."""
LOOK = 5.0
"""[s] between two looks for orders of which no news came."""
LOOK_AGAIN = 0.02
"""[s] between two looks at whether the robot is free, while an order waits."""
LEFT = 2.0
"""[s] of such looks before the orders are fetched anew."""
NOTE = 0.5
"""[s] that the end of a process waits for the end of an order to be written down."""
TOUCHES = 1.0
"""[s] between two notes that a person has commanded the robot."""

LENGTHS = {"x": "m", "y": "m", "z": "m"}
ANGLES = {"twist": "rad", "heading": "rad", "yaw": "rad"}
"""Readings that say where a robot stands, and their units."""
MOVED, TURNED = 0.05, 0.1
"""[m], [rad] by which a robot that is at rest stands elsewhere if somebody has moved it: no controller drifts
so far, and no odometer errs so much."""

_A = TypeVar("_A")
_R = TypeVar("_R", bound=Reply)
_log = logging.getLogger(__name__)


class _Outcome:
    """A listener that waits for the end of an order, in the event loop."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self.reply: asyncio.Future[Returned | Raised] = loop.create_future()

    def note(self, fraction: float, text: str) -> None:
        """Nobody looks."""

    def settle(self, reply: Returned | Raised) -> None:
        _hand_over(self._loop, self.reply, reply)

    def go_elsewhere(self) -> None:
        """Do nothing: a robot does not move while it carries an order out."""


class OrderTaker:
    """Takes the orders of one robot. Lives on the event loop."""

    def __init__(
        self,
        runtime: RobotRuntime,
        transport: Transport,
        ledger: Ledger,
        *,
        unix: Callable[[], float],
        is_open: Callable[[], bool],
    ) -> None:
        """Prepare; `begin` takes orders.

        Args:
            runtime: the robot; it has an identity.
            transport: the way to the directories.
            ledger: its memory; closed by who has opened it.
            unix: returns the time [s] since 1970.
            is_open: returns whether the robot takes anything new.
        """
        self._runtime, self._transport, self._ledger = runtime, transport, ledger
        self._unix, self._is_open = unix, is_open
        self._identity = runtime.identity
        self._loop = asyncio.get_running_loop()
        self._wake = asyncio.Event()
        self._declared: list[Registration] = []
        self._unwatch: Callable[[], None] = _nothing
        self._task: asyncio.Task[None] | None = None
        self._beside = asyncio.TaskGroup()
        """What is told of orders that are over, while the next one is taken: a directory takes its time."""
        self._told: dict[str, set[str]] = {}
        """Which directories know how an order stands, by its key."""
        self._touched = 0.0
        self._moves = False
        """Whether a command has been given since it was last seen at rest."""

    @property
    def has_taken(self) -> bool:
        """Whether it has taken an order that it has not begun or not ended."""
        return any(entry.order.state == "taken" for entry in list(self._ledger.entries.values()))

    async def begin(self) -> None:
        """Take orders from now on."""
        self._runtime.on_call = self._called
        self._declared.append(await self._transport.subscribe(ORDER_NEWS, self._news))
        self._unwatch = self._transport.presence.watch(DIRECTORIES, lambda _key, _there: self._wake.set())
        self._task = self._loop.create_task(self._run(), name=f"orders of {self._runtime.name}")

    async def close(self) -> None:
        """Take none any more; how the one ended that was under way is written down. Twice is once."""
        self._runtime.on_call = None
        task, self._task = self._task, None
        self._unwatch()
        declared, self._declared = self._declared, []
        for registration in declared:
            with contextlib.suppress(VrError):
                await registration.close()
        if task is not None:
            self._wake.set()  # a robot that waits for orders has nothing to write down
            await asyncio.wait([task], timeout=NOTE)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    # -- inside -----------------------------------------------------------------------------------

    def _news(self, key: str, body: bytes) -> None:
        with contextlib.suppress(VrError):
            event = decode_event(body, key=key)
            if isinstance(event, OrdersChanged) and (
                not event.identities or self._identity in event.identities
            ):
                self._wake.set()

    def _called(self, call: Call, reads: bool) -> None:  # noqa: FBT001 # of `RobotRuntime.on_call`
        """Take note that somebody commands the robot other than by an order. In any thread."""
        if reads:
            return
        self._moves = True
        if self._identity in self._ledger.rest:
            soon(self._loop, lambda: self._loop.create_task(self._leave_rest()))
        if call.epoch is not None or call.key in self._ledger.entries:
            return
        now = self._unix()
        if now - self._touched >= TOUCHES:
            self._touched = now
            soon(self._loop, lambda: self._loop.create_task(self._touch(now)))

    async def _touch(self, now: float) -> None:
        with contextlib.suppress(LedgerUnusable):
            await self._written(partial(self._ledger.touch, self._identity, now))

    async def _leave_rest(self) -> None:
        """Take note that the robot is about to move: if it is killed then, nobody has moved it by hand."""
        if self._identity not in self._ledger.rest:
            return
        with contextlib.suppress(LedgerUnusable):
            await self._written(partial(self._ledger.note_rest, self._identity, None))

    def _place(self) -> dict[str, float]:
        """Return where the robot stands; empty: it does not say.

        What a virtual robot reads is its author's code, and it stands where its children do.
        """
        robot = self._runtime.robot
        if isinstance(robot, VirtualRobot):
            return {}
        units = {**LENGTHS, **ANGLES}
        try:
            found = robot.readings()
        except Exception:  # noqa: BLE001 # an author's code
            return {}
        own = robot.reading_units
        return {
            name: float(found[name])
            for name, unit in units.items()
            if own.get(name) == unit and math.isfinite(found.get(name, math.nan))
        }

    async def _notice_hands(self) -> None:
        """Take note if the robot, which nobody has commanded, stands elsewhere than it came to rest.

        It is looked at while nothing runs. Where its controller counts from another beginning after it was
        switched off, it stands elsewhere, too: nobody can tell that apart, so a person is asked.
        """
        rest, place = self._ledger.rest.get(self._identity), self._place()
        under_way = any(
            entry.begun and entry.order.state == "taken" for entry in self._ledger.entries.values()
        )
        if not place or under_way or not self._runtime.robot.online:
            return
        moves, self._moves = self._moves, False
        if not moves and rest is not None:
            if not _elsewhere(rest, place):
                return
            self._runtime.log.say("info", f"{self._runtime.name} was moved by hand since it came to rest")
            await self._written(partial(self._ledger.touch, self._identity, self._unix()))
        await self._written(partial(self._ledger.note_rest, self._identity, place))

    async def _run(self) -> None:
        """Take orders until the robot ends."""
        while self._is_open():
            self._wake.clear()
            more = False
            try:
                more = await self._round()
            except VrError as error:
                _log.warning("%s takes no orders: %s", self._runtime.name, error)
            except Exception:  # noqa: BLE001 # the outermost handler of this task
                _log.exception("%s takes no orders", self._runtime.name)
            if not more and self._is_open():
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(LOOK):
                        await self._wake.wait()

    async def _round(self) -> bool:
        """Look what there is to do, and do it; returns whether there may be more."""
        if not self._runtime.look(lambda state: bool(state.calls.live)):
            await self._notice_hands()
        orders, holds = await self._fetch()
        await self._tell_again(orders)
        self._ledger.forget(self._unix())
        async with asyncio.TaskGroup() as self._beside:
            for order in self._to_do(orders):
                if not self._is_open():
                    return False
                if holds:
                    return False  # their release is news
                if not await self._until_free():
                    return True
                await self._notice_hands()
                if not await self._take(order):
                    return False
        return False

    def _to_do(self, found: dict[str, Order]) -> list[Order]:
        """Return what is to be done: what it has already first, then what waits, the oldest first."""
        mine = {
            key: found.get(key, entry.order)
            for key, entry in self._ledger.entries.items()
            if entry.order.state == "taken" and entry.order.identity == self._identity
        }
        others = [
            order
            for key, order in found.items()
            if key not in self._ledger.entries and order.state in {"waiting", "taken"}
        ]
        return [*sorted(mine.values(), key=by_age), *sorted(others, key=by_age)]

    async def _fetch(self) -> tuple[dict[str, Order], list[OrderHold]]:
        """Ask all directories for what is to be done; of two copies of an order the further one counts."""
        orders: dict[str, Order] = {}
        holds: dict[str, OrderHold] = {}
        for _, found in await self._ask_all(FetchOrders(identity=self._identity), OrdersFound):
            by = clock_ahead(self._unix(), found.now)
            for each in found.orders:
                order = shifted(each, by)
                orders[each.key] = merged(orders[each.key], order) if each.key in orders else order
            holds.update({each.id: each for each in found.holds})
        return orders, list(holds.values())

    async def _tell_again(self, found: dict[str, Order]) -> None:
        """Tell those who did not hear how orders ended."""
        entries = self._ledger.entries
        again = [
            entries[key].order
            for key, order in found.items()
            if key in entries and entries[key].order.over and not order.over
        ]
        if again:
            await self._tell(*again)

    async def _until_free(self) -> bool:
        """Wait until the robot may move; returns whether it may."""
        for _ in range(round(LEFT / LOOK_AGAIN)):
            if not self._is_open():
                return False
            if self._is_free():
                return True
            await asyncio.sleep(LOOK_AGAIN)
        return False

    def _is_free(self) -> bool:
        robot = self._runtime.robot

        def look(state: RobotState) -> bool:
            return (
                state.lease.current is None
                and not state.stop.in_force
                and not state.pause.in_force
                and not state.calls.live
                and not lacking(state.slots.specs())
                and not self._runtime.is_on_way
            )

        known = self._identity not in self._ledger.rest or bool(self._place())
        return robot.online and not robot.halted and known and self._runtime.look(look)

    async def _take(self, order: Order) -> bool:
        """Begin an order, if it may be; returns whether the next one may be looked at."""
        entry, now = self._ledger.entries.get(order.key), self._unix()
        if entry is not None and entry.begun:
            return await self._begin_again(entry)
        if entry is None and order.state == "taken":  # an earlier life took it, and its ledger is lost
            await self._doubt(order, "the robot has lost its memory of what it had begun")
        elif order.cancelled_by:
            await self._refuse(order, f"{order.cancelled_by} cancelled it before it began")
        elif order.state == "waiting" and order.begin_by < now:
            await self._settle(msgspec.structs.replace(order, state="expired", at=now, why=EXPIRED))
        elif question := self._question(order):
            if question != order.asks:
                await self._tell(msgspec.structs.replace(order, asks=question, at=now))
            return False
        elif reason := await self._unfit(order):
            await self._refuse(order, reason)
        elif self._runtime.is_on_way:
            return False
        else:
            taken = msgspec.structs.replace(order, state="taken", at=now, asks="")
            self._runtime.takes_order += 1  # from here on it does not move: only this host knows of it
            try:
                await self._put(LedgerEntry(taken))
                return await self._begin(taken) if await self._confirmed(taken) else False
            finally:
                self._runtime.takes_order -= 1
        return True

    def _question(self, order: Order) -> str:
        """Return what a person must be asked before an order begins; empty: nothing."""
        touched = self._ledger.touched.get(self._identity, 0.0)
        if order.confirmed_by or touched <= order.left:
            return ""
        return f"somebody has commanded or moved {order.robot} since it was ordered; shall it still begin?"

    async def _unfit(self, order: Order) -> str:
        """Return why an order cannot be carried out any more; empty: it can."""
        try:
            spec = await self._spec(order.command)
            if mark_of(spec) != order.mark:
                return f"{order.robot}.{order.command} is not as it was when it was ordered: order it again"
            check_arguments(spec, order.arguments, robot=order.robot)
            if spec.offline != "queue":
                return (
                    f"{order.robot}.{order.command} cannot be ordered any more: its author does not allow it"
                )
            here = self._runtime.here
            expect_right(order.principal, "order", here.target(order.command), here.gate)
        except TransportError:
            raise
        except VrError as error:
            return str(error)
        return ""

    async def _spec(self, command: str) -> Any:
        """Return the command of a name as others see it; a child is asked for it if it is not known."""
        try:
            return self._runtime.spec(command)
        except NotDescribed as unknown:
            asked: asyncio.Future[VrError | None] = self._loop.create_future()
            self._runtime.describe_child(unknown, partial(_hand_over, self._loop, asked))
            if (error := await asked) is not None:
                raise error from None
            return self._runtime.spec(command)

    async def _confirmed(self, order: Order) -> bool:
        """Tell all directories that an order is about to begin; returns whether it may.

        One that answers at least must know it as taken, none may know it as over, and nothing may hold it.
        """
        request = TakeOrder(key=order.key, identity=self._identity)
        answers = await self._ask_all(request, OrdersFound)
        copies = [copy for _, found in answers for copy in found.orders]
        ended = next((copy for copy in copies if copy.over), None)
        cancelled = next((copy for copy in copies if copy.cancelled_by), None)
        if cancelled is not None:
            await self._refuse(
                msgspec.structs.replace(order, cancelled_by=cancelled.cancelled_by),
                f"{cancelled.cancelled_by} cancelled it before it began",
            )
            return False
        if ended is not None:
            await self._refuse(order, ended.why or f"it was {ended.shown} before it began")
            return False
        if any(found.holds for _, found in answers):
            return False
        return any(copy.state == "taken" for copy in copies)

    async def _begin_again(self, entry: LedgerEntry) -> bool:
        """Find out about an order that had begun when the robot was killed; carry it out if it was not."""
        order, runtime = entry.order, self._runtime
        try:
            spec = await self._spec(order.command)
        except VrError as error:
            await self._doubt(order, str(error))
            return True
        if runtime.process.journal is not None or spec.effect != "once":
            return await self._begin(order)  # the journal knows the key; or it may be repeated
        if entry.witness and runtime.robot.witness:
            return await self._begin(order, witness=entry.witness)
        await self._doubt(
            order,
            f"the process of {order.robot} ended in the middle, and nobody else knows if it was done: look,"
            " and order it again if it was not",
        )
        return True

    def _call(self, order: Order, witness: str = "") -> Call:
        return Call(
            key=order.key,
            command=order.command,
            arguments=order.arguments,
            caller=f"order {order.ticket} of {order.who}",
            deadline=order.may_take,
            witness=witness,
        )

    async def _begin(self, order: Order, witness: str = "") -> bool:
        """Carry an order out under its key; returns whether the next one may be looked at."""
        runtime, outcome = self._runtime, _Outcome(self._loop)
        before = self._ledger.entries[order.key]
        await self._put(LedgerEntry(order, begun=True, witness=witness or runtime.robot.witness))
        ends = runtime.process.runner.now() + order.may_take
        runtime.ordered = frozenset({order.key})
        try:
            runtime.admit(self._call(order, witness), ends, order.principal, listener=outcome)
        except (LeaseError, Stopped, Busy, Unreachable):  # somebody else was quicker: it is not over
            await self._put(before)
            return False
        except VrError as error:
            await self._refuse(order, str(error))
            return True
        await self._settle(await self._ended(order, outcome))
        return True

    async def _ended(self, order: Order, outcome: _Outcome) -> Order:
        """Wait for the end of an order; meanwhile somebody may cancel it."""
        reply = outcome.reply
        self._wake.clear()
        while not reply.done():
            news = self._loop.create_task(self._wake.wait())
            both: set[asyncio.Future[Any]] = {reply, news}
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
            news.cancel()
            if reply.done() or not self._wake.is_set():
                continue
            self._wake.clear()
            found, _ = await self._fetch()
            copy = found.get(order.key)
            if copy is not None and copy.cancelled_by and not order.cancelled_by:
                order = msgspec.structs.replace(order, cancelled_by=copy.cancelled_by)
                with contextlib.suppress(VrError):
                    self._runtime.cancel(order.key, f"{copy.cancelled_by} cancelled the order")
        self._wake.set()  # more may have come meanwhile
        return _ended(order, reply.result(), self._unix())

    async def _refuse(self, order: Order, reason: str) -> None:
        await self._settle(msgspec.structs.replace(order, state="refused", at=self._unix(), why=reason))

    async def _doubt(self, order: Order, reason: str) -> None:
        await self._settle(msgspec.structs.replace(order, state="doubt", at=self._unix(), why=reason))

    async def _settle(self, order: Order) -> None:
        """Write down how an order ended, and tell the directories."""
        await self._put(LedgerEntry(order))
        if order.state in {"done", "failed", "doubt"}:
            await self._leave_rest()
        self._runtime.log.say(
            "info", f"order {order.ticket} of {order.who} ({order.command}) is {order.shown}"
        )
        self._runtime.takes_order += 1
        self._beside.create_task(self._tell_beside(order))

    async def _tell_beside(self, order: Order) -> None:
        try:
            await self._tell(order)
        finally:
            self._runtime.takes_order -= 1

    async def _put(self, entry: LedgerEntry) -> None:
        await self._written(partial(self._ledger.put, entry))

    async def _written(self, write: Callable[[], None]) -> None:
        """Write into the ledger; one that is cancelled meanwhile has written."""
        if self._ledger.slow:
            await asyncio.shield(asyncio.to_thread(write))
        else:
            write()

    async def _tell(self, *orders: Order) -> None:
        answers = await self._ask_all(TellOrders(orders=orders, now=self._unix()), OrdersFound)
        if not answers and self._transport.presence.keys(DIRECTORIES):
            self._wake.set()

    async def _ask_all(self, request: AnyRequest, answer: type[_R]) -> list[tuple[str, _R]]:
        """Ask all directories at once; returns who answered what."""
        return await _ask_all(self._transport, request, answer, self._runtime.key)


async def say_deleted(transport: Transport, identity: str, sender: str) -> None:
    """Tell the directories that a robot is deleted: it never comes back.

    Args:
        transport: the way there.
        identity: under which they remember it.
        sender: its key.
    """
    await _ask_all(transport, RobotDeleted(identity=identity), Done, sender)


async def _ask_all(
    transport: Transport, request: AnyRequest, answer: type[_R], sender: str
) -> list[tuple[str, _R]]:
    async def one(key: str) -> tuple[str, _R] | None:
        try:
            return key, await ask(transport, key, request, answer, timeout=ANSWER_WITHIN, sender=sender)
        except VrError:
            return None

    keys = transport.presence.keys(DIRECTORIES)
    return [found for found in await asyncio.gather(*map(one, keys)) if found is not None]


def _ended(order: Order, reply: Returned | Raised, now: float) -> Order:
    """Return an order whose command has ended."""
    if isinstance(reply, Returned):
        value = msgspec.to_builtins(reply.value, builtin_types=(bytes,))
        return msgspec.structs.replace(order, state="done", at=now, value=value, asks="")
    error = reply.revive()
    state = "doubt" if isinstance(error, CommandInDoubt) else "failed"
    return msgspec.structs.replace(order, state=state, at=now, why=str(error), asks="")


def _hand_over(loop: asyncio.AbstractEventLoop, asked: asyncio.Future[_A], answer: _A) -> None:
    """Hand an answer over to the event loop; from any thread."""

    def hand() -> None:
        if not asked.done():
            asked.set_result(answer)

    soon(loop, hand)


def _elsewhere(rest: dict[str, float], place: dict[str, float]) -> bool:
    """Whether two places of a robot differ by more than it can drift; angles go round."""
    for name in rest.keys() & place.keys():
        by = place[name] - rest[name]
        if name in LENGTHS and abs(by) > MOVED:
            return True
        if name in ANGLES and abs(math.remainder(by, 2 * math.pi)) > TURNED:
            return True
    return False


def _nothing() -> None:
    """Nothing is declared."""
