"""The safeguards of robotree, each with the one place where it is, so that a test can take it away."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Generator
from dataclasses import dataclass
from typing import Any

import robotree.vr.network.mesh
import robotree.vr.network.realms
import robotree.vr.running.child_call
from robotree.protocol.messages import Goal, GoalCancel, SetMode, Verb
from robotree.protocol.services.claim_server import ClaimServer
from robotree.protocol.services.fence import Fence
from robotree.protocol.services.goal_server import GoalId, GoalServer, GoalServerEffect
from robotree.protocol.services.peer import Peer
from robotree.proxy.desired_mode import DesiredMode
from robotree.proxy.guard import EpochCheck
from robotree.sim.firmware.watchdog import Watchdog
from robotree.vr.agents.callers import Callers
from robotree.vr.agents.stops import Stops
from robotree.vr.base.envelope import Received
from robotree.vr.base.requests import Call
from robotree.vr.core.bonds import GrantedLease, HeldLease
from robotree.vr.core.machine import Calls, RobotCore
from robotree.vr.core.stop import Stop
from robotree.vr.network.door import Door
from robotree.vr.network.link import LinkFrame, PeerLink
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.readers import Readers
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.supervision.releases import Releases
from tests.world import locks
from tests.world.locks import LOCKS


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


def _unproven(written: bytes) -> bytes:
    return written.partition(b"\n")[2]


_leave, _take, _settle_who_dialed = Readers._leave, Mesh._take, Mesh._settle_who_dialed


def _every_goal_is_new(
    self: GoalServer, message: Goal | GoalCancel, peer: Peer, now: float
) -> list[GoalServerEffect]:
    if isinstance(message, Goal) and message.verb != Verb.STATUS:
        self._records.pop(GoalId(peer.system, peer.component, message.key), None)
    return _receive(self, message, peer, now)


SAFEGUARDS = {
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
}


@contextlib.contextmanager
def without(safeguard: str) -> Generator[None]:
    """Take one safeguard away inside the block, or the lock of `LOCKS`."""
    if safeguard in LOCKS:
        with locks.without(safeguard):
            yield
        return
    with contextlib.ExitStack() as stack:
        for one in SAFEGUARDS[safeguard]:
            before = getattr(one.place, one.name)
            setattr(one.place, one.name, one.without)
            stack.callback(setattr, one.place, one.name, before)
        yield
