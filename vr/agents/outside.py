"""Calls from other processes: from the bytes of a request to the robot, and from its core back to bytes.

It runs in the thread that reads the network, so that no event loop is on a call's way. What may take time,
such as the units behind a text, is handed to a worker.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial

import msgspec

from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import Unreachable, VrError
from robotree.vr.base.principal import SCRIPT, Principal, is_person
from robotree.vr.base.requests import (
    Accepted,
    AnyRequest,
    Attend,
    Call,
    Cancel,
    Detach,
    Done,
    Moved,
    Progress,
    Raised,
    Returned,
    encode,
)
from robotree.vr.base.transport import ELSEWHERE, End, Incoming, Respond
from robotree.vr.core import events as on
from robotree.vr.core.events import CoreEvent
from robotree.vr.core.machine import LONGEST_DEADLINE
from robotree.vr.exchange.dispatcher import AnswerAtOnce, refusal
from robotree.vr.running.ice import Frozen
from robotree.vr.running.robot_runtime import NotDescribed, RobotRuntime
from robotree.vr.running.runner import SerialWorker

PROGRESS_PERIOD = 0.05
"""[s] Least time between two messages with a command's progress to one caller."""

ACCEPTED_WITHIN = 0.05
"""[s] A command that ends earlier is answered with its result alone, if its caller need not know whether it
has begun: it only reads, or its caller is a parent, which takes for begun what it has sent. All others are
accepted before they begin."""

MOST_PENDING = 32
"""Reports that wait for the next message: of more, the middle ones are left out, never the latest."""


class OutsideCaller:
    """A caller in another process that waits for the end of a call: a `Listener`."""

    def __init__(self, runtime: RobotRuntime, call: Call, respond: Respond, end: End) -> None:
        """Take how to reply and how to end the replies."""
        self._runtime, self._call, self._respond, self._end = runtime, call, respond, end
        self._quiet_until = 0.0
        self._pending: list[Progress] = []
        self._accepted = False
        self.over = False
        """Whether the call has ended."""

    def accept(self) -> None:
        """Say that the call is accepted, once and only before its end."""
        if not self._accepted and not self.over:
            self._accepted = True
            self._respond(encode(Accepted(key=self._call.key, returns=self._runtime.process.returns)))

    def note(self, fraction: float, text: str) -> None:
        now, waiting = self._runtime.process.runner.now(), bool(self._pending)
        if len(self._pending) >= MOST_PENDING:
            self._pending.pop()
        self._pending.append(Progress(key=self._call.key, fraction=fraction, text=text))
        if now >= self._quiet_until:
            self._tell()
        elif not waiting:
            self._runtime.process.at(self._quiet_until, self._tell)

    def settle(self, reply: Returned | Raised) -> None:
        if isinstance(reply, Raised):
            self.accept()  # an error that comes first would be a refusal
        elif self._call.describe_result:
            fields = self._runtime.result_of(self._call.command)
            reply = msgspec.structs.replace(reply, fields=fields)
        self._tell()
        self.over = True
        self._end(encode(reply))

    def go_elsewhere(self) -> None:
        """Have the caller ask where the robot goes on now."""
        if self.over:
            return
        self.over = True
        if self._accepted:
            self._respond(encode(Moved()))
            self._end(None)
        else:
            self._end(ELSEWHERE)

    def _tell(self) -> None:
        pending, self._pending = self._pending, []
        if pending and not self.over:
            self._quiet_until = self._runtime.process.runner.now() + PROGRESS_PERIOD
            self.accept()
            for progress in pending:
                self._respond(encode(progress))


class OutsideCalls:
    """Takes the calls and cancels that come for one robot."""

    def __init__(
        self,
        runtime: RobotRuntime,
        *,
        is_open: Callable[[], bool],
        attend: Callable[[str, str], None],
        waits: bool,
    ) -> None:
        """Begin, on the event loop.

        Args:
            runtime: the robot.
            is_open: returns whether it takes anything new.
            attend: ends a call when a caller's presence goes; takes presence and key.
            waits: whether calls wait for `go_on`: not all robots of a host that was started again are back.
        """
        self._runtime, self._is_open, self._attend = runtime, is_open, attend
        self._units = SerialWorker(runtime.process.runner, f"{runtime.robot.name} units")
        self._to_accept: deque[tuple[float, OutsideCaller]] = deque()
        self._waits = waits
        self._waiting: list[Callable[[], object]] = []
        self._lock = runtime.process.runner.lock()

    def go_on(self) -> None:
        """Take the calls that have waited for it, and from now on each at once."""
        with self._lock:
            self._waits = False
        while self._waiting:
            self._waiting.pop(0)()

    def _has_to_wait(self, call: Callable[[], object]) -> bool:
        with self._lock:
            if self._waits:
                self._waiting.append(call)
            return self._waits

    @property
    def answers(self) -> Mapping[type[AnyRequest], AnswerAtOnce]:
        """The answers by the class of the request."""
        return {
            Call: lambda received, incoming: self._call(received, incoming.reply, incoming.end),
            Cancel: self._order,
            Detach: self._order,
            Attend: self._order,
        }

    # -- inside -----------------------------------------------------------------------------------

    def _call(self, received: Received, respond: Respond, end: End) -> None:
        call, principal = _named(received), received.principal
        seconds = min(call.deadline, LONGEST_DEADLINE) if math.isfinite(call.deadline) else call.deadline
        # what a parent's bond does for its calls, its presence does for the call of a program that waits
        attended_by = "" if call.oneway or call.epoch is not None else principal.agent
        ends, runtime = received.asked + seconds, self._runtime
        until = received.asked + call.attended
        admit = partial(self._admit, call, principal, respond, end, ends, attended_by, until)
        work: Callable[[], object] = admit
        if runtime.takes_long(call):  # to load units takes a while
            known = partial(admit, runtime.stops)
            work = partial(self._units.submit, lambda: known() is None)
        if not self._waits or not self._has_to_wait(partial(admit, runtime.stops)):
            work()

    def _admit(  # noqa: C901 # the ways in which a call can begin or not
        self,
        call: Call,
        principal: Principal,
        respond: Respond,
        end: End,
        deadline_at: float,
        attended_by: str,
        until: float,
        stops: int = -1,
    ) -> None:
        """Have a call accepted; `stops` and `until`, when its attention ends, as in `RobotRuntime.admit`."""
        runtime = self._runtime
        caller = None if call.oneway else OutsideCaller(runtime, call, respond, end)
        before = runtime.progress_of(call.key)  # of a call that is asked again

        def accepted() -> None:
            if caller is None:
                end(encode(Accepted(key=call.key)))
            elif call.epoch is not None or runtime.only_reads(call.command):
                self._accept_later(caller)
            else:
                caller.accept()

        try:
            self._expect_open()
            runtime.admit(
                call,
                deadline_at,
                principal,
                listener=caller,
                accepted=accepted,
                stops=stops,
                attended_until=until,
            )
        except NotDescribed as unknown:
            came = runtime.stops if stops < 0 else stops

            def described(error: VrError | None) -> None:
                if error is None:
                    self._admit(call, principal, respond, end, deadline_at, attended_by, until, came)
                else:
                    self._refuse(error, end)

            runtime.describe_child(unknown, described)
        except Frozen as frozen:
            again = partial(
                self._admit, call, principal, respond, end, deadline_at, attended_by, until, stops
            )
            if not frozen.ice.hold(again, partial(end, ELSEWHERE)):
                again()
        except Exception as error:  # noqa: BLE001 # the asker gets an answer, whatever happens
            self._refuse(error, end)
        else:
            if attended_by:
                self._attend(attended_by, call.key)
            if caller is not None and before[1]:
                caller.note(*before)

    def _accept_later(self, caller: OutsideCaller) -> None:
        """Accept a call in a while, if it has not ended; one timer does for all that wait."""
        when = self._runtime.process.runner.now() + ACCEPTED_WITHIN
        self._to_accept.append((when, caller))
        if len(self._to_accept) == 1:
            self._runtime.process.at(when, self._accept_all)

    def _accept_all(self) -> None:
        now, waiting = self._runtime.process.runner.now(), self._to_accept
        while waiting and (waiting[0][1].over or waiting[0][0] <= now):
            waiting[0][1].accept()
            waiting.popleft()
        if waiting:
            self._runtime.process.at(waiting[0][0], self._accept_all)

    def _expect_open(self) -> None:
        """Refuse what is new when the robot ends.

        Raises:
            Unreachable: it does.
        """
        if not self._is_open():
            raise Unreachable(key=self._runtime.key)

    def _order(self, received: Received, incoming: Incoming) -> None:
        """Take an order about calls that came before."""
        request, asker, note = received.request, received.principal, ""
        self._expect_open()
        match request:
            case Cancel(key="", epoch=epoch, reason=reason):
                if not self._runtime.look(lambda state: state.calls.live):
                    note = "it carried nothing out"
                if asker.person:
                    reason = f"{asker.person} cancelled all that {self._runtime.robot.name} did"
                order: CoreEvent = on.CancelAll(reason=reason or "on request", epoch=epoch, principal=asker)
            case Cancel(key=key, epoch=epoch, reason=reason):
                reason = reason or "on request"
                order = on.CancelAsked(key=key, reason=reason, epoch=epoch, principal=asker)
            case Attend(key=key, age=age):
                age = math.inf if math.isnan(age) else max(age, 0.0)  # no number is no key
                order = on.Attended(key=key, at=received.asked - age, principal=asker)
            case _:
                assert isinstance(request, Detach)  # noqa: S101 # see `answers`
                order = on.DetachAsked(key=request.key, epoch=request.epoch, principal=asker)
        self._runtime.post(order)
        incoming.end(encode(Done(note=note)))

    def _refuse(self, error: Exception, end: End) -> None:
        end(encode(refusal(error, self._runtime.robot.name)))


def _named(received: Received) -> Call:
    """Return a call with the name of the person who asks; what a sender says of that does not count."""
    call, principal = received.request, received.principal
    assert isinstance(call, Call)  # noqa: S101 # see `OutsideCalls.answers`
    if call.epoch is not None:  # a parent's: its name is that of the lease
        return call
    person = principal.person or (f"{principal.user}@{SCRIPT}" if is_person(call.caller) else "")
    return msgspec.structs.replace(call, caller=person) if person else call
