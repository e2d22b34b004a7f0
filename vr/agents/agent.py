"""The agent of one robot: answers for it, keeps its bonds, shows the others how it is.

Calls of its commands do not come this way: they are taken in the thread that reads the network
(`outside.py`). Everything here runs on the event loop and never waits for an author's code; a request that
only concerns leases, stops or descriptions is answered when it comes, whatever the robot is doing.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import Awaitable, Callable, Iterable, Sequence
from functools import partial
from typing import Any

import msgspec

from robotree.vr.agents.callers import ARRIVAL, GONE, Callers, Drills
from robotree.vr.agents.children import ChildKeeper
from robotree.vr.agents.hooks import Hooks
from robotree.vr.agents.looking_around import Choosing, LentRoles
from robotree.vr.agents.outside import OutsideCalls
from robotree.vr.agents.publisher import Publisher
from robotree.vr.agents.shared import Beside, Shared
from robotree.vr.agents.stops import Stops
from robotree.vr.agents.streams import Streams
from robotree.vr.agents.taker import OrderTaker, say_deleted
from robotree.vr.author.fitting import misfit
from robotree.vr.author.robot import Robot
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, Placement, RobotDescription
from robotree.vr.base.envelope import Received, opened
from robotree.vr.base.errors import (
    CommandFailed,
    ControlRefused,
    CycleOfBonds,
    DoesNotFit,
    NotAllowed,
    NotFree,
    NotInControl,
    NotVirtual,
    ReloadWaits,
    StillBonded,
    TransportError,
    Unreachable,
    VrError,
    WrongKind,
)
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.presence import Undo
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import (
    STOPPED,
    Accepted,
    AnyRequest,
    Call,
    Cancel,
    Continue,
    Decide,
    Delete,
    Describe,
    Described,
    Disturb,
    Done,
    Enslave,
    Free,
    Granted,
    Logged,
    Moved,
    Pause,
    Petition,
    Raised,
    ReadEvents,
    ReadLog,
    Release,
    Renew,
    Reply,
    Resume,
    Retract,
    SafeStop,
    SetControl,
    SetPlacement,
    State,
    StreamSample,
    TakeStep,
    VerifyEvents,
    decode_event,
    encode,
)
from robotree.vr.base.transport import Incoming, Registration, Transport
from robotree.vr.core import events as on
from robotree.vr.core.bonds import DEFAULT_TERM, GrantedLease, Slots
from robotree.vr.core.events import CoreEffect, LeaseChanged, LeaseEnded
from robotree.vr.core.machine import Calls, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.exchange.claim import SETTLE, claim, new_address
from robotree.vr.exchange.dispatcher import Dispatcher, SendReply, not_for
from robotree.vr.history.writer import HistoryWriter, answer_of
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.orders.ledger import OrderMemory
from robotree.vr.running.activity import execute
from robotree.vr.running.frame import LONGEST_END
from robotree.vr.running.ice import Ice
from robotree.vr.running.process import Process
from robotree.vr.running.robot_runtime import NotDescribed, OnDescribed, RobotRuntime
from robotree.vr.running.runner import runner_of, soon

PARTING = 0.5
"""[s] in which commands may end by themselves when their robot's process ends; the others end with it."""

WHO_PLACES: dict[Placement, str] = {
    "manual": "people alone",
    "advise": "people, and says where it would be better off",
    "auto": "its host, which moves it where its calls take less time",
}

_AT_THE_END = (Describe, Release, SafeStop, Delete)
"""Requests that it answers also while it ends."""

_ON_WAY = (Describe, ReadLog, Renew)
"""Requests that it answers also while it is on its way to another host; all others are held."""

_TAKE_TIME = (SafeStop, Resume, Enslave, Free, Delete, TakeStep, ReadEvents, VerifyEvents)
"""Requests whose answers wait for something."""

_log = logging.getLogger(__name__)


class RobotAgent:
    """One incarnation of a robot among the agents."""

    def __init__(  # noqa: PLR0913 # what it shares with others, and what injects time
        self,
        robot: Robot,
        transport: Transport,
        *,
        registrar: Registrar | None = None,
        term: float = DEFAULT_TERM,
        unix: Callable[[], float] | None = None,
        obeyed: Callable[[], int | None] | None = None,
        process: Process | None = None,
        shared: Shared | None = None,
        state: RobotState | None = None,
        orders: OrderMemory | None = None,
        history: HistoryWriter | None = None,
    ) -> None:
        """Make the agent, on the event loop; `start` lets it live.

        Args:
            robot: what it answers for.
            transport: the way to the others.
            registrar: where it is listed while nobody has enslaved it.
            term: [s] of leases, those it grants and those it asks for.
            unix: returns seconds since 1970, and epochs come from it; None: the clock of the process.
            obeyed: returns the epoch that what is behind the robot obeys; None: it was not heard yet.
            process: whose threads carry its commands out; None: one of its own.
            shared: what it shares with the other agents of its process; None: it is the only one.
            state: of the robot when its process ended, to go on with (`take_back`); None: it is a new one.
            orders: its memory of its orders; None: it takes none.
            history: what it keeps of what the robot did, and is asked for; None: its host does, or nobody.

        Raises:
            TypeError: the robot's class declares a command in a way that cannot be called from afar.
        """
        self.transport = transport
        self.address = new_address("robot", robot.name) if state is None else state.address
        self.closed = asyncio.Event()
        """Set when it has ended, for whatever reason."""
        self.on_gone: Callable[[], None] = lambda: None
        """Called when it has ended, before anybody is told."""
        self.on_stop: Callable[[str, str], None] = lambda _reason, _order: None
        """Told of each protective stop when it comes: its reason, and the order that it is part of."""
        self.open = False
        """Whether it takes anything new."""
        self._loop = asyncio.get_running_loop()
        self._process = Process(runner_of(self._loop)) if process is None else process
        self._owns_process = process is None
        self._shared = Shared() if shared is None else shared
        self._unix, self._history = unix or self._process.runner.unix, history
        self._restored = state is not None
        self.runtime = self._new_runtime(robot, state, term, obeyed)
        self._hooks = Hooks(robot, self._process.runner, partial(self.runtime.say, ""))
        self._publisher = self._new_publisher(registrar)
        self._children = self._new_children(term) if isinstance(robot, VirtualRobot) else None
        self._stops = Stops(self.runtime, self._hooks, self._children)
        self._callers = Callers(self.runtime, transport.presence)
        self._outside = OutsideCalls(
            self.runtime, is_open=lambda: self.open, attend=self._callers.attend, waits=self._restored
        )
        self._taker = None if orders is None else self._new_taker(orders)
        self._begin_life()

    def _new_publisher(self, registrar: Registrar | None) -> Publisher:
        self._streams = Streams(self.robot, self.address, self.transport, self._process.runner)
        return Publisher(self.runtime, self._hooks, self.transport, self._shared, registrar, self._streams)

    def _new_taker(self, orders: OrderMemory) -> OrderTaker:
        self.runtime.identity, ledger = orders.identity or self.address.incarnation, orders.ledger
        return OrderTaker(self.runtime, self.transport, ledger, unix=self._unix, is_open=lambda: self.open)

    @property
    def robot(self) -> Robot:
        """The robot that it answers for; another one after a reload."""
        return self.runtime.robot

    def _new_runtime(
        self, robot: Robot, state: RobotState | None, term: float, obeyed: Callable[[], int | None] | None
    ) -> RobotRuntime:
        granted = GrantedLease.free(robot.name, term=term, unix=self._unix())
        return RobotRuntime(
            robot,
            self._process.core(state or _new_state(robot, self.address, self._shared.host, granted)),
            self._process,
            execute=execute,
            transport=self.transport,
            describe_child=self._describe_child,
            follow_child=self._follow_child,
            obeyed=obeyed,
            on_effect=self._take_effect,
        )

    def _new_children(self, term: float) -> ChildKeeper:
        return ChildKeeper(self.runtime, self.transport, term=term)

    def _begin_life(self) -> None:
        """Nothing is declared and nothing watched yet."""
        self._choosing: Choosing | None = None
        if self._children is not None:
            self._choosing = Choosing(self.runtime, self._children, self.transport, self._shared)
            self._children.on_room = self._choosing.wake
        self._lent_roles = LentRoles(self.runtime, self.transport, self._shared)
        self._drills = Drills(self.runtime, self.transport.presence)
        self.brings: Callable[[Address], bool] = lambda _: False
        """Whether a robot is one that this one has brought along."""
        self.before_end: Callable[[], Awaitable[None]] | None = None
        """Ends those, before the robot is deleted."""
        self._deleted = False
        self._known_to_parent: tuple[tuple[CommandSpec, ...], str] = ((), "")
        """The commands of which the parent knows."""
        self._declared: list[Registration] = []
        self._presence: Registration | None = None
        self._unwatch_parent: Undo = lambda: None
        self._ending: asyncio.Task[None] | None = None
        self._gone: asyncio.Future[None] = self._loop.create_future()
        self._farewells: list[Callable[[str], None]] = []
        self._asides = Beside()

    # -- coming and going -------------------------------------------------------------------------

    async def start(self) -> None:
        """Serve requests, then be present, then enter the lookup.

        Raises:
            DuplicateName: a living robot has this name.
            TransportError: the transport does not work.
        """
        self.open = True
        try:
            dispatcher = Dispatcher(
                self.robot.name,
                self._answer,
                now=self._process.runner.now,
                at_once=self._outside.answers,
                allow=self.runtime.authorise,
                here=self.runtime.here,
            )
            self._dispatcher = dispatcher
            rank = self.runtime.look(lambda state: state.moves)
            self._declared.append(await self.transport.serve(self.address.key, self._take, rank=rank))
            self._declared.append(await self.transport.watch_itself(self._cut_off))
            if self.runtime.came:  # it has its name already, in the host that it leaves
                self._presence = await self.transport.announce(self.address.key)
                await self.transport.settle(SETTLE)
            else:
                self._presence = await claim(self.transport, self.address)
        except BaseException:
            self.open = False
            await self._withdraw()
            self._close_process()
            raise
        self._process.robots[self.address] = self.runtime
        if not self._restored:
            self.runtime.post(on.Restored())  # a new state has nothing to go on with
        self._publisher.begin()
        if not self._restored:
            if self._taker is not None:
                await self._taker.begin()
            self._look_around()

    def _look_around(self) -> None:
        """Look from now on who lends it roles, and whom it chooses."""
        self._lent_roles.begin()
        if self._choosing is not None:
            self._choosing.begin()

    async def _look_no_more(self) -> None:
        await self._lent_roles.close()
        if self._choosing is not None:
            await self._choosing.close()

    def _take(self, incoming: Incoming) -> None:
        """Take a request; while the robot is on its way, most of them are held. In the thread that reads."""
        ice = self.runtime.ice
        passes = ice is None or not ice.closed or self._passes(ice, incoming)
        if passes is None:
            return
        if ice is None or passes:
            self._dispatcher.take(incoming)
            return
        if not ice.hold(partial(self._take, incoming), incoming.pass_on):
            self._dispatcher.take(incoming)

    def _wait_again(self, ice: Ice, call: Call, incoming: Incoming) -> None:
        """Have a caller wait that asks again for a call which was accepted; it asks once more in the end.

        The request itself would have expired by then.
        """

        def ask_again() -> None:
            incoming.reply(encode(Moved()))
            incoming.end(None)

        incoming.reply(encode(Accepted(key=call.key, returns=self._process.returns)))
        if not ice.hold(ask_again, ask_again):
            ask_again()

    def _passes(self, ice: Ice, incoming: Incoming) -> bool | None:
        """Whether a request is answered though the robot is on its way; a stop goes to its children.

        Returns:
            None: it is dealt with.
        """
        if ice.over:
            return not ice.moved
        try:
            request = opened(
                incoming.body, incoming.credentials, self.robot.name, self._process.runner.now()
            ).request
        except VrError:
            return True  # it is refused
        if isinstance(request, Call) and self.runtime.look(lambda state: request.key in state.calls.live):
            self._wait_again(ice, request, incoming)
            return None
        if isinstance(request, SafeStop):
            incoming.reply(encode(Accepted(key=request.order)))
            self._on_loop(partial(self.on_stop, request.reason or "protective stop", request.order))
        return isinstance(request, _ON_WAY)

    async def leave(self) -> None:
        """Be here no longer: the robot goes on in another process, which serves and is present already."""
        self.open = False
        self._unwatch_parent()
        self._callers.close()
        self._publisher.withdraw()
        self._publisher.stop()
        if self._children is not None:
            self._children.leave()
        self.runtime.leave()
        await self._withdraw()
        await self._look_no_more()
        if self._taker is not None:
            await self._taker.close()
        if not self._gone.done():
            self._gone.set_result(None)
        self._close_process()
        self.closed.set()

    @property
    def children(self) -> ChildKeeper | None:
        """Its side of the bonds with its children; None: it can have none."""
        return self._children

    async def take_back(self) -> None:
        """Hold the children of a restored robot again, as far as they are there."""
        if self._children is not None:
            await self._children.take_back()

    def stop(self, reason: str, order: str = "") -> None:
        """Obey a protective stop that was ordered before the robot was back, or here."""
        self.runtime.post(on.StopAsked(reason=reason, order=order))
        self.runtime.changed()
        self.runtime.log.say("warning", f"{STOPPED}{reason}")

    def obey(self, orders: Iterable[SafeStop | Cancel]) -> None:
        """Carry out what was ordered while a restored robot was given up; before it goes on.

        None of the code runs of what ends so: it may be what has ended the process.
        """
        for order in orders:
            reason = order.reason or "on request"
            if isinstance(order, SafeStop):
                self.stop(order.reason or "protective stop", order.order)
            elif order.key:
                self.runtime.cancel(order.key, reason, final=True)
            else:
                self._end_calls(reason)
            self._abandon(reason, order.key if isinstance(order, Cancel) else "")

    async def meet_callers(self) -> None:
        """Wait for the news that those who have called a restored robot are there, if it is to come."""
        presence, until = self.transport.presence, self._loop.time() + ARRIVAL
        callers = {caller for _, caller in self.runtime.look(_callers)}
        while not all(map(presence.there, callers)) and self._loop.time() < until:  # noqa: ASYNC110 # a table, which tells nobody
            await asyncio.sleep(0.02)

    async def take_orders(self) -> None:
        """Have a restored robot that goes on take orders again."""
        if self._taker is not None:
            await self._taker.begin()

    def _abandon(self, reason: str, only: str = "") -> None:
        """End the commands of a restored robot that ran when its process ended: none of their code runs.

        Args:
            reason: for those that do not end already.
            only: key of the one that is meant; empty: all.
        """
        running = self.runtime.look(
            lambda state: [
                (call.key, call.command, call.cause)
                for call in state.calls.live.values()
                if call.running and only in ("", call.key)
            ]
        )
        for key, command, cause in running:
            error = CommandFailed(robot=self.robot.name, command=command, detail=reason)
            self.runtime.post(on.Finish(key=key, reply=cause or Raised.of(error)))

    def go_on(self, abandon: str = "") -> None:
        """Have a restored robot go on: its parent and callers are looked for, its commands begin again.

        Args:
            abandon: why the commands that ran end instead; empty: they go on.
        """
        if abandon:
            self._abandon(abandon)
        if (lease := self.runtime.lease) is not None:
            self._watch(lease.parent)
            if lease.waits and not self.transport.presence.there(lease.parent.key):
                self.runtime.post(on.ParentAway(parent=lease.parent))
        for key, caller in self.runtime.look(_callers):
            if self.transport.presence.there(caller):
                self._callers.attend(caller, key)
            else:
                self.runtime.cancel(key, GONE)  # before it begins, so that nothing moves for nobody
        self.runtime.begin_again()
        self._callers.watch_operators(self.runtime.look(lambda state: state.control.agents))
        self._outside.go_on()
        self._look_around()

    async def listed(self) -> None:
        """Wait until the lookup services know what they should, or as many of them as answer."""
        await self._publisher.listed()

    async def close(self, *, returns: bool = False) -> None:
        """End politely: release the children, leave the lookup, be gone. Twice is once.

        Args:
            returns: it will be started again with its state, and keeps its children.
        """
        if returns and self._children is not None:
            self._children.keep()
        await asyncio.shield(self._begin_to_end(PARTING))

    async def rest(self) -> None:
        """End all commands, as before the end of the process, and take nothing new."""
        self.open = False
        self._end_calls(f"{self.robot.name} is being ended")
        await self._no_calls(PARTING)

    @property
    def gone(self) -> bool:
        """Whether it has ended for everybody else; it may still be tidying up."""
        return self._gone.done()

    @property
    def abandoned(self) -> tuple[str, ...]:
        """Return the commands that were ended and whose code still runs, also after the robot's own end."""
        return self.runtime.look(lambda state: tuple(state.calls.abandoned.values()))

    def _begin_to_end(self, grace: float) -> asyncio.Task[None]:
        """End; several requests to end are one, and it ends also if nobody waits for it."""
        if self._ending is None:
            self._ending = self._loop.create_task(self._end(grace))
        return self._ending

    async def _end(self, grace: float) -> None:
        try:
            await self._leave(grace)
        finally:
            self.on_gone()
            running, home = ", ".join(self.abandoned), self.runtime.look(lambda state: state.home)
            left = running and f"its {running} ignores every cancel and still runs; restart {home}"
            for say in self._farewells:  # while the way to the asker is still open
                say(left)
            self._gone.set_result(None)
            self._unwatch_parent()
            self._callers.close()
            self._publisher.stop()
            await self._withdraw()
            self._process.robots.pop(self.address, None)
            self._close_process()
            self.closed.set()

    async def _leave(self, grace: float) -> None:
        """Tell the children, the lookup services and everybody else; take nothing more."""
        self.open = False
        self._publisher.withdraw()
        self._end_calls(f"{self.robot.name} is being ended")
        await self._no_calls(grace)
        if self._taker is not None:
            await self._taker.close()
        if self._deleted:
            identity = self.runtime.identity or f"name:{self.robot.name}"
            await say_deleted(self.transport, identity, self.address.key)
        await self._look_no_more()
        if self._children is not None:
            await self._children.close()
        await self._publisher.listed()
        if self._presence is not None:
            with contextlib.suppress(VrError):
                await self._presence.close()

    async def _no_calls(self, within: float) -> None:
        """Wait until all commands have ended, `within` [s] at most."""
        until = self._loop.time() + within
        while self.runtime.look(lambda state: len(state.calls.live)) and self._loop.time() < until:  # noqa: ASYNC110 # any thread ends them
            await asyncio.sleep(0.005)

    async def _withdraw(self) -> None:
        self._drills.end("")
        for registration in (self._presence, *reversed(self._declared)):
            if registration is not None:
                with contextlib.suppress(VrError):
                    await registration.close()

    def _close_process(self) -> None:
        if self._owns_process:
            self._process.close()

    async def _delete(self, asker: Principal, farewell: Callable[[str], None]) -> None:
        """End; returns when it is gone.

        Args:
            asker: who wants it.
            farewell: called while the way to the asker is open, with a sentence on what is left.
        """
        self._virtual("be deleted; end the process of its proxy instead")
        lease = self.runtime.lease
        if lease is not None and not self.brings(lease.parent):
            raise StillBonded(robot=self.robot.name, holder=lease.parent.name, slot=lease.slot)
        if self.before_end is not None:
            await self.before_end()
        self._note_order("deleted", asker)
        self._farewells.append(farewell)
        self._deleted = True
        self._begin_to_end(LONGEST_END + PARTING)
        await asyncio.shield(self._gone)

    async def end(self) -> None:
        """End for good, as if a person had deleted it; returns when it is gone."""
        self._deleted = True
        await asyncio.shield(self._begin_to_end(PARTING))

    async def reload(
        self,
        robot: VirtualRobot,
        page: str,
        *,
        now: bool,
        within: float,
        permissions: Permissions | None = None,
    ) -> list[str]:
        """Go on with another page at the next boundary between commands; bonds, settings and state stay.

        Args:
            robot: made of the other page.
            page: where that is kept.
            now: whether the running command is cancelled.
            within: [s] for the running command to end.
            permissions: of the other page; None: it is not limited.

        Returns:
            What could not stay, and what is new, as sentences.

        Raises:
            ReloadWaits: the running command did not end in time; the old page goes on.
            SlotHeld: a slot with a child is not there any more; the old page goes on.
        """
        turned: asyncio.Future[list[str]] = self._loop.create_future()

        def done(outcome: VrError | list[str] | None) -> None:
            self._on_loop(partial(_settle, turned, outcome))

        running = self.runtime.look(lambda state: state.calls.running)
        self.runtime.reload(robot, done, permissions)
        if now and running:
            self.runtime.cancel(running, f"the page of {self.robot.name} is reloaded")
        try:
            async with asyncio.timeout(within):
                notes = await asyncio.shield(turned)
        except TimeoutError:
            if self.runtime.withdraw_page(robot):
                command = (
                    self.runtime.look(lambda state: state.calls.command_of(state.calls.running))
                    or "a command"
                )
                raise ReloadWaits(robot=robot.name, command=command, seconds=within) from None
            notes = await turned
        self._hooks.become(robot)
        self._look_around()
        self._streams.become(robot)
        self.runtime.page = page
        self.runtime.changed()
        return notes

    # -- changes ----------------------------------------------------------------------------------

    def notify(self) -> None:
        """Take note that the robot has changed: reachable or not, halted, its attributes. From any thread."""
        self.runtime.look_at_robot()
        self.runtime.changed()

    def description(self) -> RobotDescription:
        """Describe the robot as it is now."""
        return self._publisher.description()

    def _on_loop(self, action: Callable[[], None]) -> None:
        soon(self._loop, action)

    def _take_effect(self, effect: CoreEffect) -> None:
        if isinstance(effect, LeaseEnded):
            _log.info("%s is free again: %s", self.robot.name, effect.reason)
            self._on_loop(self._lease_changed)
        elif isinstance(effect, LeaseChanged):
            self._on_loop(self._lease_changed)
        elif isinstance(effect, on.ControlChanged):
            self._on_loop(partial(self._callers.watch_operators, effect.agents))
            if effect.text:
                self.runtime.log.say("info", effect.text)
        elif isinstance(effect, on.RenewLease):
            self._virtual("have children").renew(effect)
        elif isinstance(effect, on.AskPart):  # stops are ordered on the event loop
            self._stops.ask(effect)
        elif isinstance(effect, on.StopSettled):
            self._on_loop(partial(self._stops.settled, effect))
        elif isinstance(effect, on.ChildGone):
            self._on_loop(partial(self._virtual("have children").gone, effect))

    def _lease_changed(self) -> None:
        """Somebody else commands the robot, or nobody, or its parent has other ancestors."""
        lease = self.runtime.lease
        if lease is None:
            self._unwatch_parent()
        self._publisher.update_listing()
        self.runtime.changed()

    def _cut_off(self, reason: str) -> None:
        """End all motion when nobody could end it any more: no stop would reach the robot."""
        if reason:
            _log.warning("%s ends its commands: %s", self.robot.name, reason)
            self._end_calls(reason)

    def _end_calls(self, reason: str) -> None:
        self.runtime.post(on.CancelAll(reason=reason, final=True))

    # -- requests ---------------------------------------------------------------------------------

    def _answer(self, received: Received, send: SendReply) -> Reply | Awaitable[Reply | None]:
        """Answer one request, at once if that takes no time.

        Raises:
            VrError: it is refused.
        """
        request = received.request
        if not self.open and not isinstance(request, _AT_THE_END):
            raise Unreachable(key=self.address.key)
        self.runtime.look_at_robot()
        if isinstance(request, _TAKE_TIME):
            return self._reply_later(request, received.principal, send)
        return self._reply(request, received.principal)

    async def _reply_later(  # noqa: PLR0911 # one for each
        self, request: AnyRequest, asker: Principal, send: SendReply
    ) -> Reply | None:
        match request:
            case SafeStop():
                self.on_stop(request.reason or "protective stop", request.order)
                send(Accepted(key=request.order))  # the asker must know at once that it has reached us
                if asker.person:
                    request = msgspec.structs.replace(request, reason=f"{asker.person}'s protective stop")
                return await self._stops.safe_stop(request, asker)
            case Resume():
                reply = await self._stops.resume(request, asker)
                self._note_order("resumed", asker)
                return reply
            case Enslave():
                await self._enslave(request, asker)
                return Described(robot=self.description())
            case Free():
                await self._free(request.slot, asker)
                self._note_order(f"{request.slot}: released", asker)
                return Described(robot=self.description())
            case TakeStep():
                return await self._stops.step(self._with_steps(), request, asker)
            case Delete():
                await self._delete(asker, lambda left: send(Done(note=left)))
                return None
            case ReadEvents() | VerifyEvents() if self._history is not None:
                return await asyncio.to_thread(answer_of, self._history, request)
            case _:
                raise not_for("robot", request)

    async def _enslave(self, request: Enslave, asker: Principal) -> None:
        children = self._virtual("enslave others")
        if request.child is not None:
            await children.enslave(request.slot, request.child, asker)
            slot = self.runtime.look(lambda state: state.slots.by_name.get(request.slot))
            done = "watched" if slot is not None and slot.watched is not None else "enslaved"
            self._note_order(f"{request.slot}: {request.child.name} {done}", asker)
        elif self._choosing is not None:
            await self._choosing.enslave(request.slot, request.where, asker)
            self._note_order(f"{request.slot}: a choice was asked for", asker)

    async def _free(self, slot: str, asker: Principal) -> None:
        children = self._virtual("release children")
        if self._choosing is not None:
            self._choosing.released(slot)
        await children.free(slot, asker)

    def _note_order(self, order: str, asker: Principal) -> None:
        """Enter in the log what a person has ordered that is no command."""
        if asker.person:
            self.runtime.log.say("info", f"{order} by {asker.person}")

    def _reply(self, request: AnyRequest, asker: Principal) -> Reply:  # noqa: C901, PLR0911, PLR0912 # one for each
        """Answer a request that takes no time.

        Raises:
            VrError: it is refused.
        """
        match request:
            case Describe():
                return Described(robot=self.description())
            case ReadLog(after=after):
                return Logged(lines=tuple(self.runtime.log.since(after)))
            case Petition():
                return self._petition(request, asker)
            case Decide():
                decided = on.DoubtSettled(answer=request.answer, epoch=request.epoch, principal=asker)
                self.runtime.post(decided)
                self._note_order(f"answered with {request.answer}", asker)
                return Done()
            case Pause():
                self._with_steps()
                return self._stops.pause(asker)
            case Continue():
                self._with_steps()
                return self._stops.go_on(asker)
            case SetPlacement():
                return self._place(request, asker)
            case Disturb():
                return self._drills.take(request, asker)
            case SetControl():
                return self._set_control(request, asker)
            case Retract():
                reason = f"{request.parent.name} did not hear that it was granted"
                self._end_lease(request.parent, reason, asker, petition=request.key, taken_back=True)
                return Done()
            case Renew():
                return self._renew(request, asker)
            case Release():
                reason = f"{request.parent.name} released it"
                self._end_lease(request.parent, reason, asker, epoch=request.epoch)
                return Done()
            case _:
                raise not_for("robot", request)

    def _place(self, request: SetPlacement, asker: Principal) -> Reply:
        """Take how the robot may be moved.

        Raises:
            NotVirtual: it is a proxy.
        """
        self._virtual("move: it stays where its controller is")
        mode, robot = request.placement, self.robot
        placing = self.runtime.look(lambda state: state.placing)
        self.runtime.post(on.PlacingSet(placing=msgspec.structs.replace(placing, mode=mode), principal=asker))
        self.runtime.advice = self.runtime.advised = ""
        self.runtime.changed()
        self._note_order(f"placement {mode}", asker)
        pinned = mode != "manual" and isinstance(robot, VirtualRobot) and robot.pinned
        note = f"{robot.name} is placed by {WHO_PLACES[mode]}"
        return Done(note=f"{note}; its author has pinned it, so it stays where it is" if pinned else note)

    def _set_control(self, request: SetControl, asker: Principal) -> Reply:
        """Let an operator get, ask for, offer, take or leave control.

        Raises:
            HeldByOperator: somebody else has it.
            ControlRefused: it cannot change hands in this way.
            NotAllowed: nobody sits there.
        """
        if not asker.person:
            raise NotAllowed(who=asker.agent or "a program", what="control", reason="it asks for no person")
        if request.within < 0 or not request.within < math.inf:
            raise ControlRefused(robot=self.robot.name, reason="the time for which it is wanted is none")
        self.runtime.post(
            on.ControlAsked(
                what=request.what,
                person=request.person,
                within=request.within,
                seen=request.seen,
                unix=self._unix(),
                principal=asker,
            )
        )
        return Done(note=self.runtime.look(lambda state: state.control.holder.person))

    def _with_steps(self) -> ChildKeeper:
        return self._virtual("be paused: it has no steps; pause its parent, or stop it")

    # -- who commands it --------------------------------------------------------------------------

    def _petition(self, request: Petition, asker: Principal) -> Reply:
        self._expect_to_fit(request)
        if request.idle and self._taker is not None and self._taker.has_taken:
            raise NotFree(robot=self.robot.name, reason="it has taken an order")
        effects = self.runtime.post(
            on.ParentAsked(
                principal=asker,
                parent=request.parent,
                slot=request.slot,
                lineage=request.lineage,
                term=request.term,
                unix=self._unix(),
                key=request.key,
                returns=request.returns,
                patience=request.patience,
                waits=request.waits,
                life=request.life,
                idle=request.idle,
            )
        )
        self._watch(request.parent)
        description = self.description()
        self._known_to_parent = description.commands, description.witness
        return _granted(effects, description, self._process.returns)

    def _expect_to_fit(self, request: Petition) -> None:
        """Refuse a slot for which this robot is not made.

        Raises:
            WrongKind: it takes another kind.
            DoesNotFit: this robot lacks a command of the kind.
        """
        parent, slot, wanted = request.parent.name, request.slot, request.kind
        name, kinds = self.robot.name, self.robot.kinds()
        if wanted not in kinds:
            raise WrongKind(robot=parent, slot=slot, wanted=wanted, child=name, kind=kinds[0])
        if request.promises or request.uses:
            reason = misfit(self.description(), request.promises, request.uses)
            if reason:
                raise DoesNotFit(robot=parent, slot=slot, wanted=wanted, child=name, reason=reason)

    def _renew(self, request: Renew, asker: Principal) -> Reply:
        self._expect_only_one(request.parent, asker)
        renewal = on.Prolong(
            parent=request.parent,
            epoch=request.epoch,
            lineage=request.lineage,
            life=request.life,
            heir=request.heir,
            proof=request.proof,
            unix=self._unix(),
            principal=asker,
            is_there=self.transport.presence.there(request.parent.key),
        )
        if self._children is not None:  # else it has no steps
            renewal = msgspec.structs.replace(renewal, paused=request.paused, pauses=request.pauses)
        lease = self.runtime.lease
        try:
            effects = self.runtime.post(renewal)
        except CycleOfBonds as error:
            self._end_lease(request.parent, str(error), asker, epoch=request.epoch)
            raise
        if lease is None or lease.parent != request.parent:  # the parent goes on as another incarnation
            self._watch(request.parent)
        commands = self.runtime.look(self.runtime.specs)
        if (commands, self.robot.witness) == self._known_to_parent:
            return _granted(effects, None, self._process.returns)
        description = self.description()
        self._known_to_parent = description.commands, description.witness
        return _granted(effects, description, self._process.returns)

    def _end_lease(self, parent: Address, reason: str, asker: Principal, **which: Any) -> None:
        """End a lease; `which`: the fields of `EndLease` that name it."""
        self._expect_only_one(parent, asker)
        end = on.EndLease(parent=parent, unix=self._unix(), reason=reason, principal=asker, **which)
        self.runtime.post(end)

    def _expect_only_one(self, parent: Address, asker: Principal) -> None:
        """Refuse another incarnation of the parent while the one that holds the lease is present.

        Raises:
            NotInControl: it is.
        """
        lease = self.runtime.lease
        if lease is None or lease.parent == parent or not lease.of(parent, asker):
            return
        if self.transport.presence.there(lease.parent.key):
            raise NotInControl(robot=self.robot.name, holder=lease.parent.name, slot=lease.slot)

    def _watch(self, parent: Address) -> None:
        """End the lease when its parent's presence goes."""

        def look(_: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
            lease = self.runtime.lease
            if not there and lease is not None and lease.parent == parent and lease.waits:
                self.runtime.post(on.ParentAway(parent=parent))
            elif not there and lease is not None and lease.parent == parent:
                presence = self.transport.presence
                hangs = not presence.left(parent.key) and presence.lives(parent.key)
                how = "hangs: its process does not answer" if hangs else "has ended"
                reason = f"{parent.name} {how}"
                self.runtime.post(on.EndLease(parent=parent, unix=self._unix(), reason=reason))

        self._unwatch_parent()
        self._unwatch_parent = self.transport.presence.watch(parent.key, look)

    # -- the robots that it commands --------------------------------------------------------------

    def _virtual(self, what: str) -> ChildKeeper:
        if self._children is None:
            raise NotVirtual(robot=self.robot.name, what=what)
        return self._children

    # -- for calls, in other threads --------------------------------------------------------------

    def _describe_child(self, unknown: NotDescribed, done: OnDescribed) -> None:
        """Ask the child in a slot anew who it is. From any thread, without waiting.

        Args:
            unknown: names the slot, and the command that is missing in what is known.
            done: called with None, or with why it is in vain.
        """

        async def ask() -> None:
            error: VrError | None = None
            try:
                await self._virtual("have children").describe(unknown.slot, unknown.command)
            except VrError as refusal:
                error = refusal
            except BaseException as fault:  # noqa: BLE001 # who waits for it must hear of it
                error = VrError(detail=f"{self.robot.name}: internal error: {fault!r}")
            done(error)

        self._on_loop(lambda: self._asides.begin(ask()))

    def _follow_child(
        self, child: Address, topic: str, take: Callable[[State | StreamSample], None]
    ) -> Callable[[], None]:
        """Hand on what a robot publishes under a topic, on the event loop. From any thread, without waiting.

        Returns:
            How to end that.
        """
        over = asyncio.Event()

        def hear(key: str, body: bytes) -> None:
            with contextlib.suppress(VrError):  # a robot of another version
                event = decode_event(body, key=key)
                if isinstance(event, State | StreamSample):
                    take(event)

        async def follow() -> None:
            with contextlib.suppress(TransportError):  # it is closed
                registration = await self.transport.subscribe(f"{child.key}/{topic}", hear)
                try:
                    await over.wait()
                finally:
                    await registration.close()

        self._on_loop(lambda: self._asides.begin(follow()))
        return lambda: self._on_loop(over.set)


def _granted(effects: Sequence[CoreEffect], news: RobotDescription | None, returns: float) -> Granted:
    lease = next(effect for effect in effects if isinstance(effect, on.LeaseGranted))
    return Granted(
        epoch=lease.epoch,
        term=lease.term,
        robot=news,
        depth=lease.depth,
        ways=lease.ways,
        stopped=lease.stopped,
        returns=returns,
    )


def _callers(state: RobotState) -> list[tuple[str, str]]:
    """Return the calls that end with a person's program: key, and under what the program is present."""
    return [
        (call.key, call.principal.agent)
        for call in state.calls.live.values()
        if call.principal.agent and "/" not in call.key and not call.detached
    ]


def _settle(turned: asyncio.Future[list[str]], outcome: VrError | list[str] | None) -> None:
    if turned.done():
        return
    if outcome is None:
        turned.set_result(["a later reload has replaced this one"])
    elif isinstance(outcome, VrError):
        turned.set_exception(outcome)
    else:
        turned.set_result(outcome)


def _new_state(robot: Robot, address: Address, host: str, lease: GrantedLease) -> RobotState:
    home = f"host {host}" if host else f"the process of {robot.name}"
    state = RobotState(
        address=address, home=home, lease=lease, slots=Slots(robot.name), calls=Calls(), stop=Stop()
    )
    if isinstance(robot, VirtualRobot):
        state.slots, state.fields = robot.child_slots, robot.field_values.values
    return state
