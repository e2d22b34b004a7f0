"""A robot apart that is given up: its host answers for it, so that people see why, and can delete it.

There is no process that could. It is as it described itself first, and carries nothing out.
"""

from __future__ import annotations

import asyncio
from typing import Any

import msgspec

from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import GivenUp
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.requests import Accepted, Delete, Describe, Described, Done, Reply, SafeStop
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.dispatcher import Dispatcher, SendReply

_SHARED = ("address", "kinds", "doc", "host", "attributes")


class GivenUpRobot:
    """See the module. Lives on the event loop."""

    def __init__(self, robot: RobotDescription, error: GivenUp, gate: PolicyGate) -> None:
        """Take how it was, why it is given up, and the policy that counts for it."""
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
                return Done()  # nothing of it moves
            case Delete():
                self.deleted.set()
                return Done()
            case _:
                raise self.error
