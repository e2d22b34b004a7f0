"""A robot at work in a process: its core behind one lock, its code on workers, and the one way to call it.

All calls, of an operator, of its parent or of a command that it lets through to a child, come by `admit`: the
command is found, its arguments are checked, the call is accepted by the core and written to the journal, and
only then anything begins. `post` is the one door to the core. Effects are carried out outside the lock.
"""

from __future__ import annotations

import inspect
import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from functools import partial
from types import FrameType
from typing import Any, TypeVar, cast

import msgspec

from robotree.files import forks
from robotree.vr.author.child import Exposed
from robotree.vr.author.command import commands_of
from robotree.vr.author.context import CommandContext
from robotree.vr.author.fields import SET
from robotree.vr.author.robot import Robot
from robotree.vr.author.signature import Command
from robotree.vr.author.virtual_robot import VirtualRobot, exposures_of, slot_specs
from robotree.vr.base.address import Address, Role, everyone
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import Arguments, CommandSpec, FieldSpec, Placement, offered
from robotree.vr.base.errors import (
    BadArgument,
    CommandInDoubt,
    Denied,
    NoSuchCommand,
    NotPermitted,
    OnItsWay,
    VrError,
)
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.principal import ITSELF, Principal, is_person, principal_of
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    AnyRequest,
    Call,
    Cancel,
    Level,
    Reply,
    State,
    StreamSample,
)
from robotree.vr.base.transport import Transport
from robotree.vr.base.units import takes_long
from robotree.vr.core import events as on
from robotree.vr.core.bonds import Bond, Lease
from robotree.vr.core.events import Begin, CoreEffect, CoreEvent, Interrupt, Settled
from robotree.vr.core.machine import AcceptedCall, Lap, RobotCore, RobotState
from robotree.vr.core.traffic import BondTraffic
from robotree.vr.exchange.asking import TakeReply, send_request
from robotree.vr.exchange.authority import OF_LEASES, Here, authorise, expect_still
from robotree.vr.running.ice import AtWork, Frozen, Ice
from robotree.vr.running.log import Log, waits
from robotree.vr.running.own_errors import as_itself
from robotree.vr.running.page_trace import line_at_work
from robotree.vr.running.process import Process, Worker
from robotree.vr.running.run import NO_PROGRESS, HeldStep, Listener, OfferedTurn, Run

LONGEST_NOTE = 80
"""Characters of a command's progress text that the state of its robot contains."""

LATE = 0.001
"""[s] that a deadline may be noticed late, so that deadlines which differ by rounding share one timer."""

INVISIBLE = frozenset(
    {Begin, Settled, on.RenewLease, on.AskPart, on.LeaseGranted, on.StopTaken, on.AttentionPassed}
)
"""Effects that others do not see: a call that only reads, a renewal, a copy of a stop."""

NUMBERS = frozenset({float, int, bool})
"""Types of arguments in which there is no text."""

_T = TypeVar("_T")
_log = logging.getLogger(__name__)


FollowChild = Callable[[Address, str, Callable[[State | StreamSample], None]], Callable[[], None]]
"""Hands on what a robot publishes under a topic, `state` or `stream/NAME`; returns how to end that."""


class NotDescribed(Exception):
    """The known description of the child in a slot does not show a command: it has to be asked."""

    def __init__(self, slot: str, command: str) -> None:
        """Name both."""
        super().__init__(f"{slot}.{command}")
        self.slot, self.command = slot, command


OnDescribed = Callable[[VrError | None], None]
"""Called when a child was asked for a command: with None, or with why it was in vain."""


class RobotRuntime:
    """One robot at work; see the module."""

    page: str = ""
    """Where its author keeps its page, for a reload; empty: nobody knows."""
    identity: str = ""
    """See `RobotDescription.identity`."""
    ordered: frozenset[str] = frozenset()
    """Keys of commands that were left as orders: they go on as long as their askers may order."""
    takes_order: int = 0
    """Whether it has taken an order that is not over: only its host knows of it."""
    on_call: Callable[[Call, bool], None] | None = None
    """Told of each call that is accepted, and whether it only reads. In any thread; must not block."""
    turned: bool = False
    """Whether accepted calls may have been checked for another page."""
    unchecked = False
    """Whether its page runs though nobody trusted has signed it."""
    permissions: Permissions | None = None
    """What its page may do beyond itself; None: it is not limited. It changes with the page."""
    _coming: tuple[VirtualRobot, Callable[[VrError | list[str] | None], None], Permissions | None] | None = (
        None
    )
    """The page that waits for a boundary between commands."""
    _reminder: float = math.inf
    """[s] when the watchdog looks next."""
    has_news: bool = True
    """Whether something has changed that others may see; set back by what publishes it."""
    on_move: Callable[[str, Callable[[VrError | None], None]], None] | None = None
    """Has it move to a host; told why it does not, or None: it is there. None: its process is no host."""
    on_locate: Callable[[str, Callable[[str | VrError], None]], None] | None = None
    """Finds the host of the child in a slot, or one beside it. None: its process is no host."""
    _last_obeyed: int = -1
    _looks: bool = False
    """Whether people whose commands wait are told of it again in a moment."""
    ice: Ice | None = None
    """Set while it is about to leave, and after it has left; see `ice.py`."""
    _cleared: bool = False
    """Whether nothing of its code is left here after it has left."""
    on_way: str = ""
    """Name of the host to which it is moving; empty: it is not."""
    in_doubt: bool = False
    """Whether it is not known if it has arrived there."""
    came: bool = False
    """Whether it has come from another host, where its commands have begun: they go on in any case."""
    neighbours: dict[Address, RobotRuntime]
    """The robots in this process."""
    traffic: BondTraffic
    """What goes to and fro between it and those with whom it has to do."""
    advice: str = ""
    """What the latest look at its place has shown, as a sentence; empty: nobody has looked."""
    advised: str = ""
    """Name of the host where it would be better off, by that look; empty: nowhere."""
    drill: str = ""
    """What it suffers for a drill, for people; empty: nothing."""
    _at_work = ("", 0)
    """The call that runs and how many wait, as it was last published."""

    def __init__(  # noqa: PLR0913 # what it runs on, and its ways to the others
        self,
        robot: Robot,
        core: RobotCore,
        process: Process[RobotRuntime],
        *,
        execute: Callable[[RobotRuntime, str, Run, Worker], None],
        transport: Transport,
        describe_child: Callable[[NotDescribed, OnDescribed], None],
        follow_child: FollowChild,
        obeyed: Callable[[], int | None] | None,
        on_effect: Callable[[CoreEffect], None],
    ) -> None:
        """Prepare; nothing runs before the first call.

        Args:
            robot: with the author's code.
            core: its state.
            process: whose threads carry it out.
            execute: carries out the code of a call on a worker; see `activity.execute`.
            transport: the way to children in other processes.
            describe_child: asks the child in a slot anew who it is, from any thread, without waiting.
            follow_child: hands on what a child, or a robot that is watched, publishes under a topic, from any
                thread, without waiting; returns how to end that.
            obeyed: returns the epoch that what stands behind the robot obeys, None before it was heard; None:
                nothing stands behind it.
            on_effect: carries out what is not about calls. In any thread.

        Raises:
            TypeError: the robot's class declares a command in a way that cannot be called from afar.
        """
        self.robot, self.core, self.process, self.name = robot, core, process, robot.name
        self.address, self.key = core.state.address, core.state.address.key
        self.principal = principal_of(transport.identity, self.key, "")
        """The robot where it asks for something."""
        self.here = Here("robot", robot.name, transport.gate, self.kinds)
        self._policy = transport.gate.policy  # to which its commands have kept
        self.isolated = robot.isolated  # its commands always run on workers of their own
        if isinstance(robot, VirtualRobot):
            self._give_state(robot)
        self.frames = set[AtWork]()  # its code that is at work
        self.runs: dict[str, Run] = {}  # its calls that have not ended, by key
        self._interrupted = self._interrupted_calls()
        self.describe_child, self.follow_child = describe_child, follow_child
        self._execute, self._transport, self._obeyed, self._on_effect = execute, transport, obeyed, on_effect
        self.on_news: Callable[[], None] = _nothing
        """Called when `has_news` becomes true. In any thread."""
        self._journal, self._runner, self._lock = process.journal, process.runner, process.runner.lock()
        self._commands, self._exposures = commands_of(type(robot)), exposures_of(type(robot))
        self.log = Log(self._runner.now, self._runner.unix, self._runner.lock(), self._parameters_of)
        """The output of its code, and the ends of its commands."""
        self.traffic = BondTraffic(self._runner.now, self._runner.lock())
        self._bereft: dict[str, dict[Callable[[VrError], None], None]] = {}
        """Those who are told when the child in a slot is gone, by slot, in their order."""
        self._unremind: Callable[[], None] = _nothing
        self.neighbours, self._life = process.robots, _life_of(process, core.state.moves)
        self.log.know(self.core.state.calls.live)
        self.paused = core.state.pause.in_force != ""  # then commands look before each step: see `may_pass`
        self._held: dict[str, HeldStep] = {}  # those before which commands wait, by key, the oldest first
        self._ledgers: dict[str, _Ledger] = {}  # the numbered calls of each distant child: parent/slot/epoch

    # -- the one door -----------------------------------------------------------------------------

    def post(  # noqa: C901, PLR0912 # the steps of one change, in their order
        self,
        event: CoreEvent,
        *,
        listener: Listener | None = None,
        turn: OfferedTurn | None = None,
        accepted: Callable[[], None] | None = None,
    ) -> Sequence[CoreEffect]:
        """Let an event change the state, write it down, then carry out what follows.

        Args:
            event: what happened.
            listener: told how the call of an `Invoke` fares.
            turn: has the caller's worker carry the command out when it is its turn; see `Run.turn`.
            accepted: called when the event is written down and before anything begins.

        Returns:
            What followed; the answer to the asker is among it, for the state may be another one by now.

        Raises:
            VrError: the event is refused; nothing has changed.
        """
        if forks.is_child:
            forks.expect_parent()
        now, refusal = self._runner.now(), None
        with self._lock:
            if (ice := self.ice) is not None and ice.closed:
                return self._post_on_way(ice, event, now)
            effects: list[CoreEffect] = []
            if self.core.due <= now and not isinstance(event, on.Tick):
                effects = self._handle(on.Tick(unix=self._runner.unix()), now)
            try:
                effects += self._handle(event, now)
            except VrError as error:
                refusal = error
            else:
                if isinstance(event, on.Invoke):
                    self._run_of(event.call.key).attend(listener, turn)
            turned = None if self._coming is None else self._turn_page(effects, now)
            shows = self._shows(effects)
            due = self.core.due
        if self._journal is not None:
            self._journal.commit()
        if refusal is None and accepted is not None:
            accepted()
        if turned is not None:
            turned()
        if turn is None:  # else its caller watches over the deadline
            self._remind_at(due)
        if shows:
            if not self.has_news:
                self.changed()
            if self._at_work[1]:
                self._tell_waiting()
        self._carry_out(effects)  # last, for this wakes other threads, which wait for the interpreter then
        if refusal is not None:
            raise refusal
        return effects

    def _post_on_way(self, ice: Ice, event: CoreEvent, now: float) -> list[CoreEffect]:
        """Take an event while the robot is on its way, or has left: only leases are kept. Under the lock.

        Raises:
            Frozen: it is a call, which is to wait.
            OnItsWay: it would change who commands the robot.
        """
        if isinstance(event, on.Invoke):
            raise Frozen(ice)
        if isinstance(event, on.Prolong):
            lease = self.core.state.lease.current
            asker = (event.principal, event.heir)
            if ice.moved or lease is None or event.proof or asker != (lease.principal, lease.heir):
                raise OnItsWay(robot=self.name)
            return self.core.handle(event, now)
        if ice.moved:
            return []
        if isinstance(event, on.Renewed):
            self.core.handle(event, now)
        elif not isinstance(event, on.Tick):
            ice.deferred.append(event)
        return []

    # -- leaving ----------------------------------------------------------------------------------

    @property
    def reloads(self) -> bool:
        """Whether another page waits for its turn."""
        return self._coming is not None

    def is_as_made(self, name: str, value: object) -> bool:
        """Whether an ordinary attribute of its page is what the constructor has made of it."""
        made = self._as_made.get(name)
        return made is not None and made[0] is value and (made[1] is None or made[1] == value)

    @property
    def has_left(self) -> bool:
        """Whether it goes on in another process."""
        return self.ice is not None and self.ice.moved

    @property
    def is_on_way(self) -> bool:
        """Whether its core takes nothing at the moment: it may be elsewhere already."""
        return self.ice is not None and self.ice.closed

    def put_off(self, work: Callable[[], object]) -> bool:
        """Do something only if the robot goes on here, if it is on its way; False: it is not."""
        with self._lock:
            ice = self.ice
            if ice is None or not ice.closed:
                return False
            if not ice.moved:
                ice.deferred.append(work)
            return True

    def freeze(self, *, closed: bool = False) -> None:
        """Have its code come to a stand; `closed`: it has none, and the core takes nothing from now on."""
        with self._lock:
            self.ice = Ice(self._runner)
            self.ice.closed = closed
            self.process.still += 1
        for frame in tuple(self.frames):
            frame.wake()

    @property
    def is_still(self) -> bool:
        """Whether all its code stands."""
        return all(frame.parked or frame.above is not None for frame in tuple(self.frames))

    def close(self) -> bool:
        """Take nothing more; returns whether all code stands, else nothing has changed."""
        with self._lock:
            if self.ice is None or not self.is_still:
                return False
            self.ice.closed = True
            return True

    def thaw(self) -> None:
        """Go on here."""
        with self._lock:
            ice, self.ice = self.ice, None
            self.process.still -= 1
        if ice is None:
            return
        for put_off in ice.deferred:
            if callable(put_off):
                put_off()
                continue
            try:
                self.post(put_off)
            except VrError as error:
                _log.warning("%s: %s", self.name, error)
        ice.melt(moved=False)
        for frame in tuple(self.frames):
            frame.wake()
        self._reminder = math.inf
        self.pass_time()

    def leave(self) -> None:
        """It goes on elsewhere: its code here ends, and who waits for it asks there."""
        ice = self.ice
        assert ice is not None  # noqa: S101 # it was frozen before
        self._unremind()
        self.neighbours.pop(self.address, None)
        ice.melt(moved=True)
        for put_off in ice.deferred:
            if isinstance(put_off, on.CancelAsked) and put_off.principal.agent:
                self._cancel_elsewhere(put_off)
        for run in tuple(self.runs.values()):
            for listener in run.listeners:
                listener.go_elsewhere()
        for frame in tuple(self.frames):
            frame.wake()
        with self._lock:
            self._release_still()

    def _cancel_elsewhere(self, order: on.CancelAsked) -> None:
        """Hand on what a robot of this process wants to end."""
        epoch = self.look(lambda state: None if state.lease.current is None else state.lease.epoch)
        cancel = Cancel(key=order.key, epoch=epoch, reason=order.reason)
        now, sender = self._runner.now(), order.principal.agent
        send_request(
            self._transport,
            self.key,
            cancel,
            _ignore,
            now=now,
            within=ANSWER_WITHIN,
            sender=sender,
            urgent=True,
        )

    def frame_ended(self, frame: AtWork) -> None:
        """Take note that code of it has ended. From any thread."""
        self.frames.discard(frame)
        if self.ice is not None:
            with self._lock:
                self._release_still()

    def _release_still(self) -> None:
        """Look after code of robots that have left no longer, if none is left of this one. Under the lock."""
        if self.has_left and not self.frames and not self._cleared:
            self._cleared = True
            self.process.still -= 1

    def reload(
        self,
        robot: VirtualRobot,
        done: Callable[[VrError | list[str] | None], None],
        permissions: Permissions | None = None,
    ) -> None:
        """Go on with another page as soon as no command that moves is running.

        Args:
            robot: made of the other page.
            done: told what changed, as sentences, or why it is refused; None: a later one has replaced it.
            permissions: of the other page; None: it is not limited.
        """
        before, self._coming = self._coming, (robot, done, permissions)
        if before is not None:
            before[1](None)
        self.pass_time()

    def withdraw_page(self, robot: VirtualRobot) -> bool:
        """Do not go on with a page that waits for its turn; returns whether it did."""
        with self._lock:
            waits = self._coming is not None and self._coming[0] is robot
            if waits:
                self._coming = None
        return waits

    def _turn_page(self, effects: list[CoreEffect], now: float) -> Callable[[], None] | None:
        """Go on with the page that waits, if this is a boundary between commands. Under the lock.

        Returns:
            What is to be called outside of the lock; None: nothing.
        """
        coming, calls = self._coming, self.core.state.calls
        begins = {effect.key for effect in effects if isinstance(effect, Begin)}
        if coming is None or (calls.running and calls.running not in begins):
            return None
        (robot, done, permissions), self._coming = coming, None
        state = self.core.state
        specs = slot_specs(type(robot))
        slots = set(state.slots.by_name)
        try:
            fields, notes = robot.field_values.taken_over(state.fields)
            effects += self._handle(on.PageReloaded(slots=specs, fields=fields), now)
        except VrError as refusal:
            return partial(done, refusal)
        gone = sorted(slots - set(state.slots.by_name))
        notes = [f"the slot {name} is gone" for name in gone] + notes
        self._give_state(robot)
        self.robot, self._commands = robot, commands_of(type(robot))
        self._exposures, self.turned = exposures_of(type(robot)), True
        self.permissions = permissions
        return partial(done, notes)

    def _give_state(self, robot: VirtualRobot) -> None:
        """Let a robot's page see the state of the core, whichever that is at the moment."""
        robot.slots_now = lambda: self.core.state.slots
        robot.field_values.live(lambda: self.core.state.fields, self._keep)
        self._as_made = {name: (value, _copied(value)) for name, value in vars(robot).items()}

    def pass_time(self) -> None:
        """Have what is due end."""
        self.post(on.Tick(unix=self._runner.unix()))

    def kinds(self) -> tuple[str, ...]:
        """Return the kinds of the robot, whichever page it has now."""
        return self.robot.kinds()

    def authorise(self, principal: Principal, request: AnyRequest) -> None:
        """Refuse a request that its principal may not make; see `authority.authorise`."""
        by_state = self.here.gate.closed and (
            isinstance(request, Cancel) or (isinstance(request, Call) and request.permit != "")
        )
        if by_state or isinstance(request, OF_LEASES):
            self.look(lambda state: authorise(principal, request, state, self.here))
        else:
            authorise(principal, request, None, self.here)

    def keep_to_policy(self) -> None:
        """End the commands of those who may not command the robot any more, when the policy has changed."""
        gate, now = self.here.gate, self._runner.now()
        if now >= gate.due:
            gate.refresh(now)
        if gate.policy is self._policy:
            return
        self._policy = gate.policy
        for call in self.look(lambda state: tuple(state.calls.live.values())):
            what = "order" if call.key in self.ordered else "command"
            try:
                expect_still(call.principal, call.command, self.here, what)
            except Denied as denied:
                self.cancel(call.key, f"the policy has changed: {denied}")

    def look(self, query: Callable[[RobotState], _T]) -> _T:
        """Ask the state something while nothing changes it.

        Args:
            query: returns a value: no part of the state that may change is known outside.
        """
        with self._lock:
            return query(self.core.state)

    def expect_to_command(self, epoch: int | None, principal: Principal, *, ends: bool = False) -> None:
        """Refuse a principal who may not command the robot, under the lease of an epoch or without any.

        Raises:
            LeaseError: he may not.
        """
        now = self._runner.now()

        def check(state: RobotState) -> None:
            state.lease.check(epoch, now, principal, ends=ends)
            if not ends:
                state.control.expect(self.name, principal)

        self.look(check)

    @property
    def lease(self) -> Lease | None:
        """The lease that the robot has granted; None: it is free."""
        return self.look(lambda state: state.lease.current)

    def _run_of(self, key: str) -> Run:
        """Return what is known of a live call; nothing, if the state was decoded."""
        run = self.runs.get(key)
        if run is None:
            run = self.runs[key] = Run()
        return run

    def _handle(self, event: CoreEvent, now: float) -> list[CoreEffect]:
        """Let an event change the state, and write it down; returns what follows. Under the lock."""
        effects = self.core.handle(event, now)
        if self._journal is not None:
            self._journal.append(self.key, now, event)
        return effects

    def keep_step(self, key: str, path: str, step: on.StepResult) -> None:
        """Keep what a step of a running command gave. From any thread."""
        now, event = self._runner.now(), on.StepTaken(key=key, path=path, step=step)
        with self._lock:
            if (ice := self.ice) is not None and ice.closed:
                self._post_on_way(ice, event, now)
            else:
                self._handle(event, now)

    def keep_fields(self, values: dict[str, Any]) -> None:
        """Keep what code wrote before its process ended, where it was not written down."""
        now = self.look(lambda state: dict(state.fields))
        if changed := {name: value for name, value in values.items() if now.get(name) != value}:
            self._keep(changed)

    # -- its place --------------------------------------------------------------------------------

    @property
    def placement(self) -> Placement:
        """How it is moved: as a person has set it, else as its class says; a proxy stays."""
        mode: Placement | None = self.look(lambda state: state.placing.mode)
        if mode is not None:
            return mode
        robot = self.robot
        return robot.placement if isinstance(robot, VirtualRobot) else "manual"

    # -- pauses -----------------------------------------------------------------------------------

    def may_pass(self, step: str) -> bool:
        """Whether the step of a key may be taken."""
        return self.look(lambda state: state.pause.may_pass(step))

    def hold(self, path: str, held: HeldStep) -> None:
        """Take note that a command waits before a step, and tell who has called it. From any thread."""
        with self._lock:
            self._held[path] = held
            by = self.core.state.pause.in_force
        self._tell_held(held, f"paused by {by} before {held.step}; its deadline goes on")

    def let_go(self, path: str) -> None:
        """It waits no longer."""
        with self._lock:
            held = self._held.pop(path)
        self._tell_held(held, f"takes {held.step}")

    def _tell_held(self, held: HeldStep, text: str) -> None:
        if run := self.runs.get(held.call):
            run.tell(math.nan, text)
        self.changed()

    def held_step(self) -> str:
        """Return the step, in words, that waits for the longest time; empty: none waits. Under the lock."""
        path = self._longest_held()
        return self._held[path].step if path else ""

    def _longest_held(self) -> str:
        """Return the key of the step that waits for the longest time; empty: none waits. Under the lock."""
        may_pass = self.core.state.pause.may_pass
        return next((path for path in self._held if not may_pass(path)), "")

    def _look_at_pause(self) -> None:
        """Have those look again that wait before a step."""
        with self._lock:
            self.paused = self.core.state.pause.in_force != ""
            waiting = list(self._held.values())
        for held in waiting:
            held.wake()

    def let_step(self, epoch: int | None, principal: Principal) -> str:
        """Let the step pass that waits for the longest time; returns it in words, empty: none waits.

        Raises:
            NotPaused: the robot is not paused.
            LeaseError: its parent has paused it, and somebody else asks.
        """
        with self._lock:
            path, words = self._longest_held(), self.held_step()
        self.post(on.StepLet(step=path, epoch=epoch, principal=principal))
        return words

    def checkpoint(self, key: str, place: str = "") -> None:
        """Have a running command go on from a place of its page, if it is interrupted; empty: begin anew."""
        self.post(on.Checkpoint(key=key, place=place))
        run = self.runs[key]
        call = self.look(lambda state: state.calls.live[key])
        run.lap, run.fields = f"{call.lap}.", call.fields

    def ask_person(self, key: str, question: str) -> None:
        """Have a person asked before a running command goes on; the answer comes as `Run.answer`."""
        self.log.say("warning", f"{question}: `robotree decide {self.name} done|again|abort`")
        self.post(on.DoubtRaised(key=key, question=question))
        self.note(key, math.nan, f"asks (robotree decide {self.name} done|again|abort): {question}")

    def stop_asking(self, key: str) -> None:
        """Take the question of a running command back, if nobody has answered it."""
        if self.look(lambda state: key in state.calls.live and bool(state.calls.live[key].doubt)):
            self.post(on.DoubtRaised(key=key, question=""))
        self.note(key, math.nan, "")

    def _interrupted_calls(self) -> tuple[str, ...]:
        """Return the keys of the calls that ran when the process ended, and prepare what is known of them."""
        running = [call for call in self.core.state.calls.live.values() if call.running]
        for call in running:
            run = self._run_of(call.key)
            run.recall = dict(call.steps)
            first, *ahead = [*call.laps, Lap(call.lap, call.place, call.fields)]
            run.begin_lap(first)
            run.ahead = tuple(ahead)
            if call.cause is not None:
                run.cause, run.final = call.cause.revive(), call.final
        return tuple(call.key for call in running)

    def begin_again(self) -> None:
        """Have the commands that ran when the process ended go on, from a state that was kept.

        Commands that have begun since the robot is open are no part of them: they run already.
        """
        gap = 0.0 if self.came else self.process.gap
        self.post(on.Restored(calls=self._interrupted, gap=gap, came=self.came))

    def _remind_at(self, due: float) -> None:
        """Have the watchdog look when something is due, if that is earlier than it will look.

        So calls that end before their deadlines, one after the other, share one timer.
        """
        if due < self._reminder - LATE:
            self._unremind()
            self._reminder = due
            self._unremind = self.process.at(due, self._remind)

    def _remind(self) -> None:
        self._reminder = math.inf
        if self.ice is not None and self.ice.closed:
            return
        if self.core.due <= self._runner.now():
            self.pass_time()
        self._remind_at(self.core.due)

    def _carry_out(self, effects: list[CoreEffect]) -> None:
        for effect in effects:
            if isinstance(effect, Begin):
                run = self.runs.get(effect.key) or self._run_of(effect.key)
                if run.waited:
                    self._tell_turn(effect.key, run)
                job = partial(self._execute, self, effect.key, run)
                if run.turn is not None and run.turn(job):
                    continue
                if not self._transport.after_reading(partial(self.process.carry_out, job)):
                    self.process.work(job)
            elif isinstance(effect, Settled):
                if effect.call is not None:
                    self.log.settle(effect.call)
                ended = self.runs.pop(effect.key, None)
                for listener in () if ended is None else ended.listeners:
                    try:
                        listener.settle(effect.reply)
                    except Exception:  # noqa: BLE001 # of the others, and of the robot, it is not the fault
                        _log.exception("%s: the end of a call could not be told", self.robot.name)
            else:
                self._carry_out_other(effect)

    def _shows(self, effects: list[CoreEffect]) -> bool:
        """Whether others can see it: a call that only reads, and a renewal, show nowhere. Under the lock."""
        calls = self.core.state.calls
        before, self._at_work = self._at_work, (calls.running, len(calls.waiting))
        return before != self._at_work or not INVISIBLE.issuperset(map(type, effects))

    def _tell_waiting(self) -> None:
        """Tell people whose commands wait which one is first and how long they wait; again each second."""
        now = self._runner.now()
        with self._lock:
            calls = self.core.state.calls
            if (first := calls.live.get(calls.running)) is None:
                return
            waiting = [calls.live[key] for key in calls.waiting if is_person(calls.live[key].caller)]
            asks = f"; it asks: `robotree decide {self.name} done|again|abort`" if first.doubt else ""
            notes = [(self._run_of(call.key), waits(first, now - call.came) + asks) for call in waiting]
            for run, _ in notes:
                run.waited = True
            looks = bool(notes) and not self._looks
            self._looks = self._looks or looks
        for run, text in notes:
            run.tell(math.nan, text)
        if looks:
            self.process.at(now + 1.0, self._look_at_waiting)

    def _look_at_waiting(self) -> None:
        with self._lock:
            self._looks = False
        self._tell_waiting()

    def _tell_turn(self, key: str, run: Run) -> None:
        """Tell a person whose command has waited that its turn has come."""
        with self._lock:
            run.waited, call = False, self.core.state.calls.live[key]
            text = f"has waited {call.began - call.came:.0f} s"
        run.tell(math.nan, text)

    def _carry_out_other(self, effect: CoreEffect) -> None:
        if isinstance(effect, on.Decided):
            asking = self._run_of(effect.key)
            asking.answer = effect.answer
            asking.wake()
        elif isinstance(effect, Interrupt):
            with self._lock:  # it may have ended since the effect was decided
                live = effect.key in self.core.state.calls.live
                run = self._run_of(effect.key) if live else None
            if run is not None:
                run.end(effect.cause.revive(), final=effect.final)
        elif isinstance(effect, on.PauseChanged):
            self._look_at_pause()
        elif isinstance(effect, on.AttentionPassed):
            run = self.runs.get(effect.key)
            for pass_on in () if run is None else run.passes_on:
                pass_on(effect.at)
        else:
            if isinstance(effect, on.ChildGone):  # calls and readings end with the child that was in a slot
                for tell in tuple(self._bereft.get(effect.slot, ())):
                    tell(self.look(lambda state: state.slots.emptiness(effect.slot)))
            self._on_effect(effect)

    # -- calls that come in -----------------------------------------------------------------------

    def changed(self) -> None:
        """Take note that others may see the robot differently. From any thread."""
        if not self.has_news:
            self.has_news = True
            self.on_news()

    @property
    def stops(self) -> int:
        """How many stops have begun, with the one that the robot itself has and has not reported yet."""
        return self.look_at_robot()

    def look_at_robot(self) -> int:
        """Take the report of the robot and of the controller behind it; return how many stops have begun."""
        halted, obeyed = self.robot.halted, None if self._obeyed is None else self._obeyed()
        with self._lock:
            known, stops = self.core.state.stop.halted, self.core.state.stop.generation
        if obeyed is not None and obeyed != self._last_obeyed:
            self._last_obeyed = obeyed
            self.post(on.Obeyed(epoch=obeyed))
        if halted != known:
            self.post(on.Halted(reason=halted))
            stops = self.look(lambda state: state.stop.generation)
        return stops

    def admit(
        self,
        call: Call,
        deadline_at: float,
        principal: Principal,
        *,
        listener: Listener | None = None,
        turn: OfferedTurn | None = None,
        accepted: Callable[[], None] | None = None,
        stops: int = -1,
        attended_until: float = 0.0,
    ) -> None:
        """Accept a call, or refuse it; it begins at its turn.

        Args:
            call: as it came.
            deadline_at: [s] on the runner's clock.
            principal: who calls.
            listener: told how it fares.
            turn: see `post`.
            accepted: see `post`.
            stops: how many stops there were when the call came; -1: it comes now.
            attended_until: [s] on the runner's clock, until when somebody at a key attends it.

        Raises:
            VrError: it is refused.
            NotDescribed: the child must be asked for the command first.
        """
        begun = self.look_at_robot()
        try:
            spec = self.spec(call.command)
            arguments = check_arguments(spec, call.arguments, robot=self.robot.name)
        except (VrError, NotDescribed):
            self.expect_to_command(call.epoch, principal)  # a stranger is told that first
            raise
        reads = spec.effect == "read" or spec.beside
        self.post(
            on.Invoke(
                call=call,
                arguments=arguments,
                deadline_at=deadline_at,
                reads=reads,
                stops_seen=begun if stops < 0 else stops,
                alone=call.command in self.robot.one_at_a_time,
                principal=principal,
                attended=spec.attended,
                attended_until=attended_until if call.attended > 0 else 0.0,
            ),
            listener=listener,
            turn=turn,
            accepted=accepted,
        )
        self.traffic.note(principal.agent, self._runner.now(), calls=1)
        if self.on_call is not None:
            self.on_call(call, reads)

    def cancel(self, key: str, reason: str, *, final: bool = False, principal: Principal = ITSELF) -> None:
        """End a call; the principal is its caller, or the robot itself."""
        self.post(on.CancelAsked(key=key, reason=reason, final=final, principal=principal))

    # -- somebody at a key ------------------------------------------------------------------------

    def attended_until(self, key: str) -> float:
        """[s] until when a live call is attended; 0: nobody attends it."""
        call = self.look(lambda state: state.calls.live.get(key))
        return 0.0 if call is None or call.attended_until == math.inf else call.attended_until

    # -- callers with whom calls end --------------------------------------------------------------

    def attend(self, key: str, caller: str) -> None:
        """End a call, if it is live, when the last of those who attend it is lost; see `lose`."""
        with self._lock:
            if key in self.core.state.calls.live:
                run = self._run_of(key)
                run.callers |= {caller}

    def is_attended_by(self, caller: str) -> bool:
        """Whether a live call is attended by a caller."""
        with self._lock:
            return any(caller in run.callers for run in self.runs.values())

    def lose(self, caller: str) -> list[str]:
        """Take note that a caller is lost; return the keys of the calls that nobody attends any more."""
        with self._lock:
            lost = {key: run for key, run in self.runs.items() if caller in run.callers}
            for run in lost.values():
                run.callers -= {caller}
        return [key for key, run in lost.items() if not run.callers]

    def abandon(self, key: str, at: FrameType | None) -> None:
        """Give up code that ignores every interruption; `at` is what its thread carries out."""
        self.isolated = True  # what happened once may happen again, and must not take its caller with it
        command, home = self.look(lambda state: (state.calls.command_of(key), state.home))
        where = ""
        if command:
            line = line_at_work(at, self.source_of(command))
            where = "" if line is None else f"{line.place}: {line.text}"
            _log.error(
                "%s.%s is abandoned: it ignores every cancel and still runs%s, though it can reach no child "
                "any more; the robot is free again when it has ended, or after a restart of %s",
                *(self.name, command, where and f" ({where})", home),
            )
        self.post(on.Abandon(key=key, where=where))
        if command:
            self.log.say("warning", f"{command} has ended and its code still runs: {where or '?'}")

    def gone(self, key: str) -> None:
        """Abandoned code has ended after all."""
        command = self.look(lambda state: state.calls.abandoned.get(key, "a command"))
        _log.warning("%s.%s has ended after all; the robot can be used again", self.name, command)
        self.log.say("info", f"{command} has ended after all; the robot can be used again")
        self.post(on.Gone(key=key))
        self.changed()

    def note(self, key: str, fraction: float, text: str) -> None:
        """Take how far a running command is."""
        if run := self.runs.get(key):
            run.own = (fraction, text)
            self._show(run, fraction, text)

    def note_child(self, key: str, child: str, text: str) -> None:
        """Take the progress that a child of a running command reports: shown beside the command's own."""
        if run := self.runs.get(key):
            fraction, own = run.own
            self._show(run, fraction, f"{own}; {child}: {text}" if own else f"{child}: {text}")

    def _show(self, run: Run, fraction: float, text: str) -> None:
        run.shown = (fraction, text[:LONGEST_NOTE])
        run.tell(fraction, text)
        self.changed()

    def progress_of(self, key: str) -> tuple[float, str]:
        """Return how far a call is, as others see it."""
        run = self.runs.get(key)
        return NO_PROGRESS if run is None else run.shown

    def say(self, key: str, level: Level, text: str, *, piece: bool = False) -> None:
        """Take output of a running command; empty key: of other code of the robot."""
        if piece:
            self.log.write(key, level, text)
        else:
            self.log.say(level, text)

    def enter_asked(self) -> None:
        """Enter in the log which commands of people go on or wait, each once. Not under the lock."""
        for call, ahead in self.look(_asked_by_people):
            if call.key in self.core.state.calls.live:  # it has not ended meanwhile
                self.log.ask(call, ahead)

    # -- what it can do ---------------------------------------------------------------------------

    def spec(self, name: str) -> CommandSpec:
        """Return the spec of a command, its own or one that it lets through.

        Raises:
            NoSuchCommand: it has none of this name.
            SlotEmpty: the child is missing through which it goes.
            NotDescribed: the child must be asked for it first.
        """
        if command := self._commands.get(name):
            return self.look(partial(_present, command.spec)) if command.spec.beside else command.spec
        exposed = self._exposures.get(name)
        if exposed is None:
            known = offered((*self._commands, *self._exposures), name)
            raise NoSuchCommand(robot=self.robot.name, command=name, known=known)
        spec = self.child_spec(exposed.child.name, exposed.command)
        if spec is None or not spec.available:
            raise NotDescribed(exposed.child.name, exposed.command)
        try:
            return msgspec.structs.replace(exposed.seen(spec), name=name)
        except ValueError as error:
            raise BadArgument(command=f"{self.name}.{name}", parameter="units", reason=str(error)) from None

    def only_reads(self, command: str) -> bool:
        """Whether a command changes nothing, so that it may be asked for again."""
        found = self._commands.get(command)
        return found is not None and found.spec.effect == "read"

    def result_of(self, command: str) -> tuple[FieldSpec, ...]:
        """Return what the result of a command is: its parts; empty: it has none, or is not known."""
        spec = self._known_spec(command)
        return spec.result if spec else ()

    def _parameters_of(self, command: str) -> tuple[FieldSpec, ...]:
        spec = self._known_spec(command)
        return spec.parameters if spec else ()

    def _known_spec(self, command: str) -> CommandSpec | None:
        try:
            return self.spec(command)
        except (VrError, NotDescribed):
            return None

    def takes_long(self, call: Call) -> bool:
        """Whether an argument is a text with another unit than the declared, and units are not loaded yet."""
        if NUMBERS.issuperset(map(type, call.arguments.values())):
            return False
        command = self._commands.get(call.command)
        known: Mapping[str, FieldSpec] = {} if command is None else command.spec.by_name
        return any(
            takes_long(text, known[name].unit if name in known else "")
            for name, value in call.arguments.items()
            if name not in known or known[name].type != "str"
            for text in _texts_in(value)
        )

    def specs(self, state: RobotState) -> tuple[CommandSpec, ...]:
        """Describe all commands in a state of the robot; for `look`."""
        own = tuple(_present(command.spec, state) for command in self._commands.values())
        return own + tuple(_exposed_spec(name, each, state) for name, each in self._exposures.items())

    def _keep(self, values: dict[str, Any]) -> None:
        """Keep what the robot's own code, or one who may, has set."""
        self.post(on.Set(values=values))

    # -- for the code of a call -------------------------------------------------------------------

    def turn_of(
        self, key: str, run: Run
    ) -> tuple[CommandContext, Robot, Command | None, Arguments, Exposed | None]:
        """Return what the code of a call needs whose turn it is.

        Returns:
            The call; the robot, made of the page in force; its command of this name, if there is one; the
            arguments, as checked, or as they came if that may have been for another page (`turned`); the
            command of a child, if that is what the robot has under this name.
        """
        with self._lock:  # the page may be another one in a moment, for a command that only reads
            call = self.core.state.calls.live[key]
            name = call.command
            if run.recall is None:
                run.fields = call.fields
            context = CommandContext(
                key=key,
                command=name,
                caller=call.caller,
                epoch=call.epoch,
                deadline_at=call.deadline_at,
                witness=call.witness,
            )
            arguments = call.sent if self.turned else call.arguments
            return context, self.robot, self._commands.get(name), arguments, self._exposures.get(name)

    def source_of(self, command: str) -> str:
        """Return the file of a command's page, as tracebacks call it; empty: it has none."""
        found = self._commands.get(command)
        return "" if found is None else inspect.unwrap(found.function).__code__.co_filename

    # -- its children -----------------------------------------------------------------------------

    def child_in(self, slot: str) -> tuple[Address, int]:
        """Return the child in a slot, and the epoch of the lease on it; 0: it is only watched.

        Raises:
            SlotEmpty: there is none.
        """
        with self._lock:
            found = self.core.state.slots.by_name.get(slot)
            if found is not None and found.watched is not None:
                return found.watched, 0
            bond = self.core.state.slots.require(slot)
            return bond.child, bond.lease.epoch

    def bond_in(self, slot: str) -> Bond:
        """Return a copy of the bond with the child in a slot.

        Raises:
            SlotEmpty: there is none.
        """
        return self.look(lambda state: state.slots.require(slot).copied())

    def child_spec(self, slot: str, command: str) -> CommandSpec | None:
        """Return a command as the child in a slot describes it; None: it has none of this name.

        Raises:
            SlotEmpty: there is no child.
        """
        with self._lock:
            return self.core.state.slots.require(slot).description.command(command)

    def known_child_spec(self, slot: str, command: str) -> CommandSpec | None:
        """Return the same; None also where there is no child."""
        try:
            return self.child_spec(slot, command)
        except VrError:  # the slot is empty
            return None

    def child_parameters(self, slot: str, command: str) -> tuple[FieldSpec, ...]:
        """Return the parameters of a child's command; empty: there are none, or it is not known."""
        spec = self.known_child_spec(slot, command)
        return spec.parameters if spec else ()

    def expect_permitted(self, slot: str, command: str) -> None:
        """Refuse a call that the manifest of the page does not permit.

        Raises:
            NotPermitted: it does not.
            SlotEmpty: there is no child.
        """
        if (may := self.permissions) is not None:
            kinds = self.kinds_in(slot)
            if not may.may_call(kinds, command):
                raise NotPermitted(robot=self.name, what=f"call {next(iter(kinds), slot)}.{command}")

    def kinds_in(self, slot: str) -> tuple[str, ...]:
        """Return the kinds of the child in a slot.

        Raises:
            SlotEmpty: there is none.
        """
        with self._lock:
            slots = self.core.state.slots
            watched = slots.by_name.get(slot)
            if watched is not None and watched.watched is not None:
                return (watched.spec.kind,)  # it is of this kind at least, and no more is known
            return slots.require(slot).description.kinds

    def find_bond(self, slot: str) -> Bond | None:
        """Return a copy of the bond with the child in a slot; None: it is empty."""
        return self.look(lambda state: None if (bond := state.slots[slot].bond) is None else bond.copied())

    def witness_of(self, slot: str, command: str) -> str | None:
        """Return who remembers a command of the child in a slot that must not be repeated.

        Returns:
            See `RobotDescription.witness`. None: it may be repeated; whether is not known of all.
        """

        def look(state: RobotState) -> str | None:
            bond = state.slots[slot].bond
            spec = None if bond is None else bond.description.command(command)
            if spec is not None and spec.effect != "once":
                return None
            return "" if bond is None else bond.description.witness

        return self.look(look)

    def translate_child_error(self, slot: str, error: VrError) -> Exception:
        """Return the error of a call as its caller sees it: the child is gone, or a class of the page."""
        with self._lock:
            slots = self.core.state.slots
            if slots[slot].bond is None and not isinstance(error, CommandInDoubt):
                return slots.emptiness(slot)
        return as_itself(type(self.robot), error)

    def when_gone(self, slot: str, tell: Callable[[VrError], None]) -> Callable[[], None]:
        """Call back, with the error for an empty slot, when the child in a slot is gone.

        Returns:
            How to end that.
        """
        waiting = self._bereft.setdefault(slot, {})
        waiting[tell] = None
        return lambda: waiting.pop(tell, None)

    def number(self, slot: str, epoch: int) -> tuple[str, int, int, Callable[[], None]]:
        """Number a call of a child in another process.

        Returns:
            `Call.source`, `Call.number`, `Call.lowest`, and how to say that the call has ended.
        """
        source = f"{self.key}/{slot}/{epoch}{self._life}"
        with self._lock:
            ledger = self._ledgers.get(source)
            if ledger is None:
                ledger = self._ledgers[source] = _Ledger()
            number, lowest = ledger.open()
        return source, number, lowest, partial(ledger.numbers.discard, number)

    def present(self, role: Role, name: str = "") -> list[str]:
        """Return the keys of the agents of a role and name that run; empty: of any name."""
        return self._transport.presence.keys(everyone(role, name or "*"))

    def is_there(self, key: str) -> bool:
        """Whether an agent is present under a key."""
        return self._transport.presence.there(key)

    def comes_back(self, slot: str, child: Address, epoch: int) -> bool:
        """Whether a child whose process has ended is still bound and comes back."""
        return self.look(
            lambda state: (bond := state.slots.held(slot, child, epoch)) is not None and bond.returns > 0.0
        )

    def ask(
        self,
        key: str,
        request: AnyRequest,
        on_reply: TakeReply,
        *,
        now: float | None = None,
        within: float = ANSWER_WITHIN,
        urgent: bool = False,
    ) -> None:
        """Ask another agent in the name of this robot, without waiting; see `send_request`."""
        now = self._runner.now() if now is None else now
        if isinstance(request, Call):
            self.traffic.note(key, now, calls=1)
        send_request(
            self._transport,
            key,
            request,
            on_reply,
            now=now,
            within=within,
            sender=self.key,
            urgent=urgent,
            may=self.permissions,
            count=partial(self.traffic.carried, key),
        )


class _Ledger:
    """The calls of one child that still matter to their caller, by number."""

    def __init__(self) -> None:
        self.numbers: set[int] = set()
        self._last = 0

    def open(self) -> tuple[int, int]:
        """Return the number of a new call, and the lowest one that matters."""
        self._last += 1
        self.numbers.add(self._last)
        return self._last, min(self.numbers)


def _present(spec: CommandSpec, state: RobotState) -> CommandSpec:
    """Return a spec whose defaults are the present values, if it is that of the settings."""
    if spec.name != SET or not spec.beside:
        return spec
    parameters = (
        msgspec.structs.replace(field, default=state.fields.get(field.name)) for field in spec.parameters
    )
    return msgspec.structs.replace(spec, parameters=tuple(parameters))


def _exposed_spec(name: str, exposed: Exposed, state: RobotState) -> CommandSpec:
    """Describe a command of a child under the name that it has here."""
    through = f"{exposed.child.name}.{exposed.command}"
    bond = state.slots[exposed.child.name].bond
    spec = None if bond is None else bond.description.command(exposed.command)
    if spec is None:
        return CommandSpec(name=name, through=through, available=False)
    try:
        return msgspec.structs.replace(exposed.seen(spec), name=name, through=through)
    except ValueError as error:
        return CommandSpec(name=name, through=through, available=False, doc=f"Cannot be used: {error}.")


def _texts_in(value: object) -> Iterator[str]:
    """Iterate over the texts in an argument, however deep."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping):
        yield from _texts_in(list(cast("Mapping[str, object]", value).values()))
    elif isinstance(value, Sequence):
        for part in cast("Sequence[object]", value):
            yield from _texts_in(part)


def _life_of(process: Process[RobotRuntime], moves: int) -> str:
    """Return a part of the name by which calls are numbered: each process, and each stay, counts from 1."""
    return "" if process.life == 1 and not moves else f"/{process.life}.{moves}"


def _copied(value: object) -> object:
    """Return a copy of what a page can change in place; None of everything else."""
    plain = (list, dict, set, bytearray)
    return copy(cast("object", value)) if isinstance(value, plain) else None


def _ignore(_: Reply | None) -> None:
    """Take a reply that does not matter."""


def _nothing() -> None:
    """Nothing is planned."""


def _asked_by_people(state: RobotState) -> list[tuple[AcceptedCall, AcceptedCall | None]]:
    """Return the calls of people that change something, as they are now, and the one that each waits for."""
    calls = state.calls
    ahead = calls.live.get(calls.running)
    first = None if ahead is None else msgspec.structs.replace(ahead)
    return [
        (msgspec.structs.replace(call), None if call.running else first)
        for call in calls.live.values()
        if not call.reads and is_person(call.caller)
    ]
