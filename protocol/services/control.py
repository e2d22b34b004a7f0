"""Operator control, the controlled side: the lease as MAVLink's ground stations know it.

One system is in control at a time (REQUEST_OPERATOR_CONTROL requests and releases it, CONTROL_STATUS reports
it to all). While no system is in control, any may command. An owner that allows take-over loses control to
the next requester; another owner is told of the request and decides. An owner that is silent loses control.
Questions and stops are allowed to all.

Every peer on a link is a client, also one with the system id of the controlled system: parts of that system
do not speak over a link.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import (
    CommandLong,
    ControlStatus,
    GcsControlStatusFlags,
    MavCmd,
    MavResult,
)
from robotree.protocol.services.command import Answer
from robotree.protocol.services.peer import Peer, Send

if TYPE_CHECKING:
    from robotree.protocol.services.command import Request

PERIOD = 1.0
"""[s] between two CONTROL_STATUS."""
SHORTEST_TIMEOUT, LONGEST_TIMEOUT = 3.0, 60.0
"""[s] for which the owner is asked."""


class ControlChanged(msgspec.Struct, frozen=True):
    """Somebody else is in control; None: nobody."""

    owner: Peer | None


ControlEffect = Send | ControlStatus | ControlChanged
"""A `ControlStatus` is for everyone, on all links."""


SILENCE = 3.0
"""An owner who is not heard for so long loses control, [s]."""


class OperatorControl:
    """The station that is in control of one system."""

    def __init__(self) -> None:
        self.owner: Peer | None = None
        self._takeover = False
        self._heard = 0.0
        self._asked = float("-inf")
        self._due = float("-inf")
        self._waiting: list[ControlEffect] = []

    @property
    def status(self) -> ControlStatus:
        """The station in control, as everyone is told."""
        flags = GcsControlStatusFlags.SYSTEM_MANAGER
        if self._takeover or self.owner is None:
            flags |= GcsControlStatusFlags.TAKEOVER_ALLOWED
        return ControlStatus(flags, self.owner.system if self.owner is not None else 0)

    def may(self, peer: Peer) -> bool:
        """Whether a peer may command now."""
        return self.owner is None or peer == self.owner

    def handle(self, request: Request, now: float) -> Answer:
        """Carry out REQUEST_OPERATOR_CONTROL. For `CommandServer(always=…)`; then call `tick`."""
        peer, wanted = request.peer, request.param(4)
        if isfinite(wanted) and int(wanted) not in (0, peer.system):
            return Answer(MavResult.DENIED)
        if request.param(1) < 1:
            if peer == self.owner:
                self._give(None, takeover=False, now=now)
            return Answer(MavResult.ACCEPTED)
        if self.owner in (None, peer) or self._takeover:
            self._give(peer, takeover=request.param(2) >= 1, now=now)
            return Answer(MavResult.ACCEPTED)
        self._ask_owner(request, now)
        return Answer(MavResult.FAILED)

    def heard(self, peer: Peer, now: float) -> None:
        """Note a sign of life."""
        if peer == self.owner:
            self._heard = now

    def link_closed(self, via: object, now: float) -> None:
        """A link ended; an owner on it is gone. Then call `tick`."""
        if self.owner is not None and self.owner.via == via:
            self._give(None, takeover=False, now=now)

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]."""
        if self._waiting:
            return -inf
        return self._due if self.owner is None else min(self._due, self._heard + SILENCE)

    def hurry(self) -> None:
        """Tell everyone at the next `tick`."""
        self._due = -inf

    def tick(self, now: float) -> list[ControlEffect]:
        """Return the changes, and the status when its time has come."""
        if self.owner is not None and now >= self._heard + SILENCE:
            self._give(None, takeover=False, now=now)
        effects, self._waiting = self._waiting, []
        if effects or now >= self._due:
            self._due = now + PERIOD
            effects.append(self.status)
        return effects

    def _give(self, owner: Peer | None, *, takeover: bool, now: float) -> None:
        if owner != self.owner:
            self._waiting.append(ControlChanged(owner))
        elif takeover != self._takeover:
            self._due = now
        self.owner, self._takeover, self._heard = owner, takeover, now

    def _ask_owner(self, request: Request, now: float) -> None:
        """Tell the owner that somebody wants control; not more often than the answer may take."""
        timeout = min(max(request.param(3), SHORTEST_TIMEOUT), LONGEST_TIMEOUT)
        if self.owner is None or now - self._asked < timeout:
            return
        self._asked = now
        wish = CommandLong(
            target_system=self.owner.system,
            target_component=self.owner.component,
            command=MavCmd.REQUEST_OPERATOR_CONTROL,
            confirmation=0,
            param1=1.0,
            param2=request.param(2),
            param3=timeout,
            param4=float(request.peer.system),
            param5=0.0,
            param6=0.0,
            param7=0.0,
        )
        self._waiting.append(Send(wish, self.owner.via))
