"""The rights of askers: the one place that decides for every request that comes from another program.

Today the policy is short: everybody of this system's user may ask for everything, so may each member of the
realm from its own machine, and a parent speaks for itself alone. That a lease belongs to its holder,
`GrantedLease.check` decides, together with the change that the request makes.
"""

from __future__ import annotations

import os

from robotree.vr.base.errors import NotAllowed
from robotree.vr.base.principal import Principal, user_name
from robotree.vr.base.requests import AnyRequest, Petition, Release, Renew, Retract
from robotree.vr.core.machine import RobotState

OF_LEASES = (Petition, Retract, Renew, Release)
"""Requests in the name of a parent: whether they are allowed depends on the state of the robot."""


def authorise(principal: Principal, request: AnyRequest, state: RobotState | None) -> None:
    """Refuse a request that its principal may not make.

    Args:
        principal: who asks.
        request: what is asked.
        state: of the robot that is asked; None: another agent is asked, or it does not matter.

    Raises:
        NotAllowed: the principal may not ask for this.
    """
    if not principal.site and principal.user != user_name(os.geteuid()):
        reason = f"the processes of this realm belong to {user_name(os.geteuid())}"
        raise NotAllowed(who=principal.person or principal.user, what=type(request).__name__, reason=reason)
    if not isinstance(request, OF_LEASES):
        return
    lease = None if state is None else state.lease.current
    away = isinstance(request, Release) and lease is not None and lease.away
    if request.parent.key != principal.agent and not (away and principal.person):  # a person frees a child
        reason = f"it speaks for {request.parent.name} and is not {request.parent.name}"
        who = principal.agent or f"process {principal.process}"
        raise NotAllowed(who=who, what=type(request).__name__, reason=reason)
