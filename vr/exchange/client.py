"""The asking side of agents: how operators and parents reach a robot, a host or a view in any process."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, Protocol, TypeVar

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import Arguments, Placement, RobotDescription
from robotree.vr.base.errors import NoAnswer, Unreachable, VrError
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    AnyRequest,
    Attend,
    Call,
    Cancel,
    Continue,
    Create,
    Decide,
    Delete,
    Describe,
    Described,
    DescribeHost,
    DescribeView,
    Disturb,
    Done,
    Drain,
    Enslave,
    Free,
    Granted,
    History,
    HostDescribed,
    Logged,
    LoggedLine,
    Look,
    Migrate,
    Pause,
    Petition,
    Picture,
    Progress,
    Raised,
    ReadHistory,
    ReadLog,
    Release,
    Reload,
    Reloaded,
    Reply,
    Resume,
    Retract,
    SafeStop,
    SetControl,
    SetPlacement,
    TakeStep,
    ViewDescribed,
)
from robotree.vr.base.transport import Transport
from robotree.vr.core.confirmation import unmeasured
from robotree.vr.exchange.asking import ReplyStream, ask, fresh_key, send_request
from robotree.vr.exchange.calling import NEWS, CallOutcome, OnFields, OnProgress

DEFAULT_DEADLINE = 60.0
"""[s] for a command when the caller names none."""
LOADING = 20.0
"""[s] for a robot to be made: twice the loader's limit, for source and constructor, and the way."""
MOVING = 60.0
"""[s] for a robot to move: its page is loaded there, and it may have to come to a wait."""
DRAINING = 600.0
"""[s] for all robots of a host."""
PICTURE_WITHIN = 20.0
"""[s] for a picture: 27 kB take 3.5 s on a line of 64 kbit/s that carries nothing else, and one that is given
up has filled the line in vain."""
RELOADING = 10.0
"""[s] for a running command to end before a page is reloaded."""

_R = TypeVar("_R", bound=Reply)


class RobotClient:
    """Asks one incarnation of a robot. Holds no connection: make and drop it as you like."""

    def __init__(
        self, transport: Transport, address: Address, *, patience: float = ANSWER_WITHIN, sender: str = ""
    ) -> None:
        """Point at a robot.

        Args:
            transport: the way there.
            address: the robot.
            patience: [s] to wait for answers that take no work.
            sender: key under which the asker is present; empty: it is under none.
        """
        self.address = address
        self._transport = transport
        self._patience, self._sender = patience, sender
        self._cancels: set[asyncio.Task[None]] = set()

    # -- commands ---------------------------------------------------------------------------------

    async def call(  # noqa: PLR0913 # a call has so many sides
        self,
        command: str,
        arguments: Arguments,
        *,
        deadline: float = DEFAULT_DEADLINE,
        epoch: int | None = None,
        caller: str = "",
        sender: str = "",
        key: str | None = None,
        on_progress: OnProgress | None = None,
        attended: float = 0.0,
    ) -> Any:
        """Have a command carried out and return its result. Ends the command if this is cancelled.

        Args:
            command: its name.
            arguments: numbers in the declared units, or text with units.
            deadline: [s] within which it must be done.
            epoch: of the caller's lease; None: an operator's.
            caller: name, for people.
            sender: key under which the caller is present: a command of an operator ends when that goes.
                Empty: that of the client, if it has one; else it goes on if this process is killed.
            key: of the call; None: a fresh one. The same key again asks for the same result.
            on_progress: takes how far it is.
            attended: [s] for which somebody at a key attends it, longer by `press`; 0: nobody does.

        Raises:
            CommandError: it was refused or did not succeed.
            LeaseError: the caller may not command this robot.
            TransportError: the robot cannot be reached or does not answer.
        """
        call = Call(
            key=key or fresh_key(),
            command=command,
            arguments=dict(arguments),
            epoch=epoch,
            caller=caller,
            deadline=deadline,
            attended=attended,
        )
        return await self.carry_out(call, sender=sender, on_progress=on_progress)

    async def tell(
        self,
        command: str,
        arguments: Arguments,
        *,
        deadline: float = DEFAULT_DEADLINE,
        caller: str = "",
    ) -> None:
        """Have a command carried out and return as soon as the robot has accepted it; else as `call`."""
        key, given = fresh_key(), dict(arguments)
        call = Call(key=key, command=command, arguments=given, caller=caller, deadline=deadline, oneway=True)
        await self._carry_out(CallOutcome(call, self.address), "")

    async def carry_out(
        self,
        call: Call,
        *,
        sender: str = "",
        on_progress: OnProgress | None = None,
        on_fields: OnFields | None = None,
    ) -> Any:
        """Do as `call`, with a request as it shall be sent.

        Args:
            call: the request.
            sender: as in `call`.
            on_progress: takes how far it is.
            on_fields: takes what the result is, before this returns; the call must ask for it.
        """
        outcome = CallOutcome(call, self.address, on_progress, on_fields)
        return await self._carry_out(outcome, sender or self._sender)

    async def _carry_out(self, outcome: CallOutcome, sender: str) -> Any:
        try:
            return await self._follow(outcome, sender)
        except (asyncio.CancelledError, NoAnswer):
            # It may still be on its way there: it must not begin after we gave up.
            self._cancel_late(outcome.call, sender)
            raise

    async def _follow(self, outcome: CallOutcome, sender: str) -> Any:
        loop = asyncio.get_running_loop()
        call, ends = outcome.call, loop.time() + outcome.call.deadline
        while not outcome.over:
            await self._take_replies(call, outcome, sender)
            if outcome.away:
                presence, key = self._transport.presence, self.address.key
                if not outcome.moved:
                    await presence.until(key, there=False, within=NEWS)
                if await presence.until(key, there=True, within=outcome.returns):
                    call = outcome.again(ends, loop.time())
                else:
                    outcome.give_up()
        return outcome.result()

    async def _take_replies(self, call: Call, outcome: CallOutcome, sender: str) -> None:
        key = self.address.key
        replies = ReplyStream(
            self._transport, key, call, within=self._patience, timeout=outcome.longest, sender=sender
        )
        try:
            async with asyncio.timeout(self._patience) as until_accepted:
                async for reply in replies:
                    outcome.take(reply)
                    if outcome.over:
                        break
                    if outcome.accepted:
                        until_accepted.reschedule(None)
                else:
                    outcome.take(None)
        except TimeoutError:
            raise NoAnswer(key=key, seconds=self._patience) from None
        except Unreachable:
            if not outcome.accepted:
                raise
            outcome.take(None)

    def _cancel_late(self, call: Call, sender: str) -> None:
        """End a call as the one who has made it: who may do no more than that may end it."""

        async def cancel() -> None:
            mine = RobotClient(self._transport, self.address, patience=self._patience, sender=sender)
            with contextlib.suppress(VrError):
                await mine.cancel(call.key, epoch=call.epoch, reason="the caller gave up")

        task = asyncio.get_running_loop().create_task(cancel())
        self._cancels.add(task)
        task.add_done_callback(self._cancels.discard)

    async def cancel(self, key: str = "", *, epoch: int | None = None, reason: str = "") -> str:
        """End the command of a key, or all of them; returns a note for people: that there was none."""
        return (await self._ask(Cancel(key=key, epoch=epoch, reason=reason), Done, urgent=True)).note

    def press(self, key: str) -> None:
        """Say that somebody at a key attends a call of this caller, without waiting for an answer."""
        now = asyncio.get_running_loop().time()
        send_request(
            self._transport,
            self.address.key,
            Attend(key=key),
            lambda _: None,
            now=now,
            within=ANSWER_WITHIN,
            sender=self._sender,
            urgent=True,
        )

    async def control(
        self,
        what: Literal["get", "ask", "offer", "take", "leave"],
        *,
        person: str = "",
        within: float = 0.0,
        seen: int = -1,
    ) -> str:
        """Get, ask for, offer, take or leave control; returns who has it then: see `SetControl`.

        Raises:
            HeldByOperator: somebody else has it.
            ControlRefused: it cannot change hands in this way.
            LeaseError: a parent commands the robot.
        """
        request = SetControl(what=what, person=person, within=within, seen=seen)
        return (await self._ask(request, Done, urgent=True)).note

    async def decide(self, answer: Literal["done", "again", "abort"]) -> None:
        """Answer what a command asks after a crash: it is done, goes on, or ends in doubt.

        Raises:
            NothingAsked: no command asks anything.
            NotInControl: a parent commands the robot.
        """
        await self._ask(Decide(answer=answer), Done)

    async def disturb(
        self,
        fault: Literal["", "cut", "delay", "freeze", "kill"],
        *,
        seconds: float = 0.0,
        delay: float = 0.0,
    ) -> str:
        """Have it suffer a fault for a drill (`Disturb`); returns what it suffers, for people.

        Args:
            fault: what; empty: the drill ends.
            seconds: [s] that it lasts at most.
            delay: [s] that everything takes longer on the link to its controller, each way.

        Raises:
            NoDrill: it has no such link, or the asker is at another machine.
        """
        return (await self._ask(Disturb(fault=fault, seconds=seconds, delay=delay), Done)).note

    async def pause(self) -> str:
        """Have its commands, and those of robots below it, wait before each step; returns a note for people.

        Raises:
            NotVirtual: it has no steps.
            LeaseError: its parent commands it.
        """
        return (await self._ask(Pause(), Done, urgent=True)).note

    async def step(self, *, epoch: int | None = None, within: float | None = None) -> str:
        """Let one step pass, of the robot or of one below it; returns which, in words.

        Args:
            epoch: of the caller's lease; None: an operator's.
            within: [s] for the answer; None: as long as usual.

        Raises:
            NotPaused: it is not paused.
            NothingHeld: nothing waits before a step.
            LeaseError: its parent commands it.
        """
        within = self._patience if within is None else within
        return (await self._ask(TakeStep(epoch=epoch, within=within / 2), Done, timeout=within)).note

    async def go_on(self) -> str:
        """End the pause of the robot and of those below it; returns a note for people.

        Raises:
            LeaseError: its parent commands it.
        """
        return (await self._ask(Continue(), Done)).note

    async def place(self, placement: Placement) -> str:
        """Say how it may be moved; returns a note for people.

        Raises:
            NotVirtual: it stays where its controller is.
        """
        return (await self._ask(SetPlacement(placement=placement), Done)).note

    async def safe_stop(
        self,
        reason: str = "",
        *,
        order: str = "",
        timeout: float | None = None,
        within: float | None = None,
        accepted: Callable[[], None] = lambda: None,
        counted: Callable[[int], None] = lambda _: None,
    ) -> Sequence[str]:
        """Protective stop, ahead of everything, down to the hardware. It needs no lease.

        Args:
            reason: for those whose commands it ends.
            order: that it is part of; see `SafeStop.order`.
            timeout: [s] to wait until all below have answered; None: the client's patience.
            within: [s] in which the robot must answer to be in time; None: the way there and back has not
                been measured.
            accepted: called when the robot says that it has the stop, before it is confirmed.
            counted: told how many stops the robot has counted with this one, when it is confirmed.

        Returns:
            The names of those that have confirmed it: the robot and all below it.

        Raises:
            NotConfirmed: the hardware of one of them has not confirmed it; it names them.
            TransportError: the robot has not.
        """
        patience = self._patience if timeout is None else timeout
        stop = SafeStop(reason=reason, order=order, within=unmeasured(patience) if within is None else within)
        done = await self._ask(stop, Done, urgent=True, timeout=patience, accepted=accepted)
        counted(done.stops)
        return done.confirmed

    async def resume(
        self,
        *,
        epoch: int | None = None,
        seen: Mapping[str, int] | None = None,
        given: float = math.inf,
        clock: str = "",
        timeout: float | None = None,
        within: float | None = None,
    ) -> Sequence[str]:
        """Release the protective stop of the robot and of all robots below it; see `safe_stop`.

        Args:
            epoch: of the caller's lease; None: an operator's.
            seen: `RobotDescription.stops` of each, by key: a later stop stays in force, and so does that of a
                robot that is not in it. None: whichever stops there are.
            given: [s] when a person gave it: a later stop stays in force. Infinite: not known.
            clock: of `given`; see `envelope.this_clock`.
            timeout: as in `safe_stop`.
            within: as in `safe_stop`.
        """
        patience = self._patience if timeout is None else timeout
        known = None if seen is None else dict(seen)
        within = unmeasured(patience) if within is None else within
        resume = Resume(epoch=epoch, seen=known, given=given, clock=clock, within=within)
        return (await self._ask(resume, Done, urgent=True, timeout=patience)).confirmed

    # -- what operators ask -----------------------------------------------------------------------

    async def describe(self, *, urgent: bool = False) -> RobotDescription:
        """Ask for its description; `urgent`: ahead of everything else, as a stop is."""
        return (await self._ask(Describe(), Described, urgent=urgent)).robot

    async def read_log(self, after: int = 0) -> Sequence[LoggedLine]:
        """Return its log, the oldest line first; `after`: the number of the last line known."""
        return (await self._ask(ReadLog(after=after), Logged)).lines

    async def enslave(self, slot: str, child: Address) -> RobotDescription:
        """Bind a child to one of its slots."""
        answer = await self._ask(Enslave(slot=slot, child=child), Described, timeout=2 * self._patience)
        return answer.robot

    async def choose(self, slot: str, where: str) -> RobotDescription:
        """Let it choose a child for one of its slots.

        Args:
            slot: name of the slot, or of a group.
            where: what the child must be (`scripts/requirement.py`); empty: what the slot asks for.
        """
        answer = await self._ask(Enslave(slot=slot, where=where), Described, timeout=2 * self._patience)
        return answer.robot

    async def free(self, slot: str) -> RobotDescription:
        """Release the child in one of its slots."""
        return (await self._ask(Free(slot=slot), Described, timeout=2 * self._patience)).robot

    async def delete(self) -> str:
        """Let it release its children and end.

        Returns:
            What is left of it, as a sentence: code that cannot be ended. Empty: nothing.
        """
        return (await self._ask(Delete(), Done, timeout=2 * self._patience)).note

    # -- what parents ask -------------------------------------------------------------------------

    async def petition(self, petition: Petition) -> Granted:
        """Ask for the lease on it."""
        return await self._ask(petition, Granted, urgent=True)

    async def retract(self, parent: Address, key: str, *, timeout: float = ANSWER_WITHIN) -> None:
        """Take back a petition whose answer did not arrive; `timeout` [s] to wait for the receipt."""
        await self._ask(Retract(parent=parent, key=key), Done, urgent=True, timeout=timeout)

    async def release(self, parent: Address, epoch: int, *, timeout: float = ANSWER_WITHIN) -> None:
        """Give the lease back; `timeout` [s] to wait for the receipt."""
        await self._ask(Release(parent=parent, epoch=epoch), Done, urgent=True, timeout=timeout)

    async def _ask(
        self,
        request: AnyRequest,
        answer: type[_R],
        *,
        urgent: bool = False,
        timeout: float | None = None,
        accepted: Callable[[], None] = lambda: None,
    ) -> _R:
        return await ask(
            self._transport,
            self.address.key,
            request,
            answer,
            timeout=self._patience if timeout is None else timeout,
            urgent=urgent,
            accepted=accepted,
            sender=self._sender,
        )


class Source(Protocol):
    """The source of a page on its way to a host: a `Bundle`."""

    @property
    def origin(self) -> str:
        """Where a reload finds it again."""
        ...

    def request(self, name: str = "", settings: Mapping[str, Any] | None = None, origin: str = "") -> Create:
        """Return it as it stands in a request."""
        ...


async def read_history(transport: Transport, agent: Address, *, timeout: float = ANSWER_WITHIN) -> History:
    """Ask a lookup service or a host what it remembers of agents that may be there no more.

    Args:
        transport: the way to it.
        agent: which.
        timeout: [s] to wait.

    Raises:
        TransportError: it cannot be reached or does not answer.
        Garbled: it is of an older version.
    """
    return await ask(transport, agent.key, ReadHistory(), History, timeout=timeout)


class HostClient:
    """Asks one host."""

    def __init__(self, transport: Transport, address: Address) -> None:
        """Point at a host."""
        self.address = address
        self._transport = transport

    async def describe(self, *, timeout: float = ANSWER_WITHIN) -> HostDescribed:
        """Ask what it runs; `timeout` [s] to wait.

        Raises:
            TransportError: it cannot be reached or does not answer.
        """
        return await ask(self._transport, self.address.key, DescribeHost(), HostDescribed, timeout=timeout)

    async def create(
        self,
        bundle: Source,
        name: str,
        settings: Mapping[str, Any] | None = None,
        isolate: Isolation | Literal[""] = "",
    ) -> RobotDescription:
        """Have a virtual robot made of a source: see `Host.create`.

        Raises:
            VrError: the refusal of the host.
            TransportError: the host cannot be reached or does not answer.
        """
        request = msgspec.structs.replace(bundle.request(name, settings, bundle.origin), isolate=isolate)
        answer = await ask(self._transport, self.address.key, request, Described, timeout=LOADING)
        return answer.robot

    async def migrate(self, name: str, host: str) -> str:
        """Have one of its robots go on in another host; returns a sentence for people.

        Raises:
            VrError: the robot stays where it is.
            TransportError: the host cannot be reached or does not answer.
        """
        request = Migrate(robot=name, host=host)
        return (await ask(self._transport, self.address.key, request, Done, timeout=MOVING)).note

    async def drain(self, on_move: Callable[[str], object]) -> list[str]:
        """Have all its robots go on in other hosts; returns their names.

        Args:
            on_move: told of each that has moved, as a sentence.

        Raises:
            NotDrained: some have not; the error says why.
            TransportError: the host cannot be reached or does not answer.
        """
        replies = ReplyStream(
            self._transport, self.address.key, Drain(), within=ANSWER_WITHIN, timeout=DRAINING
        )
        async for reply in replies:
            match reply:
                case Progress(text=text):
                    on_move(text)
                case Done(confirmed=moved):
                    return list(moved)
                case Raised():
                    raise reply.revive()
                case _:
                    pass
        raise Unreachable(key=self.address.key)

    async def create_known(
        self, digest: str, name: str, settings: Mapping[str, Any] | None = None
    ) -> RobotDescription:
        """Have a virtual robot made of a page that this host, or another one, has; see `Host.create`.

        Args:
            digest: hash of the page.
            name: of the robot.
            settings: values that are not the defaults.

        Raises:
            NoSuchBundle: nobody has it.
            VrError: the refusal of the host.
            TransportError: the host cannot be reached or does not answer.
        """
        given, path = dict(settings or {}), f"sha256:{digest}"
        request = Create(name=name, path=path, source="", hash=digest, settings=given)
        answer = await ask(self._transport, self.address.key, request, Described, timeout=LOADING)
        return answer.robot

    async def reload(
        self, bundle: Source, name: str, *, now: bool = False, within: float = RELOADING
    ) -> Reloaded:
        """Have a robot of the host go on with another page: see `Host.reload`.

        Raises:
            VrError: the refusal of the host.
            TransportError: the host cannot be reached or does not answer.
        """
        request = Reload(page=bundle.request(name, origin=bundle.origin), now=now, within=within)
        return await ask(self._transport, self.address.key, request, Reloaded, timeout=LOADING + within)


class ViewClient:
    """Looks at one view, wherever it is."""

    def __init__(self, transport: Transport, address: Address) -> None:
        """Point at a view."""
        self.address = address
        self._transport = transport

    async def describe(self) -> ViewDescribed:
        """Ask for its cameras and its readings.

        Raises:
            TransportError: it cannot be reached or does not answer.
        """
        return await ask(
            self._transport, self.address.key, DescribeView(), ViewDescribed, timeout=ANSWER_WITHIN
        )

    async def look(
        self, camera: str = "", *, width: int = 320, height: int = 180, quality: int = 75
    ) -> Picture:
        """Take one picture: see `View.look`. For a film, ask again when the last one has come.

        Raises:
            VrError: the refusal of the view.
            TransportError: the view cannot be reached or does not answer.
        """
        request = Look(camera=camera, width=width, height=height, quality=quality)
        return await ask(self._transport, self.address.key, request, Picture, timeout=PICTURE_WITHIN)
