"""A robot apart that is given up: its host answers for it, so that people see why, and can delete it.

There is no process that could. It is as it described itself first, and carries nothing out. What it did goes
on when its host is started again, so a stop and a cancel are kept for that before they are confirmed.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import msgspec

from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import GivenUp, NotConfirmed
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.requests import Accepted, Cancel, Delete, Describe, Described, Done, Reply, SafeStop
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.dispatcher import Dispatcher, SendReply

_SHARED = ("address", "kinds", "doc", "host", "attributes")


class GivenUpRobot:
    """See the module. Lives on the event loop."""

    def __init__(
        self,
        robot: RobotDescription,
        error: GivenUp,
        gate: PolicyGate,
        leave_order: Callable[[SafeStop | Cancel], None],
    ) -> None:
        """Begin to answer.

        Args:
            robot: how it was.
            error: why it is given up.
            gate: the policy that counts for it.
            leave_order: keeps an order for its next process; raises OSError if that cannot be.
        """
        self._leave_order = leave_order
        why = "given up: its page has ended its process {times} times ({how}); delete it, or restart {host}"
        said = {**robot.attributes, "condition": why.format(**error.data)}
        bare: dict[str, Any] = {"slots": (), "bond": None, "busy": "", "waiting": 0, "readings": {}}
        self.description = msgspec.structs.replace(robot, online=False, attributes=said, **bare)
        self.error = error
        self.deleted = asyncio.Event()
        here = Here("robot", robot.name, gate, lambda: robot.kinds)
        now = asyncio.get_running_loop().time
        self.take = Dispatcher(robot.name, self._answer, now=now, here=here).take

    @property
    def listing(self) -> Listing:
        """How lookup services hold it."""
        return Listing(**{name: getattr(self.description, name) for name in _SHARED})

    def _answer(self, received: Received, send: SendReply) -> Reply:
        match received.request:
            case Describe():
                return Described(robot=self.description)
            case SafeStop(order=order):
                send(Accepted(key=order))
                self._leave(received.request, "the protective stop")
                reason = received.request.reason or "protective stop"
                self.description = msgspec.structs.replace(self.description, stopped=True, stop_reason=reason)
                return Done()
            case Cancel():
                self._leave(received.request, "the cancel")
                return Done()
            case Delete():
                self.deleted.set()
                return Done()
            case _:
                raise self.error

    def _leave(self, order: SafeStop | Cancel, called: str) -> None:
        name, host = self.description.name, self.error.data["host"]
        try:
            self._leave_order(order)
        except OSError as error:
            why = f"nothing of it moves now, but it goes on when {host} is started again: {error.strerror}"
            advice = [f"make room in the folder of {host}, or delete {name}", "order it again"]
            raise NotConfirmed(order=called, told=[], untold=[[name, why]], advice=advice) from None
