"""The safeguards and locks of robotree, each with the one place where it is, so that a test can take it away.

As a plugin of pytest it has the tests run without the one that the environment names (`VARIABLE`).
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import robotree.tui.line.groups
import robotree.vr.core.machine
import robotree.vr.exchange.authority
import robotree.vr.exchange.claim
import robotree.vr.journal.recovery
import robotree.vr.journal.segments
import robotree.vr.network.mesh
import robotree.vr.network.realms
import robotree.vr.running.child_call
import robotree.vr.sites.gateway
import robotree.vr.world.network
from robotree.files import opened_own, private_folder
from robotree.protocol.messages import Goal, GoalCancel, SetMode, Verb
from robotree.protocol.services.claim_server import ClaimServer
from robotree.protocol.services.fence import Fence
from robotree.protocol.services.goal_server import GoalId, GoalServer, GoalServerEffect
from robotree.protocol.services.peer import Peer
from robotree.proxy.desired_mode import DesiredMode
from robotree.proxy.guard import EpochCheck
from robotree.sim.firmware.movement import Watchdog
from robotree.vr.agents.callers import Callers
from robotree.vr.agents.host import Host
from robotree.vr.agents.outside import OutsideCaller, OutsideCalls
from robotree.vr.agents.stops import Stops
from robotree.vr.agents.taker import OrderTaker
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import DamagedJournal, NotInControl
from robotree.vr.base.order import Order, OrderHold
from robotree.vr.base.presence import Presence
from robotree.vr.base.requests import Accepted, Call, Raised, Returned, encode
from robotree.vr.core import events as on
from robotree.vr.core.bonds import GrantedLease, HeldLease, Lease
from robotree.vr.core.control import RobotControl
from robotree.vr.core.machine import Calls, RobotCore
from robotree.vr.core.stop import Stop
from robotree.vr.core.transfer import (
    Departing,
    Destination,
    DestinationEffect,
    NoWord,
    SayDecision,
    SourceEffect,
    SourceEvent,
    WordCame,
)
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.outlet import Outlet
from robotree.vr.journal.segments import HEAD, OSDisk, Segments
from robotree.vr.network.door import Door
from robotree.vr.network.link import LinkFrame, PeerLink
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.readers import Readers
from robotree.vr.network.refusals import Refusals
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.orders.ledger import LedgerEntry
from robotree.vr.running.child_call import ChildCall
from robotree.vr.running.frame import Frame
from robotree.vr.running.log import Log
from robotree.vr.running.process import Process, Worker
from robotree.vr.running.replay import Replay
from robotree.vr.running.robot_runtime import RobotRuntime
from robotree.vr.running.runner import SerialWorker
from robotree.vr.scripts.happening import PersonAsked
from robotree.vr.scripts.run import ScriptRun
from robotree.vr.sites.gateway import Gateway
from robotree.vr.sites.site import Site
from robotree.vr.sites.stopping import SiteStops
from robotree.vr.supervision.stop import Releases
from robotree.vr.world.virtual_runner import VirtualLock


@dataclass(frozen=True)
class Safeguard:
    """One safeguard and how the program behaves without it."""

    place: Any
    """Where it is: a class or a module."""
    name: str
    """What it is called there."""
    without: Any
    """What stands there instead."""


def _deadline_of_its_own(**fields: Any) -> Call:
    return Call(**{**fields, "deadline": 60.0})


def _counted_from_the_grant(self: HeldLease, *, sent: float, now: float, term: float) -> None:
    del sent
    self.confirmed, self.term = now, term


_receive = GoalServer.receive
_messages_due = DesiredMode.messages_due


def _only_once(self: DesiredMode, now: float) -> list[SetMode]:
    asked = self._release is None and self._sent_at != -math.inf
    return [] if asked else _messages_due(self, now)


def _leave_in_two_steps(self: Readers, announced: int = 0) -> None:
    with self._counting:
        self._leaving -= announced
    _leave(self)


def _take_all(self: Mesh, link: PeerLink, frame: LinkFrame) -> None:
    link.refused = False
    _take(self, link, frame)


def _keep_both(self: Mesh, link: PeerLink) -> Any:
    return self._peers.get(link.member) or _settle_who_dialed(self, link)


async def _of_all_or_none(run: Any, client: Any, line: Any, teller: Any, _: Any) -> Any:
    return await run(client, line, teller)


def _unproven(written: bytes) -> bytes:
    return written.partition(b"\n")[2]


_leave, _take, _settle_who_dialed = Readers._leave, Mesh._take, Mesh._settle_who_dialed


def _every_goal_is_new(
    self: GoalServer, message: Goal | GoalCancel, peer: Peer, now: float
) -> list[GoalServerEffect]:
    if isinstance(message, Goal) and message.verb != Verb.STATUS:
        self._records.pop(GoalId(peer.system, peer.component, message.key), None)
    return _receive(self, message, peer, now)


_renew, _frames, _segments_begin = GrantedLease.renew, robotree.vr.journal.segments.frames_in, Segments.begin
_settle, _recall, _outlet = ChildCall.settle, Replay.take, Outlet.__init__


def _wherever_it_is(self: GrantedLease, *values: Any, **named: Any) -> Any:
    return _renew(self, *values, **{**named, "is_there": True})


def _only_the_holder(self: GrantedLease, held: Any, parent: Any, principal: Any) -> None:
    if parent == held.parent and principal != held.principal:
        raise NotInControl(robot=self.robot, holder=held.parent.name, slot=held.slot)


def _all_that_run(self: RobotRuntime) -> None:
    running = self.look(lambda state: [call.key for call in state.calls.live.values() if call.running])
    self.post(on.Restored(calls=tuple(running)))


def _accept_without_a_promise(self: OutsideCaller) -> None:
    if not self._accepted and not self.over:
        self._accepted = True
        self._respond(encode(Accepted(key=self._call.key)))


def _whole_frames(data: bytes, path: str) -> Iterator[bytes]:
    read = 0
    for frame in _frames(data, path):
        read += HEAD.size + len(frame)
        yield frame
    if read < len(data):
        raise DamagedJournal(path=path, at=read, detail="the end of the file is missing")


def _unchecked_frames(data: bytes, _path: str) -> Iterator[bytes]:
    at = 0
    while at + HEAD.size <= len(data):
        length = HEAD.unpack_from(data, at)[0]
        at += HEAD.size + length
        yield data[at - length : at]


def _lock_nothing(_: OSDisk, folder: Path) -> int:
    private_folder(folder)
    return opened_own(folder / "lock", os.O_CREAT | os.O_RDWR)


def _sync_no_names(self: Segments) -> None:
    self._disk.sync(self._open)


def _begin_without_the_old(self: Segments) -> None:
    _segments_begin(self)
    self.drop_older()


def _clear_what_can_be(self: Segments) -> None:
    self._close()
    for number in self._numbers:
        with contextlib.suppress(OSError):
            self._disk.unlink(self._path(number))
    self._numbers = []


def _give_back_first(self: ChildCall, reply: Returned | Raised) -> None:
    for leave in self._leave:
        leave()
    self._leave = ()
    _settle(self, reply)


def _whatever_it_is(self: Replay, path: str, kind: str, content: Any, number: int) -> Any:
    step = self._kept.get(path)
    same = step is not None and step.kind == kind
    return _recall(self, path, kind, None if same else content, number)


def _asked_just_now(body: bytes, _age: float, *values: Any, **named: Any) -> Any:
    return _arrived(body, 0.0, *values, **named)


def _of_the_name(self: Lease, parent: Any, _principal: Any) -> bool:
    return self.parent.identity == parent.identity


def _wherever(_presence: Any, keys: Any) -> list[str]:
    return list(keys)


def _gives_up(self: Departing, event: SourceEvent) -> list[SourceEffect]:
    return _handle_move(self, WordCame(taken=False) if isinstance(event, NoWord) else event)


def _not_now(self: Destination, transfer: str) -> list[DestinationEffect]:
    del self, transfer
    return [SayDecision(taken=False)]


_arrived = robotree.vr.sites.gateway.arrived
_handle_move = Departing.handle


async def _taken_in_silence(self: OrderTaker, order: Order) -> bool:
    del self, order
    return True


async def _as_if_new(self: OrderTaker, entry: LedgerEntry) -> bool:
    return await self._begin(entry.order)


_ask_people, _keep_step = ScriptRun._ask, Frame.keep_step


def _asked_before(self: ScriptRun, question: PersonAsked) -> None:
    if self.is_current:
        _ask_people(self, question)


def _untold(self: Frame, path: str, step: on.StepResult) -> None:
    if step.kind != on.RECEIVED:
        _keep_step(self, path, step)


class _Open:
    """A lock that excludes nobody; threads can lose the processor at it all the same."""

    def __init__(self, lock: VirtualLock) -> None:
        self._runner = lock.runner

    def acquire(self, blocking: bool = True) -> bool:  # noqa: FBT001, FBT002 # as `threading.Lock`
        del blocking
        self._runner.point()
        return True

    def release(self) -> None:
        self._runner.point()

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


def _lock(owner: type, name: str) -> Safeguard:
    """Return a lock, an attribute of the objects of a class: without it, it excludes nobody."""

    def get(one: Any) -> Any:
        return one.__dict__[name]

    def put(one: Any, value: Any) -> None:
        one.__dict__[name] = _Open(value)

    return Safeguard(owner, name, property(get, put))


SAFEGUARDS = {
    "a robot moves for its operator alone": (Safeguard(RobotControl, "expect", lambda *_: None),),
    "an attended command ends without a key": (Safeguard(robotree.vr.core.machine, "ATTENTION", 1e9),),
    "a request needs the right that the policy gives": (
        Safeguard(robotree.vr.exchange.authority, "_keep_to_policy", lambda *_: None),
    ),
    "a command ends when its asker may not have it any more": (
        Safeguard(RobotRuntime, "keep_to_policy", lambda _: None),
    ),
    "a revocation is handed on to all sites": (Safeguard(Gateway, "_spread", lambda _: None),),
    "a robot says that it takes an order before it begins": (
        Safeguard(OrderTaker, "_confirmed", _taken_in_silence),
    ),
    "the first answer to a question counts": (Safeguard(ScriptRun, "_take_answer", lambda *_: True),),
    "a question that was put before a crash waits after it": (Safeguard(ScriptRun, "_ask", _asked_before),),
    "what a script was told it knows after a crash": (Safeguard(Frame, "keep_step", _untold),),
    "what one of a group refuses is not the others' matter": (
        Safeguard(robotree.tui.line.groups, "_one", _of_all_or_none),
    ),
    "a stop also names who of a group does not answer": (
        Safeguard(robotree.tui.line.groups, "UNSURE", frozenset[str]()),
    ),
    "an order that may have begun does not begin again": (Safeguard(OrderTaker, "_begin_again", _as_if_new),),
    "a stop holds a robot that is away": (Safeguard(OrderHold, "holds", lambda *_: False),),
    "a request tells another machine its age": (
        Safeguard(robotree.vr.sites.gateway, "arrived", _asked_just_now),
    ),
    "a stop names each site that it has not reached": (Safeguard(SiteStops, "_miss", lambda *_: None),),
    "a robot of the same name at another site is another robot": (Safeguard(Lease, "of", _of_the_name),),
    "a name is unique at its site and not beyond": (
        Safeguard(robotree.vr.exchange.claim, "here_of", _wherever),
        Safeguard(robotree.vr.world.network, "here_of", _wherever),
    ),
    "a site that is silent begins nothing new": (
        Safeguard(Site, "linked", lambda self, _: bool(self.stream)),
    ),
    "a source in doubt never acts": (Safeguard(Departing, "handle", _gives_up),),
    "that a robot may be out is written before it is sent": (Safeguard(HostJournal, "out", lambda *_: None),),
    "a robot that has come is written before that is said": (
        Safeguard(HostJournal, "arrived", lambda *_: None),
    ),
    "a host that has not taken a robot never does": (Safeguard(Destination, "_never", _not_now),),
    "what is not written does not leave a host": (
        Safeguard(Outlet, "__init__", lambda self, transport, _: _outlet(self, transport, lambda: None)),
    ),
    "one host writes a log": (Safeguard(OSDisk, "lock", _lock_nothing),),
    "a record counts if it fits its checksum": (
        Safeguard(robotree.vr.journal.segments, "frames_in", _unchecked_frames),
    ),
    "a record that was cut short is left out": (
        Safeguard(robotree.vr.journal.segments, "frames_in", _whole_frames),
    ),
    "a loss of power may tear what was not synced": (
        Safeguard(HostJournal, "_may_have_lost_power", lambda _: False),
    ),
    "the names of the files of a log are synced": (Safeguard(Segments, "sync", _sync_no_names),),
    "older files of a log stay until the newest is whole": (
        Safeguard(Segments, "begin", _begin_without_the_old),
    ),
    "what adds up is synced before it is asked for": (Safeguard(HostJournal, "sync", lambda _: None),),
    "a log that takes nothing more is removed": (Safeguard(HostJournal, "_clear", lambda _: None),),
    "a host whose log can neither be written nor removed ends": (
        Safeguard(Segments, "clear", _clear_what_can_be),
    ),
    "that a robot was deleted is written down": (Safeguard(HostJournal, "gone", lambda *_: None),),
    "a call's number is given back when its result is kept": (
        Safeguard(ChildCall, "settle", _give_back_first),
    ),
    "each life of a host counts its calls anew": (
        Safeguard(RobotRuntime, "_life", property(lambda _: "", lambda *_: None)),
    ),
    "a page that takes another step than before is ended": (Safeguard(Replay, "take", _whatever_it_is),),
    "moments that were kept are moved to the present clock": (
        Safeguard(HostJournal, "shift", property(lambda _: 0.0)),
    ),
    "a child waits for a parent that is away": (Safeguard(GrantedLease, "wait_for", lambda *_: False),),
    "the next process of a parent that is away is its heir": (
        Safeguard(GrantedLease, "_expect_holder", _only_the_holder),
    ),
    "what a process asked before its end keeps no heir away": (
        Safeguard(GrantedLease, "renew", _wherever_it_is),
    ),
    "who has called waits for a robot that comes back": (
        Safeguard(OutsideCaller, "accept", _accept_without_a_promise),
    ),
    "a restored robot begins again what its process left, and nothing else": (
        Safeguard(RobotRuntime, "begin_again", _all_that_run),
    ),
    "calls wait until all robots of a host are back": (
        Safeguard(OutsideCalls, "_has_to_wait", lambda *_: False),
    ),
    "the name of a robot that comes back is given to nobody else": (
        Safeguard(Host, "_kept_names", lambda _: set[str]()),
    ),
    "nobody waits for a child that an ended process has asked": (
        Safeguard(robotree.vr.journal.recovery, "_forget_questions", lambda _: None),
    ),
    "a child that was begun once is not begun by another life of it": (
        Safeguard(Replay, "intent", lambda *_: None),
    ),
    "a child refuses a call under another lease than the one in force": (
        Safeguard(GrantedLease, "check", lambda *_: None),
    ),
    "a proxy refuses an epoch older than one that it obeyed": (
        Safeguard(EpochCheck, "admit", lambda *_: None),
    ),
    "a controller refuses an epoch older than one that it obeyed": (
        Safeguard(Fence, "objection", lambda *_: None),
    ),
    "a controller obeys the holder of its claim only": (Safeguard(ClaimServer, "guard", lambda *_: None),),
    "a call that comes twice is carried out once": (Safeguard(Calls, "known", lambda *_: None),),
    "a call that its caller has given up is never begun": (Safeguard(Calls, "late", lambda *_: False),),
    "a cancel that comes before its call is remembered": (Safeguard(Calls, "refuse", lambda *_: None),),
    "a child's command ends by the deadline of its parent's": (
        Safeguard(robotree.vr.running.child_call, "Call", _deadline_of_its_own),
    ),
    "a release names the stop that it ends": (
        Safeguard(Stops, "_stops_seen", lambda self, _: self._runtime.stops),
    ),
    "a release ends the stops that were known when it was asked for": (
        Safeguard(Releases, "count", lambda *_: None),
        Safeguard(Stop, "known_to", lambda *_: True),
    ),
    "a stopped robot begins nothing": (Safeguard(RobotCore, "_expect_free_to_move", lambda *_: None),),
    "a parent counts a lease from when it asked for it": (
        Safeguard(HeldLease, "granted", _counted_from_the_grant),
    ),
    "a child ends a lease that is not renewed": (Safeguard(GrantedLease, "tick", lambda *_: None),),
    "a controller stops when its commander is not heard": (Safeguard(Watchdog, "silent", lambda *_: False),),
    "a request is void some time after it was asked": (
        Safeguard(Received, "expect_in_time", lambda *_: None),
    ),
    "a controller ends a goal whose time is over": (Safeguard(GoalServer, "tick", lambda *_: []),),
    "a controller carries a goal out once": (Safeguard(GoalServer, "receive", _every_goal_is_new),),
    "a controller refuses what was asked of an earlier life of it": (
        Safeguard(GoalServer, "_is_of_another_life", lambda *_: False),
    ),
    "a controller refuses goals of a proxy that does not hold it any more": (
        Safeguard(ClaimServer, "guard", lambda *_: None),
        Safeguard(Fence, "objection", lambda *_: None),
    ),
    "a stop is asked for again until it is confirmed": (Safeguard(DesiredMode, "messages_due", _only_once),),
    "a call ends with the program that asked for it": (Safeguard(Callers, "attend", lambda *_: None),),
    "the end of a connection is seen though it comes with data": (
        Safeguard(robotree.vr.network.mesh, "ENDED", 0),
    ),
    "a reader that leaves is counted out at once": (Safeguard(Readers, "_leave", _leave_in_two_steps),),
    "a process whose files are gone registers again": (Safeguard(Rendezvous, "registered", lambda _: True),),
    "a process that hangs counts as silent": (Safeguard(Mesh, "_judge", lambda *_: None),),
    "a process that has slept blames nobody": (Safeguard(robotree.vr.network.mesh, "SLEPT", math.inf),),
    "a process that wakes says so": (Safeguard(Mesh, "_take_awake", lambda *_: None),),
    "messages on a refused connection do not count": (Safeguard(Mesh, "_take", _take_all),),
    "of two that dial each other one gives way": (Safeguard(Mesh, "_settle_who_dialed", _keep_both),),
    "what was asked of a process that is gone ends": (Safeguard(Mesh, "_give_up", lambda *_: None),),
    "a list of keys proves that it is whole": (Safeguard(robotree.vr.network.realms, "_proven", _unproven),),
    "a process that has joined knows all who are there": (
        Safeguard(Mesh, "_await_greetings", lambda *_: None),
    ),
    "descriptors are kept in reserve": (Safeguard(Door, "_fill_reserve", lambda _: None),),
    "the state of a robot": (_lock(RobotRuntime, "_lock"),),
    "the timers of a process": (_lock(Process, "_lock"),),
    "interruptions of a worker": (_lock(Worker, "guard"),),
    "the work of a serial worker": (_lock(SerialWorker, "_lock"),),
    "the callers of a robot": (_lock(Callers, "_lock"),),
    "calls that wait for a host": (_lock(OutsideCalls, "_lock"),),
    "what a journal was told": (_lock(HostJournal, "_lock"),),
    "the file of a journal": (_lock(HostJournal, "_writing"),),
    "the syncs of a journal": (_lock(HostJournal, "_syncing"),),
    "the log of a robot": (_lock(Log, "_lock"),),
    "the queues of a connection": (_lock(PeerLink, "_lock"),),
    "the peers of a mesh": (_lock(Mesh, "_lock"),),
    "the files of a process": (_lock(Rendezvous, "_lock"),),
    "the number of readers": (_lock(Readers, "_counting"),),
    "the one who reads": (_lock(Readers, "_reading"),),
    "refusals": (_lock(Refusals, "_lock"),),
    "the table of presence": (_lock(Presence, "_lock"),),
}


@contextlib.contextmanager
def without(safeguard: str) -> Generator[None]:
    """Take one safeguard or lock away inside the block."""
    with contextlib.ExitStack() as stack:
        for one in SAFEGUARDS[safeguard]:
            before = vars(one.place).get(one.name)
            setattr(one.place, one.name, one.without)
            if before is None:  # its instances have it
                stack.callback(delattr, one.place, one.name)
            else:
                stack.callback(setattr, one.place, one.name, before)
        yield


VARIABLE = "WITHOUT_SAFEGUARD"


@pytest.fixture(autouse=True)
def _without_a_safeguard() -> Generator[None]:
    with without(os.environ[VARIABLE]):
        yield
