"""All that a robot is, as one value, and the pure machine that changes it: `handle(event, now) -> effects`.

It refuses by raising a `VrError`, and a refusal changes nothing. Effects name calls and slots, never parts of
the state; who carries them out does so after the state has changed (and, with a journal, after it has been
written).

The order in which a call is examined: the caller's right (epoch), whether the call is known (the same key is
carried out once), stops, a rival controller, another call of a command that runs once at a time, abandoned
code, its deadline, room in the queue.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.errors import (
    Busy,
    CommandCancelled,
    CommandFailed,
    CycleOfBonds,
    DeadlineExceeded,
    KeyReused,
    NobodyAttends,
    NotBegun,
    NotConfirmed,
    NotFree,
    NothingAsked,
    NotItsChild,
    NotPaused,
    StillRunning,
    Stopped,
    UnderWay,
    VrError,
)
from robotree.vr.base.newest import keep_newest
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import Raised, Returned
from robotree.vr.core import events as on
from robotree.vr.core.bonds import Bond, GrantedLease, Lease, Slots
from robotree.vr.core.control import RobotControl, operator_of
from robotree.vr.core.placement import Placing
from robotree.vr.core.stop import HARDWARE, PauseState, Stop

LONGEST_DEADLINE = 7 * 24 * 3600.0
"""[s]"""
LONGEST_QUEUE = 16
MOST_READERS = 32
MOST_KEPT = 256
"""Ended calls that are remembered, and cancels that came first."""
MOST_STEPS = 100_000
"""Steps of one call that are kept; a call that takes more without a checkpoint cannot go on after a crash."""
ATTENTION = 2.0
"""[s] after the last key for which an attended command goes on."""
UNATTENDED = "nobody has held a key for 2 s"
"""Why an attended command ends."""
MOST_CALLERS = 256
"""Callers that number their calls and are remembered."""

Effects = list[on.CoreEffect]


class Lap(msgspec.Struct, frozen=True):
    """The part of a running command from one checkpoint to another: its steps are kept beside it."""

    number: int
    """The number with which the paths of its steps begin."""
    place: str
    """Of the checkpoint with which it began: see `Checkpoint.place`."""
    fields: dict[str, Any]
    """The robot's fields then."""


def lap_of(path: str) -> int:
    """Return the number of the lap to which a step belongs, by its path; -1: to none."""
    head = path.partition("/")[0]
    number, dot, _ = head.partition(".")
    if dot:
        return int(number) if number.isdigit() else -1
    return 0 if head[:1].isdigit() or head in {on.END, on.THREAD} else -1


class AcceptedCall(msgspec.Struct, kw_only=True):
    """One accepted call, until it has ended."""

    key: str
    command: str
    sent: dict[str, Any]
    """Arguments as they came: with the command, the content of the call."""
    arguments: dict[str, Any]
    """Arguments as checked."""
    caller: str = ""
    principal: Principal = ITSELF
    """Its caller, who may end it."""
    epoch: int = 0
    deadline_at: float = math.inf
    """[s] on the robot's clock."""
    reads: bool = False
    running: bool = False
    cause: Raised | None = None
    """Why it was asked to end while it ran."""
    final: bool = False
    """Whether not even its clean-up may command children any more: a stop, a lost lease, a second cancel."""
    detached: bool = False
    """Whether it goes on after the command that has made it: then operators may end it."""
    source: str = ""
    """The caller that numbers its calls; empty: none."""
    number: int = 0
    came: float = 0.0
    """[s] when it was accepted, on the robot's clock; so is the next."""
    began: float = -1.0
    """[s] when its turn came; below 0: not yet."""
    steps: dict[str, on.StepResult] = {}
    """The results of its steps since it began, or since its last checkpoint, by path; see `StepTaken`."""
    fields: dict[str, Any] = {}
    """The robot's fields when it began, or at its last checkpoint."""
    lap: int = 0
    """How many checkpoints it has made: a part of the keys of its steps."""
    place: str = ""
    """Of the latest: see `Checkpoint.place`."""
    laps: list[Lap] = []
    """Those that lead from the beginning of its page to the present one."""
    witness: str = ""
    """See `Call.witness`."""
    doubt: str = ""
    """Its question to a person before it goes on; empty: none."""
    forgotten: bool = False
    """Whether it has taken more steps than are kept: it cannot go on after an interruption."""
    attended_until: float = math.inf
    """[s] on the robot's clock, when it ends unless somebody attends it; infinite: nobody needs to."""


class Calls(msgspec.Struct, kw_only=True):
    """The calls of one robot: what runs, what waits, how each ended, and which must never begin.

    One command runs at a time and the others wait in a bounded queue; those that only read run beside it. A
    call's key is `command id / path`: the same key with the same content is carried out once and answered
    twice. Ended calls are remembered, the oldest forgotten first, and so are cancels that came before their
    call. A caller that numbers its calls also says below which number none of them matters to it any more:
    such a call is forgotten at once, and a late copy of it is refused for ever.

        Invoke ──► queued ──► running ──► ended          abandoned: ended, while its code still runs
                      └─ cancel ────────────┘

    What ends a call is an error's name and data, as it travels.
    """

    live: dict[str, AcceptedCall] = {}
    """Those that run or wait, by key, the oldest first."""
    running: str = ""
    """Key of the command whose turn it is; empty: none."""
    waiting: list[str] = []
    """Keys of those that wait, the next one first."""
    readers: int = 0
    """How many run that only read."""
    ended: dict[str, on.Ended] = {}
    cancelled: dict[str, str] = {}
    """Keys of calls that have not come and must not begin, with the reason."""
    lowest: dict[str, int] = {}
    """Below which number a caller's calls are over, by caller."""
    abandoned: dict[str, str] = {}
    """Commands that have ended and whose code runs on, by key."""
    places: dict[str, str] = {}
    """The lines of their pages at which they were abandoned, in words, by key."""
    counts: dict[str, int] = {}
    """How often each command was accepted."""

    # -- coming -----------------------------------------------------------------------------------

    def known(
        self, robot: str, key: str, command: str, sent: dict[str, Any], by: str = ""
    ) -> AcceptedCall | on.Ended | None:
        """Return the call of a key that came before, live or ended; None when the key is new.

        Raises:
            KeyReused: the key came with other content.
            CommandCancelled: its cancel came before the call.
        """
        call = self.live.get(key) or self.ended.get(key)
        if call is None:
            reason = self.cancelled.get(key) or self.cancelled.get(f"{by} {key}")
            if reason is not None:
                raise CommandCancelled(robot=robot, command=command, reason=reason)
            return None
        if (call.command, call.sent) != (command, sent):
            raise KeyReused(robot=robot, key=key, command=call.command)
        return call

    def late(self, source: str, number: int) -> bool:
        """Whether a numbered call arrives after its caller has marked it as ended."""
        return number < self.lowest.get(source, 0)

    def enter(self, call: AcceptedCall, robot: str) -> bool:
        """Take a new call of a robot in; returns whether it begins at once.

        Raises:
            Busy: too many wait, or read; nothing has changed.
        """
        if call.reads:
            if self.readers >= MOST_READERS:
                raise Busy(robot=robot, waiting=self.readers, how="that only read run")
            self.readers += 1
            call.running, call.began = True, call.came
        elif not self.running:
            self.running = call.key
            call.running, call.began = True, call.came
        elif len(self.waiting) >= LONGEST_QUEUE:
            raise Busy(robot=robot, waiting=len(self.waiting), how="wait")
        else:
            self.waiting.append(call.key)
        self.live[call.key] = call
        self.counts[call.command] = self.counts.get(call.command, 0) + 1
        return call.running

    def settle_below(self, source: str, lowest: int) -> None:
        """Forget the ended calls of a caller below a number: copies of them are refused from now on."""
        if lowest <= self.lowest.get(source, 0):
            return
        self.lowest.pop(source, None)
        keep_newest(self.lowest, source, lowest, MOST_CALLERS)
        over = [key for key, call in self.ended.items() if call.source == source and call.number < lowest]
        for key in over:
            del self.ended[key]

    # -- going ------------------------------------------------------------------------------------

    def leave(self, ended: on.Ended) -> str:
        """Note how a live call ended.

        Returns:
            The key of the call whose turn it is now because of that; empty: of none.
        """
        key = ended.key
        del self.live[key]
        if not (ended.source and self.late(ended.source, ended.number)):
            keep_newest(self.ended, key, ended, MOST_KEPT)
        if ended.reads:
            self.readers -= 1
        elif self.running != key:
            self.waiting.remove(key)
        elif self.waiting:
            self.running = self.waiting.pop(0)
            following = self.live[self.running]
            following.running, following.began = True, ended.ended
            return self.running
        else:
            self.running = ""
        return ""

    def refuse(self, key: str, reason: str, by: str = "") -> None:
        """Note that a call which has not come must not begin; `by`: if it comes from this agent."""
        if key not in self.ended:
            keep_newest(self.cancelled, f"{by} {key}" if by else key, reason, MOST_KEPT)

    # -- queries ----------------------------------------------------------------------------------

    def command_of(self, key: str) -> str:
        """Return the command of a live call; empty: there is none of this key."""
        call = self.live.get(key)
        return "" if call is None else call.command

    def of(self, command: str) -> AcceptedCall | None:
        """Return the oldest live call of a command that nobody has asked to end; None: there is none."""
        return next(
            (call for call in self.live.values() if (call.command, call.cause) == (command, None)), None
        )

    def beside_abandoned(self, robot: str, home: str) -> VrError | None:
        """Return why nothing that moves may begin while abandoned code runs; None: there is none."""
        for key, command in self.abandoned.items():
            where = self.places.get(key, "")
            return StillRunning(robot=robot, command=command, home=home, where=where and f" ({where})")
        return None


class RobotState(msgspec.Struct, kw_only=True):
    """All that a robot is, as one value: encoded and decoded again, the robot goes on as if nothing was."""

    address: Address
    """Its name for life, and its incarnation: another one for each start."""
    home: str
    """The process that a person restarts to end its code, in words: `host host-1`."""
    lease: GrantedLease
    """The lease under which it is commanded."""
    slots: Slots
    """Which robots it commands."""
    calls: Calls
    stop: Stop
    pause: PauseState = msgspec.field(default_factory=PauseState)
    fields: dict[str, Any] = {}
    """Its settings and what its page has declared as state: plain values by name."""
    moves: int = 0
    """How often it has moved to another host: the host where it is has the highest number."""
    secret: str = ""
    """Of its last move: by this its children know that it is the same robot; see `heirs`."""
    placing: Placing = Placing()
    """What it takes along about its place."""
    control: RobotControl = msgspec.field(default_factory=RobotControl)
    """Which operator has it for themselves."""

    @property
    def lineage(self) -> tuple[str, ...]:
        """Names from the topmost ancestor down to the robot."""
        lease = self.lease.current
        return (*(() if lease is None else lease.lineage), self.address.name)


_encoder = msgspec.msgpack.Encoder()
_decoder: msgspec.msgpack.Decoder[RobotState] = msgspec.msgpack.Decoder(RobotState)


def encode_state(state: RobotState) -> bytes:
    """Return a state as MessagePack."""
    return _encoder.encode(state)


def decode_state(body: bytes) -> RobotState:
    """Read what `encode_state` wrote.

    Raises:
        msgspec.DecodeError: it is something else.
    """
    return _decoder.decode(body)


def shift(state: RobotState, by: float) -> None:
    """Move all moments [s] of a state to another monotonic clock, on which they are later by so much."""
    lease, stop = state.lease, state.stop
    for name in ("current", "silent"):
        held: Lease | None = getattr(lease, name)
        if held is not None:
            setattr(lease, name, msgspec.structs.replace(held, expires=held.expires + by))
    for bond in state.slots.bonds().values():
        bond.lease.confirmed += by
        bond.lease.last_asked += by
    for call in state.calls.live.values():
        call.deadline_at += by
        call.attended_until += by
        call.came += by
        call.began += by if call.running else 0.0
        for path, step in call.steps.items():
            if step.kind in on.MOMENTS:
                call.steps[path] = msgspec.structs.replace(step, value=step.value + by)
            elif step.kind == on.RECEIVED and hasattr(step.value, "keys"):
                received: dict[str, Any] = {**step.value}
                if on.AT in received:
                    received[on.AT] += by
                call.steps[path] = msgspec.structs.replace(step, value=received)
    stop.moment += by
    control = state.control
    control.until, control.asks_until = control.until + by, control.asks_until + by
    control.offered_until += by


class RobotCore:
    """One robot: its state, and what each event does to it."""

    __slots__ = ("due", "state")

    def __init__(self, state: RobotState) -> None:
        """Take a state, new or decoded."""
        self.state = state
        self.due = self._due()
        """[s] when `Tick` will change something if nothing else does before."""

    def handle(self, event: on.CoreEvent, now: float) -> Effects:
        """Change the state; return what is to be done, in this order.

        Args:
            event: what happened.
            now: [s] on the robot's monotonic clock.

        Raises:
            VrError: it is refused; nothing has changed.
        """
        effects = self._handlers[type(event)](self, event, now)
        if type(event) is not on.StepTaken:  # the most frequent one, and nothing is due because of it
            self.due = self._due()
        return effects

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.state.address.name

    def _due(self) -> float:
        slots, lease = self.state.slots, self.state.lease.current
        due = slots.due if slots.by_name else math.inf
        if lease is not None and lease.expires < due:
            due = lease.expires
        for call in self.state.calls.live.values():
            if call.deadline_at < due and call.cause is None:
                due = call.deadline_at
            if call.attended_until < due and not call.final:
                due = call.attended_until
        control = self.state.control
        return min(due, control.due) if control.holder.person else due

    # -- calls ------------------------------------------------------------------------------------

    def _invoke(self, event: on.Invoke, now: float) -> Effects:
        calls, name, asked = self.state.calls, self.state.address.name, event.call
        self.state.lease.check(asked.epoch, now, event.principal)
        if asked.source and calls.late(asked.source, asked.number):
            raise CommandCancelled(robot=name, command=asked.command, reason="its caller has given it up")
        known = calls.known(name, asked.key, asked.command, asked.arguments, event.principal.agent)
        if isinstance(known, on.Ended):
            return [on.Settled(key=asked.key, reply=known.reply)]
        if known is not None:
            return []
        if not event.reads:
            self.state.control.expect(name, event.principal)
            self._expect_free_to_move(event)
        if event.attended and not event.attended_until > now:
            who = event.principal.person or asked.caller or "its caller"
            raise NobodyAttends(robot=name, command=asked.command, who=who)
        if not now < event.deadline_at < math.inf:
            raise DeadlineExceeded(robot=name, command=asked.command)
        lease = self.state.lease.current
        call = AcceptedCall(
            key=asked.key,
            command=asked.command,
            sent=asked.arguments,
            arguments=event.arguments,
            principal=event.principal,
            caller=asked.caller if lease is None or asked.epoch is None else lease.parent.name,
            epoch=self.state.lease.epoch,
            deadline_at=event.deadline_at,
            reads=event.reads,
            source=asked.source,
            number=asked.number,
            witness=asked.witness,
            detached=asked.oneway,
            came=now,
            attended_until=min(event.attended_until, now + ATTENTION) if event.attended else math.inf,
        )
        begins = calls.enter(call, name)
        if begins and self.state.fields:
            call.fields = dict(self.state.fields)
        if not event.reads:
            self.state.lease.used()
        if asked.source:
            calls.settle_below(asked.source, asked.lowest)
        return [on.Begin(key=asked.key)] if begins else []

    def _expect_free_to_move(self, event: on.Invoke) -> None:
        """Refuse what moves while something forbids it.

        Raises:
            CommandError: which says what.
        """
        name, stop, lease = self.state.address.name, self.state.stop, self.state.lease.current
        if reason := stop.reason or stop.halted:
            commander = name if lease is None else lease.parent.name
            raise Stopped(robot=name, reason=reason, commander=commander)
        if event.stops_seen not in {-1, stop.generation}:  # what came before a stop has ended with it
            raise CommandCancelled(robot=name, command=event.call.command, reason=stop.latest)
        if lease is None and self.state.lease.outranked:
            raise CommandFailed(
                robot=name,
                command=event.call.command,
                detail="another proxy commands its controller, under a later lease; enslave "
                f"{name} to take it over, or end that proxy and start this one again",
            )
        calls = self.state.calls
        if event.alone and (other := calls.of(event.call.command)):
            raise UnderWay(robot=name, command=other.command, caller=other.caller or "somebody")
        if calls.abandoned and (refusal := calls.beside_abandoned(name, self.state.home)):
            raise refusal

    def _finish(self, event: on.Finish, now: float) -> Effects:
        call = self.state.calls.live.get(event.key)
        return [] if call is None else self._settle(call, event.reply, now)

    def _settle(self, call: AcceptedCall, reply: Returned | Raised, now: float) -> Effects:
        if call.cause is not None and isinstance(reply, Raised):
            reply = call.cause
        ended = on.Ended(
            call.key,
            call.command,
            call.sent,
            reply,
            call.source,
            call.number,
            call.caller,
            call.reads,
            call.came,
            call.began,
            now,
        )
        following = self.state.calls.leave(ended)
        effects: Effects = [on.Settled(key=call.key, reply=reply, call=ended)]
        if following:
            self.state.calls.live[following].fields = dict(self.state.fields)
            effects.append(on.Begin(key=following))
        return effects

    def _step_taken(self, event: on.StepTaken, _: float) -> Effects:
        call = self.state.calls.live.get(event.key)
        if call is not None and not call.forgotten:
            call.steps[event.path] = event.step
            call.steps.pop(f"{event.path}{on.BEGUN}", None)
            if len(call.steps) > MOST_STEPS:
                call.steps, call.forgotten = _of_laps(call), True
        return []

    def _checkpoint(self, event: on.Checkpoint, _: float) -> Effects:
        call = self.state.calls.live.get(event.key)
        if call is not None:
            chain = [*call.laps, Lap(call.lap, call.place, call.fields)]
            places = [lap.place for lap in chain]
            known = places.index(event.place) if event.place in places else len(chain)
            call.laps = chain[:known]
            call.steps = _of_laps(call)
            call.forgotten = call.forgotten and known == len(chain)
            call.lap, call.place, call.fields = call.lap + 1, event.place, dict(self.state.fields)
        return []

    def _doubt(self, event: on.DoubtRaised, _: float) -> Effects:
        if call := self.state.calls.live.get(event.key):
            call.doubt = event.question
        return [on.FieldsChanged()]

    def _decide(self, event: on.DoubtSettled, now: float) -> Effects:
        self.state.lease.check(event.epoch, now, event.principal)
        self.state.control.expect(self.name, event.principal)
        asking = next((call for call in self.state.calls.live.values() if call.doubt), None)
        if asking is None:
            raise NothingAsked(robot=self.name)
        asking.doubt = ""
        return [on.Decided(key=asking.key, answer=event.answer), on.FieldsChanged()]

    def _cancel(self, event: on.CancelAsked, now: float) -> Effects:
        call = self._call_of(event, now)
        if call is None:
            by = event.principal.agent if self._without_lease(event) else ""
            self.state.calls.refuse(event.key, event.reason, by)
            return []
        cause = CommandCancelled(robot=self.name, command=call.command, reason=event.reason)
        return self._end(call, cause, now, final=event.final)

    def _attended(self, event: on.Attended, now: float) -> Effects:
        call = self.state.calls.live.get(event.key)
        if call is None or call.attended_until == math.inf:
            return []
        if event.principal not in (call.principal, ITSELF):
            raise NobodyAttends(
                robot=self.name, command=call.command, who=event.principal.person or "another"
            )
        until = min(event.at, now) + ATTENTION
        if call.final or until <= call.attended_until or call.attended_until <= now:
            return []  # it is ended already, or a later key has come before
        call.attended_until = until
        return [on.AttentionPassed(key=call.key, at=min(event.at, now))] if call.running else []

    def _detach(self, event: on.DetachAsked, now: float) -> Effects:
        if call := self._call_of(event, now):
            call.detached = True
        return []

    def _call_of(self, event: on.CancelAsked | on.DetachAsked, now: float) -> AcceptedCall | None:
        """Return the live call of a key to its caller, or to who may command the robot.

        Raises:
            LeaseError: it is somebody else who asks.
            NotItsChild: a robot asks that does not command this one, for the call of another one.
        """
        call = self.state.calls.live.get(event.key)
        if event.principal != ITSELF and (call is None or call.principal != event.principal):
            ends = isinstance(event, on.CancelAsked)
            self.state.lease.check(event.epoch, now, event.principal, ends=ends)
            if self._without_lease(event) and call is not None:
                self._expect_caller(call, event)
        return call

    @staticmethod
    def _without_lease(event: on.CancelAsked | on.DetachAsked | on.CancelAll) -> bool:
        """Whether a robot asks that says no lease: an operator needs none where nobody commands the robot."""
        return event.epoch is None and event.principal.is_robot

    def _expect_caller(
        self, call: AcceptedCall | None, event: on.CancelAsked | on.DetachAsked | on.CancelAll
    ) -> None:
        """Refuse a robot that is not the caller of a call; None: of all calls."""
        asker = event.principal
        if call is None or (call.principal.user, call.principal.agent) != (asker.user, asker.agent):
            name = asker.agent.split("/")[1]
            raise NotItsChild(robot=name, child=self.name, what="the end of a call of others")

    def _late(self, call: AcceptedCall) -> DeadlineExceeded:
        """Return why a call ends whose time is over."""
        if call.running:
            return DeadlineExceeded(robot=self.name, command=call.command)
        other = self.state.calls.command_of(self.state.calls.running) or "another command"
        limit = round(call.deadline_at - call.came, 1)
        return NotBegun(robot=self.name, command=call.command, limit=limit, other=other)

    def _end(
        self,
        call: AcceptedCall,
        cause: CommandCancelled | DeadlineExceeded,
        now: float,
        *,
        final: bool = False,
    ) -> Effects:
        if call.cause is not None and (call.final or not final):
            return []
        raised = Raised.of(cause)
        if not call.running:
            return self._settle(call, raised, now)
        call.cause, call.final = call.cause or raised, final
        return [on.Interrupt(key=call.key, cause=raised, final=final)]

    def _cancel_all(self, event: on.CancelAll, now: float) -> Effects:
        detached = any(call.detached for call in self.state.calls.live.values())
        lease = self.state.lease.current
        free = event.epoch is None and lease is not None and not lease.away
        alone = detached and free and event.principal != ITSELF
        if event.principal != ITSELF and not alone:
            self.state.lease.check(event.epoch, now, event.principal, ends=True)
        if self._without_lease(event):
            self._expect_caller(None, event)
        effects: Effects = []
        for call in reversed(list(self.state.calls.live.values())):
            if (alone and not call.detached) or (event.but_readers and call.reads):
                continue
            cause = CommandCancelled(robot=self.name, command=call.command, reason=event.reason)
            effects += self._end(call, cause, now, final=event.final or call.cause is not None)
        return effects

    def _end_all(self, reason: str, now: float, *, but_readers: bool = False) -> Effects:
        """End all calls for good, those that wait before the one that runs."""
        return self._cancel_all(on.CancelAll(reason=reason, but_readers=but_readers, final=True), now)

    def _abandon(self, event: on.Abandon, now: float) -> Effects:
        calls = self.state.calls
        call = calls.live.get(event.key)
        if call is None:
            return []
        calls.abandoned[call.key] = call.command
        calls.places[call.key] = event.where
        refusal = calls.beside_abandoned(self.name, self.state.home)
        assert refusal is not None  # noqa: S101 # just entered
        raised = Raised.of(refusal)
        effects: Effects = []
        for key in reversed(calls.waiting):
            effects += self._settle(calls.live[key], raised, now)
        return effects + self._settle(call, call.cause or raised, now)

    def _gone(self, event: on.Gone, now: float) -> Effects:
        calls = self.state.calls
        calls.abandoned.pop(event.key, None)
        calls.places.pop(event.key, None)
        call = calls.live.get(event.key)
        if call is None:
            return []
        reason = "it was abandoned at the moment when it ended"  # so the order to abandon it comes too late
        cause = CommandCancelled(robot=self.name, command=call.command, reason=reason)
        return self._settle(call, call.cause or Raised.of(cause), now)

    def _tick(self, event: on.Tick, now: float) -> Effects:
        effects: Effects = []
        if lease := self.state.lease.tick(now, event.unix):
            effects += self._freed(lease, f"{lease.parent.name} fell silent", now)
        effects += self._keep_bonds(now)
        for call in list(self.state.calls.live.values()):
            if call.deadline_at <= now and call.key in self.state.calls.live:
                effects += self._end(call, self._late(call), now)
            elif call.attended_until <= now and not call.final:
                cause = CommandCancelled(robot=self.name, command=call.command, reason=UNATTENDED)
                effects += self._end(call, cause, now, final=True)
        if self.state.control.tick(now, event.unix):
            effects.append(self._control_changed())
        return effects

    # -- which operator has it ---------------------------------------------------------------------

    def _set_control(self, event: on.ControlAsked, now: float) -> Effects:
        control, name, asker = self.state.control, self.name, operator_of(event.principal)
        within, before = max(event.within, 0.0), control.holder.person
        if within:
            asker = operator_of(event.principal, present=False)
        if event.what != "leave":
            self.state.lease.check(None, now, event.principal)
        taken = False
        match event.what:
            case "get":
                control.get(name, asker, now, event.unix, within)
            case "take":
                taken = control.take(name, asker, now, event.unix, within, event.seen)
            case "ask":
                control.ask(name, asker, now, within)
            case "offer":
                control.offer(name, asker, event.person, now, event.unix)
            case _:
                control.leave(name, asker, now, event.unix)
        if event.what in {"get", "take"}:
            self.state.lease.used()
        effects: Effects = [self._control_changed(before)]
        if taken:
            effects += self._end_all(f"{asker.person} has taken control of {name}", now, but_readers=True)
        return effects

    def _operator_gone(self, event: on.OperatorGone, now: float) -> Effects:
        before = self.state.control.holder.person
        if event.agent not in self.state.control.agents:
            return []
        self.state.control.lose(event.agent, now, event.unix)
        return [self._control_changed(before, "gone")]

    def _control_changed(self, before: str = "", how: str = "") -> on.ControlChanged:
        control = self.state.control
        text = ""
        if (now := control.holder.person) != before:
            text = f"{now} has control of it" if now else f"{before} has no control of it any more"
            text += f": {before} is gone" if how and before else ""
        return on.ControlChanged(agents=control.agents, text=text)

    # -- who commands it --------------------------------------------------------------------------

    def _ask(self, event: on.ParentAsked, now: float) -> Effects:
        parent = event.parent
        if any(child.name == parent.name for child in self.state.slots.children()):
            raise CycleOfBonds(parent=parent.name, child=self.name, lineage=f"{self.name} > {parent.name}")
        if holder := self.state.control.holder.person:
            reason = f"{holder} has control of it; `robotree control leave {self.name}` gives it up"
            raise NotFree(robot=self.name, reason=reason)
        current = self.state.lease.current
        again = current is not None and current.petition == event.key != ""
        if event.idle and not again and (reason := self._occupation()):
            raise NotFree(robot=self.name, reason=reason)
        if event.returns is not None:
            self.state.lease.expect_later(parent, event.principal, event.life)
        self.state.lease.petition(
            parent,
            event.slot,
            event.lineage,
            event.term,
            now=now,
            unix=event.unix,
            key=event.key,
            returns=event.returns,
            patience=event.patience,
            principal=event.principal,
        )
        self.state.lease.promise(event.waits, event.life)
        return [
            self._granted(),
            on.LeaseChanged(),
            *self._keep_bonds(now, all_of_them=True),
            *self._end_all(f"{parent.name} has enslaved {self.name}", now, but_readers=True),
        ]

    def _occupation(self) -> str:
        """Return what the robot has to do, as a clause; empty: it is free to be chosen."""
        calls = self.state.calls
        if calls.running or calls.waiting:
            return f"it has {calls.command_of(calls.running) or 'a command'} to carry out"
        if self.state.pause.in_force:
            return f"{self.state.pause.in_force} has paused it"
        return "it is stopped" if self.state.stop.in_force else ""

    def _parent_away(self, event: on.ParentAway, now: float) -> Effects:
        return [on.LeaseChanged()] if self.state.lease.wait_for(event.parent, now) else []

    def _prolong(self, event: on.Prolong, now: float) -> Effects:
        before = self.state.lease.current
        lease = self.state.lease.renew(
            event.parent,
            event.epoch,
            event.lineage,
            now=now,
            unix=event.unix,
            principal=event.principal,
            life=event.life,
            is_there=event.is_there,
            heir=event.heir,
            proof=event.proof,
        )
        changed = (
            before is None or before.away or (before.parent, before.lineage) != (lease.parent, lease.lineage)
        )
        pauses = self.state.pause.hear(event.paused, event.pauses)
        news: Effects = [on.LeaseChanged()] if changed else []
        news += [on.PauseChanged()] if pauses else []
        news += self._keep_bonds(now, all_of_them=True) if news else []
        return [self._granted(), *news]

    def _granted(self) -> on.LeaseGranted:
        lease, slots = self.state.lease, self.state.slots
        return on.LeaseGranted(
            epoch=lease.epoch,
            term=lease.term_granted,
            depth=slots.depth,
            ways=slots.ways,
            stopped=0 if lease.current is None else lease.current.stopped,
        )

    def _end_lease(self, event: on.EndLease, now: float) -> Effects:
        lease = self.state.lease
        if event.taken_back:
            ended = lease.retract(event.parent, event.petition, unix=event.unix, principal=event.principal)
        elif event.epoch is not None:  # the parent itself says so, in any incarnation
            ended = lease.release(event.parent, event.epoch, unix=event.unix, principal=event.principal)
        else:  # one incarnation of the parent has gone
            held = lease.current is not None and lease.current.parent == event.parent
            ended = lease.end(event.unix, silent=True) if held else None
        return [] if ended is None else self._freed(ended, event.reason, now)

    def _freed(self, lease: Lease, reason: str, now: float) -> Effects:
        parent, slot = lease.parent, lease.slot
        ended = self._end_all(f"the bond with {parent.name}.{slot} is over: {reason}", now)
        changed = [on.PauseChanged()] if self.state.pause.leave_parent() else []
        renewals = self._keep_bonds(now, all_of_them=True)
        return [*ended, on.LeaseEnded(parent=parent, slot=slot, reason=reason), *changed, *renewals]

    def _obeyed(self, event: on.Obeyed, _: float) -> Effects:
        self.state.lease.note_obeyed(event.epoch)
        return []

    # -- the robots that it commands --------------------------------------------------------------

    def _reserve(self, event: on.Reserve, _: float) -> Effects:
        self.state.slots.begin(event.slot, event.child)
        return []

    def _unreserve(self, event: on.Unreserve, _: float) -> Effects:
        self.state.slots.abort(event.slot)
        return []

    def _bind(self, event: on.Bind, now: float) -> Effects:
        bond = event.bond.copied()  # no part of the state is known outside
        self.state.slots.bind(event.slot, bond)
        return [_renew(event.slot, bond, now)] if self.state.pause.in_force else []

    def _free(self, event: on.FreeAsked, _: float) -> Effects:
        bond = self.state.slots.free(event.slot)
        return [on.ChildGone(slot=event.slot, child=bond.child, reason="")]

    def _watching(self, event: on.Watching, _: float) -> Effects:
        before = self.state.slots.watch(event.slot, event.robot)
        if before is None or before == event.robot:
            return []
        return [on.ChildGone(slot=event.slot, child=before, reason="")]

    def _watch_ended(self, event: on.WatchEnded, _: float) -> Effects:
        robot = self.state.slots.unwatch(event.slot)
        return [on.ChildGone(slot=event.slot, child=robot, reason="")]

    def _lose(self, event: on.Lose, _: float) -> Effects:
        if not self.state.slots.lose(event.slot, event.child, event.epoch, event.reason):
            return []
        return [on.ChildGone(slot=event.slot, child=event.child, reason=event.reason, epoch=event.epoch)]

    def _keep_bonds(self, now: float, *, all_of_them: bool = False) -> Effects:
        """Renew what is due, and lose the children who have not answered in time.

        Args:
            now: [s]
            all_of_them: renew every lease: the children must know their new ancestors, so that a cycle of
                bonds is found at once.
        """
        effects: Effects = []
        for slot, bond in self.state.slots.bonds().items():
            child, lease = bond.child, bond.lease
            if lease.expires <= now:
                reason = f"{child.name} did not answer for {lease.term:.3g} s"
                effects += self._lose(on.Lose(slot=slot, child=child, epoch=lease.epoch, reason=reason), now)
            elif all_of_them or lease.due <= now:
                effects.append(_renew(slot, bond, now))
        return effects

    def _renewed(self, event: on.Renewed, now: float) -> Effects:
        if bond := self.state.slots.held(event.slot, event.child, event.epoch):
            bond.child = event.child
            bond.lease.epoch = max(bond.lease.epoch, event.granted)
            bond.lease.granted(sent=event.sent, now=now, term=event.term)
            bond.depth, bond.ways = event.depth, event.ways
            if event.description is not None:
                bond.description = event.description
            if event.stopped != bond.stopped:
                bond.stopped = event.stopped
                return self._end_all(f"{event.child.name} was stopped while {self.name} was away", now)
        return []

    def _described(self, event: on.ChildDescribed, now: float) -> Effects:
        bond = self.state.slots.held(event.slot, event.child, event.epoch)
        if bond is None:
            return []
        bond.description = event.description
        return [_renew(event.slot, bond, now)]  # else the child believes that its parent knows less

    # -- what it keeps ----------------------------------------------------------------------------

    def _set(self, event: on.Set, now: float) -> Effects:
        if event.principal != ITSELF:
            self.state.lease.check(event.epoch, now, event.principal)
            self.state.control.expect(self.name, event.principal)
        self.state.fields.update(event.values)
        return [on.FieldsChanged()]

    def _reload(self, event: on.PageReloaded, _: float) -> Effects:
        state = self.state
        state.slots.revise(event.slots)
        state.fields.clear()  # the same object: running readers of the old page look into it
        state.fields.update(event.fields)
        return [on.FieldsChanged()]

    # -- stops ------------------------------------------------------------------------------------

    def _safe_stop(self, event: on.StopAsked, now: float) -> Effects:
        stop = self.state.stop
        if generation := stop.known(event.order):
            taken = on.StopTaken(generation=generation, fresh=False, reply=stop.reply(generation))
            return [taken, *self._ask_parts(generation, event)]
        children = {slot: bond.child.name for slot, bond in self.state.slots.bonds().items()}
        generation = stop.begin(event.reason, event.order, {HARDWARE: self.name, **children}, now)
        self.state.lease.note_stop(generation)
        taken = on.StopTaken(generation=generation, fresh=True, reply=stop.reply(generation))
        return [taken, *self._end_all(event.reason, now), *self._ask_parts(generation, event)]

    def _ask_parts(self, generation: int, order: on.StopAsked) -> Effects:
        """Ask those that have not answered a stop."""
        return [
            on.AskPart(
                generation=generation, part=part, reason=order.reason, order=order.order, within=order.within
            )
            for part in self.state.stop.unanswered(generation)
        ]

    # -- pauses -----------------------------------------------------------------------------------

    def _pause(self, event: on.PauseAsked, now: float) -> Effects:
        self.state.lease.check(None, now, event.principal, ends=True)  # as a cancel
        self.state.pause.begin(event.by)
        return self._pause_changed(now)

    def _let_step(self, event: on.StepLet, now: float) -> Effects:
        self.state.lease.check(event.epoch, now, event.principal)
        self.state.control.expect(self.name, event.principal)
        if not self.state.pause.in_force:
            raise NotPaused(robot=self.name)
        if event.step:
            self.state.pause.pass_one(event.step)
        return [on.PauseChanged()]

    def _continue(self, event: on.ContinueAsked, now: float) -> Effects:
        self.state.lease.check(None, now, event.principal)
        self.state.control.expect(self.name, event.principal)
        self.state.pause.end()
        return self._pause_changed(now)

    def _pause_changed(self, now: float) -> Effects:
        """Have those look again that wait, and have the children hear of it at once."""
        return [on.PauseChanged(), *self._keep_bonds(now, all_of_them=True)]

    def _place(self, event: on.PlacingSet, _: float) -> Effects:
        self.state.placing = event.placing
        return []

    # -- after a crash ----------------------------------------------------------------------------

    def _restored(self, event: on.Restored, _: float) -> Effects:
        stop, calls = self.state.stop, self.state.calls
        orders = {generation: order for order, generation in stop.orders.items()}
        calls.abandoned, calls.places = {}, {}  # that code has ended with its process
        for call in calls.live.values():
            call.doubt = ""  # it asks again
        effects: Effects = [on.Begin(key=key) for key in event.calls if key in calls.live]
        for generation in stop.parts if stop.reason else ():  # what is released is not to be stopped again
            order = on.StopAsked(reason=stop.reason, order=orders.get(generation, ""))
            effects += self._ask_parts(generation, order)
        return effects

    def _halted(self, event: on.Halted, now: float) -> Effects:
        self.state.stop.note_halted(event.reason, now)
        return self._end_all(event.reason, now, but_readers=True) if event.reason else []

    def _stop_answered(self, event: on.StopAnswered, _: float) -> Effects:
        reply = self.state.stop.take(event.generation, event.part, event.answer)
        return [] if reply is None else [on.StopSettled(generation=event.generation, reply=reply)]

    def _release(self, event: on.ReleaseAsked, _: float) -> Effects:
        stop = self.state.stop
        if event.generation != stop.generation:
            reason = "it was stopped again after that had been asked for"
            raise NotConfirmed(order="the resume", told=[], untold=[[self.name, reason]], advice=[])
        stop.release()
        return []

    _handlers: ClassVar[dict[type, Callable[[Any, Any, float], Effects]]] = {
        on.Invoke: _invoke,
        on.Finish: _finish,
        on.StepTaken: _step_taken,
        on.Checkpoint: _checkpoint,
        on.DoubtRaised: _doubt,
        on.DoubtSettled: _decide,
        on.ParentAway: _parent_away,
        on.DetachAsked: _detach,
        on.Attended: _attended,
        on.ControlAsked: _set_control,
        on.OperatorGone: _operator_gone,
        on.CancelAsked: _cancel,
        on.CancelAll: _cancel_all,
        on.Abandon: _abandon,
        on.Gone: _gone,
        on.Tick: _tick,
        on.ParentAsked: _ask,
        on.Prolong: _prolong,
        on.EndLease: _end_lease,
        on.Obeyed: _obeyed,
        on.Reserve: _reserve,
        on.Unreserve: _unreserve,
        on.Bind: _bind,
        on.FreeAsked: _free,
        on.Watching: _watching,
        on.WatchEnded: _watch_ended,
        on.Lose: _lose,
        on.Renewed: _renewed,
        on.ChildDescribed: _described,
        on.Set: _set,
        on.PageReloaded: _reload,
        on.StopAsked: _safe_stop,
        on.Restored: _restored,
        on.Halted: _halted,
        on.StopAnswered: _stop_answered,
        on.ReleaseAsked: _release,
        on.PauseAsked: _pause,
        on.StepLet: _let_step,
        on.ContinueAsked: _continue,
        on.PlacingSet: _place,
    }


def _of_laps(call: AcceptedCall) -> dict[str, on.StepResult]:
    """Return the steps that lead to the present lap of a command."""
    numbers = {lap.number for lap in call.laps}
    return {path: step for path, step in call.steps.items() if lap_of(path) in numbers}


def _renew(slot: str, bond: Bond, now: float) -> on.RenewLease:
    bond.lease.asked(now)
    return on.RenewLease(slot=slot, child=bond.child, epoch=bond.lease.epoch, sent=now)
