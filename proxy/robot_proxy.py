"""The robot proxy: an agent on one side, the wire on the other.

This is what all kinds of robots have in common. A command's key becomes its goal's key, its lease's epoch the
goal's epoch, its deadline the goal's time to live; when it is cancelled, the goal is cancelled. A new kind of
robot is one class with its limits and its commands, in a module with its motions (`arm.py`, `rover.py`, or a
file of yours).
"""

from __future__ import annotations

import asyncio
import logging
import math
import random
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

from robotree.protocol.links.loopback import Faults
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    AnyMessage,
    GoalState,
    Message,
    Reason,
    Verb,
    WayRequest,
    WayStatus,
)
from robotree.protocol.services.claim_client import ClaimClient, ClaimDenied, ClaimGranted
from robotree.protocol.services.goal_client import GoalEnded, GoalSilent
from robotree.protocol.services.peer import Send
from robotree.proxy.connection import Connection, Dial
from robotree.proxy.desired_mode import ReleaseConfirmed, ReleaseRefused, ReleaseUnanswered, StopConfirmed
from robotree.proxy.guard import NO_LIMITS, EpochCheck, Limits, changed, check
from robotree.proxy.mode_requests import ModeRequest, ModeRequests
from robotree.proxy.motion import Hold, Motion, PreviewedWay, Request, refused_way, way_of
from robotree.proxy.outcome import error_of, reason_in_words, silence_in_words, unclear
from robotree.proxy.pending_goals import NotSent, OutcomeLost, PendingGoal, PendingGoals
from robotree.proxy.session import (
    CONTROLLER,
    SETTLED,
    ControllerSession,
    HeldChanged,
    OnlineChanged,
    SessionEvent,
)
from robotree.proxy.translate import (
    READERS,
    UNITS,
    MessageReaders,
    Target,
    component_of,
    goal_key,
    time_to_live,
)
from robotree.proxy.view import PATIENT, PictureShow, WorkspaceView
from robotree.vr.author.command import command, commands_of
from robotree.vr.author.context import Activity, running
from robotree.vr.author.robot import Robot
from robotree.vr.author.stream import Sending
from robotree.vr.base.chance import bits
from robotree.vr.base.description import LINK, OPEN_LINK, SIGNED_LINK, Effect
from robotree.vr.base.errors import BadArgument, CommandCancelled, CommandFailed, DeadlineExceeded
from robotree.vr.running.runner import Runner, Threads

_log = logging.getLogger(__name__)

T = TypeVar("T", bound=Message)

FRAME = "frame"
"""Attribute of a robot whose coordinates are not in W of its controller: the name of their frame."""
HELD_BY = "held_by"
"""Attribute of a robot whose controller obeys another program: the name of that holder."""
CANCEL_TIMEOUT = 0.8
"""[s] that a cancelled command waits for the controller to confirm the end of its goal: less than the
second that agents allow. An unconfirmed cancel is sent again after that."""
ASK = Request(Verb.STATUS, ())
"""The request for the state of a goal."""
READING_TIMEOUT = 1.0
"""[s] that a reading may take to arrive. The slowest stream comes ten times a second."""
NEXT = "look after the controller, the proxy goes on dialling"
"""The advice for a robot that is offline."""


class Streamed(NamedTuple):
    """A stream that is telemetry."""

    stream: str
    """Its name."""
    message: type[Any]
    """The message of the controller of which each is passed on."""
    read: Callable[[Any], Any]
    """Makes the value of such a message."""


class CarriedCamera(NamedTuple):
    """A camera that a robot carries."""

    name: str
    component: int
    """Of the controller."""


class RobotProxy(Robot):
    """Stands for one robot, which its controller moves."""

    limits: Limits = NO_LIMITS
    """The limits that are checked before the wire; a kind sets its own."""
    readers: MessageReaders = READERS
    """How its telemetry is read; a kind may set its own."""
    reading_units = UNITS
    """Units of the readings; a kind with its own readers adds theirs."""
    streamed: ClassVar[Sequence[Streamed]] = ()
    """Its streams that are telemetry."""
    camera: ClassVar[CarriedCamera | None] = None
    """The camera of its stream `pictures`; None: it has none."""
    frame: ClassVar[str] = ""
    """What its coordinates are in, behind the name of its controller; empty: W of the controller."""
    settled_at: float = 0.0
    """When the last motion ended [s]: what was heard before shows the robot as it was."""

    def __init_subclass__(cls) -> None:
        """Keep the units of the readings that every kind has, such as `age`."""
        super().__init_subclass__()
        cls.reading_units = {**UNITS, **cls.reading_units}

    def __init__(  # noqa: PLR0913  the options of a command line, and what tests replace
        self,
        name: str,
        url: str,
        limits: Limits = NO_LIMITS,
        *,
        dial: Dial = connect,
        chance: random.Random | None = None,
        security: LinkSecurity = UNSIGNED,
        take_over: bool = False,
        runner: Runner | None = None,
        component: int = CONTROLLER.component,
    ) -> None:
        """Prepare the proxy; nothing is opened before `run`.

        Args:
            name: of the robot, unique in the realm.
            url: where its controller listens.
            limits: those that are not the kind's in this place.
            dial: opens a link.
            chance: for the waits between attempts to connect.
            security: the keys of our links.
            take_over: have the controller obey us also if another proxy holds it.
            runner: its clock, and what its commands wait in; None: threads.
            component: MAVLink component of the controller that moves this robot.

        Raises:
            BadName: that cannot be a name.
            ValueError: the kind has no such limit.
        """
        link = SIGNED_LINK if security.signed else OPEN_LINK
        moving = {FRAME: f"{url}{self.frame}"} if self.frame else {}
        super().__init__(name, {"controller": url, LINK: link, **moving})
        self.online = False
        self.on_change: Callable[[], None] = lambda: None
        """Called on the loop when the robot goes online or offline, is held or released; for its agent."""
        self.limits = changed(self.limits, limits)
        controller = Target(CONTROLLER.system, component)
        holder = f"{name}, pid {(runner or Threads()).pid()}"
        claim = ClaimClient(*controller, holder=bits(64) or 1, name=holder, take_over=take_over)
        self._session = ControllerSession(
            component=component_of(name), controller=controller, readers=self.readers, claim=claim
        )
        self._connection = Connection(
            url,
            self._session,
            on_event=self._handle,
            on_message=self._pass_on if self.streamed else None,
            dial=dial,
            chance=chance,
            security=security,
            runner=runner,
        )
        view = partial(WorkspaceView, name, url, dial=dial, chance=chance, security=security)
        self._show = self._show_of(view)
        self._pending = PendingGoals(self._connection)
        self._mode_requests = ModeRequests(name)
        self._epochs = EpochCheck(name)
        self._sent: WeakKeyDictionary[Activity, int] = WeakKeyDictionary()
        """Number of the last motion that each running command has asked for, from 0 on."""

    def _show_of(self, view: Callable[..., WorkspaceView]) -> PictureShow | None:
        """Return what streams the pictures of its camera, over a view of its own; None: it has no camera."""
        if self.camera is None:
            return None
        name, component = self.camera
        opened = partial(view, cameras={name: component}, answer_within=PATIENT)
        return PictureShow(partial(getattr, self, "pictures"), opened, name)

    async def run(self) -> None:
        """Keep the connection up until cancelled.

        Raises:
            BadUrl: the controller's address means nothing.
        """
        show = None if self._show is None else asyncio.ensure_future(self._show.run())
        try:
            await self._connection.run()
        finally:
            if show is not None:
                show.cancel()
                await asyncio.gather(show, return_exceptions=True)
            self._pending.close("its proxy has ended")

    @property
    def controller_epoch(self) -> int:
        """The highest epoch that the controller has reported; 0: none yet."""
        return self._session.obeyed

    @property
    def denied(self) -> str:
        """Why the controller does not obey this proxy, as a clause; empty: it does."""
        return self._session.denial

    def disturb(self, *, cut: bool, delay: float) -> None:
        """Lose everything on the link for a drill, or deliver it `delay` [s] later; neither: as it was."""
        self._connection.disturb(Faults(loss=float(cut), delay=delay))

    # -- hooks of a robot --------------------------------------------------------------------------

    def readings(self) -> dict[str, float]:
        """Return the last known readings, however old; `age` [s] is their age."""
        return self._session.twin.readings(self._connection.now())

    def safe_stop(self, reason: str) -> ModeRequest:  # noqa: ARG002  the wire has no place for it
        """Stop the robot at its controller: at once, and again until it is confirmed.

        Returns:
            An awaitable that returns when the controller has confirmed the stop. To cancel the wait does not
            withdraw the stop.
        """
        request = ModeRequest()
        self._connection.soon(lambda: self._send_stop(request))
        return request

    def resume(self) -> ModeRequest:
        """Release the stop at the controller.

        Returns:
            An awaitable that returns when the controller has confirmed the release, and raises
            `CommandFailed` if it refuses it or does not answer. To cancel the wait withdraws the release: the
            robot is stopped, also if it was released meanwhile.
        """
        request = ModeRequest(lambda: self._connection.soon(lambda: self._withdraw(request)))
        self._connection.soon(lambda: self._send_release(request))
        return request

    # -- commands of every robot -------------------------------------------------------------------

    @command(effect="read")  # so that it does not wait for the motion that it must end
    def halt(self) -> None:
        """Stop moving and stay here, compliantly; the next command may move again."""
        # PLCopen's names (Motion Control, part 1): after MC_Halt the next command moves, after MC_Stop only a
        # release makes that possible, as after a protective stop here.
        self.carry_out(Hold())

    # -- for the kinds -----------------------------------------------------------------------------

    def carry_out(self, motion: Motion, *, before: Callable[[], object] = lambda: None) -> None:
        """Have the controller carry out a motion of the running command and wait for its end.

        A command may have several motions, one after the other. Sent again, it must ask for the same ones in
        the same order: the controller does not repeat those that it has carried out.

        Args:
            motion: what it is to do.
            before: called before it is sent, unless an earlier process of the proxy has sent it: raises why
                it is not to be.

        Raises:
            BadArgument: a value is out of its limit; nothing was sent.
            StaleEpoch: the lease under which it is asked is over.
            CommandFailed: the controller is offline, refuses, or did not get there.
            CommandInDoubt: it adds up, and nobody knows whether it was carried out.
            CommandCancelled: it was ended on request or for something newer, perhaps before this motion.
            DeadlineExceeded: its time was over first.
        """
        self.check()
        self._wait_until_settled()
        context = self.context
        check(motion, self.limits, command=f"{self.name}.{context.command}")
        if not self._session.claims:
            self._epochs.raise_to(self.controller_epoch)
        self._epochs.admit(context.epoch)
        ttl = time_to_live(context.deadline_at - self._connection.now())
        effect = self._effect_of(motion)
        activity = running()
        number = self._sent[activity] = self._sent.get(activity, -1) + 1
        key, life = goal_key(context.key, number), self._life_of_witness(effect)
        start = partial(self._pending.start, key, activity=activity, ttl=ttl, life=life)
        if life is not None:  # an earlier process may have asked for it: the controller knows
            pending = start(ASK, repeatable=False)
            self._follow(pending)
            match pending.end:
                case GoalEnded(state=GoalState.UNKNOWN, reason=why) if why != Reason.OTHER_LIFE:
                    pass  # the controller does not know it, in the life that was asked about: it is new
                case _:
                    self._raise_outcome(pending, effect)
                    return
        before()
        pending = start(motion.request(), repeatable=effect != "once")
        self._follow(pending)
        self._raise_outcome(pending, effect)

    def foresee(self, motion: Motion) -> PreviewedWay:
        """Ask the controller whether it would carry out a motion now, and which way it would take.

        Nothing moves. The limits are those of `carry_out`, and the rest is the controller's own planner.

        Args:
            motion: what it would be to do.

        Returns:
            The way, or why it would be refused, which is no failure of the question; unchecked, if the
            controller answers no such questions.
        """
        self.check()
        self._wait_until_settled()
        try:
            check(motion, self.limits, command=self.name)
        except BadArgument as error:
            return refused_way(f"{error.data['parameter']} {error.data['reason']}")
        if barred := self.denied or (not self.online and f"{self._session.trouble}; {NEXT}"):
            return refused_way(barred)
        verb, args = motion.request()
        number, asked = bits(31) or 1, self.asked_at
        padded = (*args, *[math.nan] * (7 - len(args)))
        controller, activity, session = self._session.controller, running(), self._session
        question = WayRequest(number, padded, verb, controller.system, controller.component)

        def answered() -> bool:
            found = session.twin.after(WayStatus, asked)
            return (found is not None and found.number == number) or bool(session.trouble)

        with self._connection.awaiting(WayStatus, asked, activity.wake):
            self.tell(question)
            activity.wait_for(answered, READING_TIMEOUT)
        found = session.twin.after(WayStatus, asked)
        if session.trouble:
            return refused_way(f"{session.trouble}; {NEXT}")
        if found is None or found.number != number:
            return PreviewedWay(x=[], y=[], z=[], duration=0.0, checked=False)
        refusal = found.text.rstrip(". ") or reason_in_words(found.reason)
        return way_of(found) if found.reason == Reason.NONE else refused_way(refusal)

    def tell(self, message: AnyMessage) -> None:
        """Send something once that is no motion; only the controller knows whether it has come."""
        self._connection.soon(lambda: self._connection.perform([Send(message)]))

    def news(self, kind: type[T], *, since: float) -> T:
        """Wait for a message that was heard after a moment.

        Args:
            kind: of message.
            since: [s] on the connection's clock.

        Raises:
            CommandFailed: the controller is offline, or does not tell it.
        """
        self._wait_until_settled()
        session, activity = self._session, running()
        message, trouble = None, ""

        def decided() -> bool:
            nonlocal message, trouble  # both of the same look: the controller may be back a moment later
            message, trouble = session.twin.after(kind, since), session.trouble
            return message is not None or bool(trouble)

        with self._connection.awaiting(kind, since, activity.wake):
            activity.wait_for(decided, READING_TIMEOUT)
        if message is not None:
            return message
        if trouble:
            raise self._failed(f"{trouble}; {NEXT}")
        name = kind.codec.definition.name
        raise self._failed(f"the controller sends no {name}; is it a {self.kinds()[0]}?")

    @property
    def asked_at(self) -> float:
        """The present moment [s] on the connection's clock: what is heard after it is news."""
        return self._connection.now()

    # -- inside ------------------------------------------------------------------------------------

    def _pass_on(self, message: AnyMessage) -> None:
        """Stream what a message of the controller tells. On the loop."""
        for one in self.streamed:
            if type(message) is one.message:
                sending: Sending[Any] = getattr(self, one.stream)
                if sending.wanted:
                    sending.send(one.read(message))

    def _send_stop(self, request: ModeRequest) -> None:
        self._mode_requests.add("safe_stop", request)
        self._pending.cancel_ended()  # before any release can be sent
        self._connection.perform(self._session.stop(self._connection.now()))

    def _send_release(self, request: ModeRequest) -> None:
        self._mode_requests.add("resume", request)
        epoch = max(self._epochs.highest, self.controller_epoch)
        self._connection.perform(self._session.release(epoch, self._connection.now()))

    def _withdraw(self, resume: ModeRequest) -> None:
        now = self._connection.now()
        if resume.confirmed:  # confirmed before the cancel: the caller does not know
            self._connection.perform(self._session.stop(now))
        elif self._mode_requests.withdraw(resume):
            self._connection.perform(self._session.withdraw(now))

    def _life_of_witness(self, effect: Effect) -> int | None:
        """Return the life of the controller in which an earlier process was asked for the running command.

        Returns:
            None: no process was.

        Raises:
            CommandInDoubt: the controller knows our goals by another component now.
        """
        witness = self.context.witness
        if not witness:
            return None
        component, _, life = witness.partition("/")
        if component != str(self._session.component) or not life.isdigit():
            detail = "its controller knows what was asked for under another component"
            raise unclear(detail, self.name, self.context.command, effect)
        return int(life)

    def _follow(self, pending: PendingGoal) -> None:
        """Wait for the end of a goal; what is heard from then on shows the robot as it is."""
        try:
            self._wait_for(pending)
        finally:
            self.settled_at = self._connection.now()

    def _wait_for(self, pending: PendingGoal) -> None:
        """Wait for the end of a goal; cancel it when the command is asked to end."""
        shown = -1.0
        try:
            while pending.end is None:
                if pending.fraction != shown:
                    shown = pending.fraction
                    self.progress(shown)
                pending.activity.wait_for(partial(_has_news, pending, shown))
        except (CommandCancelled, DeadlineExceeded):
            self._pending.cancel(pending)
            pending.wait(CANCEL_TIMEOUT)
            raise

    def _wait_until_settled(self) -> None:
        """Wait for the first messages on a new link, so that the first command after `ready` is obeyed."""
        until = self._connection.now() + SETTLED
        while self._session.settling(now := self._connection.now()) and now < until:
            self.sleep(0.01)

    def _effect_of(self, motion: Motion) -> Effect:
        """The effect of repeating a motion of the running command: `once` if either declares it."""
        known = commands_of(type(self)).get(self.context.command)
        return "once" if known is None or "once" in {known.spec.effect, motion.effect} else "repeat"

    def _raise_outcome(self, pending: PendingGoal, effect: Effect) -> None:
        """Raise the error that the end of a goal means for the command."""
        match pending.end:
            case NotSent(trouble=trouble):
                self.check()
                if pending.life is not None:
                    raise unclear(f"it cannot be asked: {trouble}", self.name, self.context.command, effect)
                raise self._failed(trouble if self.online else f"{trouble}; {NEXT}")
            case GoalSilent() | None as end:
                acknowledged = end is not None and end.acknowledged
                heard, kind = self._connection.now() - self._session.heard_at, self.kinds()[0]
                detail = silence_in_words(acknowledged=acknowledged, heard=heard, kind=kind)
                raise unclear(detail, self.name, self.context.command, effect)
            case OutcomeLost(trouble=trouble):
                detail = f"{trouble}; look whether the robot still moves"
                raise unclear(detail, self.name, self.context.command, effect)
            case end:
                error = error_of(
                    end,
                    robot=self.name,
                    command=self.context.command,
                    epoch=pending.epoch,
                    obeyed=self._session.obeyed,
                    effect=effect,
                )
                if error is not None:
                    raise error
                if end.text:  # such as: it got there, but something pulls at it
                    self.progress(1.0, end.text)

    def _failed(self, detail: str) -> CommandFailed:
        return CommandFailed(robot=self.name, command=self.context.command, detail=detail)

    def _handle(self, event: SessionEvent) -> None:
        self.witness = self._session.witness
        match event:
            case OnlineChanged(online=online):
                self.online = online
                if self._session.simulated is not None:
                    self.attributes["simulated"] = "yes" if self._session.simulated else "no"
                self.on_change()
            case HeldChanged(reason=reason):
                self.halted = reason
                self.on_change()
            case StopConfirmed() | ReleaseConfirmed() | ReleaseRefused() | ReleaseUnanswered():
                self._mode_requests.handle(event, "" if self.online else self._session.trouble)
            case ClaimGranted(taken_from=other):
                if other:
                    _log.warning("%s: took its controller over from %r (--take-over)", self.name, other)
                self.attributes.pop(HELD_BY, None)
                self.on_change()
            case ClaimDenied(name=holder):
                _log.warning("%s: %s", self.name, self._session.denial)
                self.attributes[HELD_BY] = holder or "nobody"
                self.on_change()
            case _:
                self._pending.handle(event)


def _has_news(pending: PendingGoal, shown: float) -> bool:
    return pending.end is not None or pending.fraction != shown
