"""One call of a command, from the side of a program that waits for it: what its replies mean.

The replies may come in any thread. `RobotClient` waits for them on an event loop, `call_and_wait` in the
thread that calls.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from msgspec.structs import replace

from robotree.vr.base.address import Address
from robotree.vr.base.description import FieldSpec
from robotree.vr.base.errors import CommandFailed, Garbled, NoAnswer, Unreachable, VrError
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    LONGEST_CLEANUP,
    Accepted,
    Call,
    Cancel,
    Moved,
    Progress,
    Raised,
    Reply,
    Returned,
)
from robotree.vr.base.transport import Transport
from robotree.vr.exchange.asking import send_request

LOOK_AGAIN = 0.02
"""[s] after which a thread looks again whether a robot is back whose process has ended."""
NEWS = 0.5
"""[s] in which the news that a process has ended reaches the table of those who are present."""
MARGIN = LONGEST_CLEANUP + 5.0
"""[s] after the deadline in which the robot may still report how its command ended."""

OnFields = Callable[[tuple[FieldSpec, ...]], None]
"""Takes what a result is: `CommandSpec.result`."""

OnProgress = Callable[[float, str], None]
"""Takes how far a command is: 0 to 1 (NaN: unknown) and a word about it."""


class CallOutcome:
    """The state of one call for its caller: whether it was accepted, and how it ended."""

    def __init__(
        self,
        call: Call,
        robot: Address,
        on_progress: OnProgress | None = None,
        on_fields: OnFields | None = None,
    ) -> None:
        """Nothing is known yet."""
        self.call, self.robot, self._on_progress, self._on_fields = call, robot, on_progress, on_fields
        self.accepted = self.over = self.away = self.moved = False
        self.returns = 0.0
        """[s] in which the robot comes back if its process ends; 0: it does not."""
        self._value: Any = None
        self._error: VrError | None = None

    def take(self, reply: Reply | None) -> None:  # noqa: C901 # one for each reply
        """Take one reply; None: there are no more."""
        if self.over:
            return
        match reply:
            case Accepted(returns=returns):
                self.accepted, self.returns = True, returns
                self.over = self.call.oneway
            case Progress(fraction=fraction, text=text):
                if self._on_progress is not None:
                    self._on_progress(fraction, text)
            case Returned(value=value, fields=fields):
                self._value, self.over = value, True
                if self._on_fields is not None:
                    self._on_fields(fields)
            case Raised() as raised:
                error = raised.revive()
                error.entered = self.accepted
                self.fail(error)
            case Moved():
                self.moved = True
            case None if self.moved:
                self.away = True
            case None:
                self._lose_contact()
            case other:
                answer = f"{type(other).__name__} is no answer to a call"
                self.fail(Garbled(key=self.robot.key, detail=answer))

    def _lose_contact(self) -> None:
        """There are no more replies: the robot's process has ended."""
        name, command = self.robot.name, self.call.command
        if not self.accepted:
            self.fail(Unreachable(key=self.robot.key))
        elif self.returns:
            self.away = True
            if self._on_progress is not None:
                self._on_progress(math.nan, f"the process of {name} has ended; it may come back")
        else:
            detail = "it ended in the middle; look where the robot stands before you go on"
            self.fail(CommandFailed(robot=name, command=command, detail=detail))

    def fail(self, error: VrError) -> None:
        """Note that it has failed."""
        self._error, self.over = error, True

    def again(self, ends: float, now: float) -> Call:
        """Return the call as it is asked again of a robot that may be back.

        Args:
            ends: [s] when it must be done, on the clock of `now`.
            now: [s]
        """
        self.away = self.moved = False
        return replace(self.call, deadline=ends - now)

    def give_up(self) -> None:
        """Wait for the robot no longer: it did not come back in time."""
        self.returns = 0.0
        self._lose_contact()

    @property
    def longest(self) -> float:
        """[s] from now on in which the robot reports how it ended."""
        return max(0.0, self.call.deadline) + MARGIN  # NaN becomes 0; it is the robot that refuses it

    def result(self) -> Any:
        """Return the result of a call that is over.

        Raises:
            VrError: it was refused or did not succeed.
        """
        if self._error is not None:
            raise self._error
        return self._value


def call_and_wait(transport: Transport, outcome: CallOutcome, *, sender: str) -> Any:
    """Have a command carried out and wait for its result in this thread, which must be no event loop's.

    The command ends if this is interrupted (Ctrl-C).

    Args:
        transport: the way there.
        outcome: of the call.
        sender: key under which the caller is present.

    Raises:
        VrError: it was refused, did not succeed, or the robot does not answer.
    """
    call, key = outcome.call, outcome.robot.key
    news = threading.Lock()  # held while there is nothing new; the cheapest thing that a thread can wait for
    news.acquire()

    def take(reply: Reply | None) -> None:
        outcome.take(reply)
        if (outcome.over or outcome.away) and news.locked():
            news.release()

    now = time.monotonic()
    latest, ends = now + outcome.longest, now + call.deadline
    try:
        send_request(transport, key, call, take, now=now, within=ANSWER_WITHIN, sender=sender)
        while not outcome.over:
            if not news.acquire(timeout=ANSWER_WITHIN):
                left = min(latest - time.monotonic(), threading.TIMEOUT_MAX) if outcome.accepted else 0.0
                if not news.acquire(timeout=max(0.0, left)):
                    outcome.fail(
                        NoAnswer(key=key, seconds=latest - now if outcome.accepted else ANSWER_WITHIN)
                    )
                    _call_off(transport, outcome, sender)
            if outcome.away:
                back = _await_return(transport, outcome)
                now = time.monotonic()
                if back:
                    again = outcome.again(ends, now)
                    send_request(transport, key, again, take, now=now, within=ANSWER_WITHIN, sender=sender)
                else:
                    outcome.give_up()
    except BaseException:
        _call_off(transport, outcome, sender)
        raise
    return outcome.result()


def _await_return(transport: Transport, outcome: CallOutcome) -> bool:
    """Wait until a robot is back whose process has ended, as long as it said; returns whether it is."""
    presence, key = transport.presence, outcome.robot.key
    began = time.monotonic()
    while not outcome.moved and presence.there(key) and time.monotonic() < began + NEWS:
        time.sleep(LOOK_AGAIN)
    while not presence.there(key) and time.monotonic() < began + outcome.returns:
        time.sleep(LOOK_AGAIN)
    return presence.there(key)


def _call_off(transport: Transport, outcome: CallOutcome, sender: str) -> None:
    """End a call for which nobody waits any longer; it may still be on its way."""
    cancel = Cancel(key=outcome.call.key, epoch=outcome.call.epoch, reason="the caller gave up")
    send_request(
        transport,
        outcome.robot.key,
        cancel,
        lambda _: None,
        now=time.monotonic(),
        within=ANSWER_WITHIN,
        sender=sender,
        urgent=True,
    )
