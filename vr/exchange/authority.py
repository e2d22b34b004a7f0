"""The rights of askers: the one place that decides for every request that comes from another program.

Without a policy everybody of this system's user may ask for everything, so may each member of the realm from
its own machine. With one (`vr/base/policy.py`) each request needs a right, see `NEEDS`; a new request joins
with one line there. In both cases a parent speaks for itself alone. That a lease belongs to its holder,
`GrantedLease.check` decides, together with the change that the request makes.

What a process asks for nobody, neither at a terminal nor in a program of a person, is the work of this
user's agents: hosts renew bonds, proxies are listed. The policy does not limit the agents of the user to whom
the asked process belongs; it could not, since that user can change both. Those of other users and other sites
need rights like persons.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple, NoReturn

import msgspec

from robotree.vr.base import requests as req
from robotree.vr.base.address import user_of
from robotree.vr.base.errors import Denied, NotAllowed, NotPermitted
from robotree.vr.base.permissions import Permissions
from robotree.vr.base.permit import PermittedCall
from robotree.vr.base.policy import ASK, BY_NAME, OPEN, REALM, STOP, Person, PolicyGate, PolicyTarget
from robotree.vr.base.principal import ITSELF, Principal, user_name
from robotree.vr.core.machine import RobotState

OF_LEASES = (req.Petition, req.Retract, req.Renew, req.Release)
"""Requests in the name of a parent: whether they are allowed depends on the state of the robot."""

MEMBER: Final = "member"
"""Instead of a right: anybody may ask, and the answer has only what the asker may see; only who is named in
the policy may have anything listed."""

ANYBODY: Final = "anybody"
"""Instead of a right: it only ends what the asker itself has begun."""

AGENTS: Final = "agents"
"""Instead of a right: robots, hosts and directories ask it of each other. They are believed
in what they say of others, so those of another user or site must be allowed to administrate the realm."""

NEEDS: Final[Mapping[type[req.AnyRequest], str]] = {
    req.SafeStop: STOP, req.HoldOrders: STOP,
    req.Describe: "see", req.ReadLog: "see", req.DescribeView: "see", req.Look: "see",
    req.DescribeSpace: "see", req.WatchEntries: "see", req.VerifyEvents: "see", req.ReadBundle: "see",
    req.DescribeHost: MEMBER, req.ReadHistory: MEMBER, req.ReadEvents: MEMBER, req.Query: MEMBER,
    req.Register: MEMBER, req.DescribeGateway: MEMBER, req.LeaveOrder: MEMBER, req.CancelOrder: MEMBER,
    req.ConfirmOrder: MEMBER, req.ReadOrders: MEMBER, req.MarkSeen: MEMBER, req.ReadKnown: MEMBER,
    req.TakeAlong: MEMBER, req.ReleaseHolds: MEMBER,
    req.Attend: ANYBODY, req.GiveUp: ANYBODY, req.RollBack: ANYBODY, req.Retract: ANYBODY,
    req.AskMove: ANYBODY,
    req.SetControl: "command", req.Call: "command", req.Detach: "command", req.Cancel: "command",
    req.Decide: "command", req.Pause: "command", req.TakeStep: "command", req.Continue: "command",
    req.Enslave: "command", req.Petition: "command", req.Renew: "command", req.WriteEntry: "command",
    req.FindEntries: "command", req.RenewEntry: "command", req.OpenTransaction: "command",
    req.CloseTransaction: "command", req.AcquireFence: "command", req.RenewFence: "command",
    req.Disturb: "command",
    req.Free: "release", req.Delete: "release", req.Release: "release",
    req.Resume: "resume",
    req.Create: "create", req.Reload: "create", req.Drain: "create", req.PrepareMove: "create",
    req.TakeRobot: "create",
    req.Migrate: "migrate", req.SetPlacement: "migrate",
    req.FetchOrders: AGENTS, req.TakeOrder: AGENTS, req.TellOrders: AGENTS, req.RobotDeleted: AGENTS,
    req.ShareRecords: AGENTS,
}  # fmt: skip
"""The right that each request needs."""


class RobotThere(NamedTuple):
    """What a host knows of one of its robots."""

    kinds: tuple[str, ...]
    children: tuple[tuple[str, tuple[str, ...]], ...]
    """That it holds: name and kinds."""


class Here(NamedTuple):
    """The agent that is asked."""

    role: str = "robot"
    name: str = ""
    gate: PolicyGate = OPEN
    kinds: Callable[[], tuple[str, ...]] = tuple
    robot: Callable[[str], RobotThere | None] = lambda _: None
    """Of a host: its robot of a name."""

    def target(self, command: str = "") -> PolicyTarget:
        """Return it as a policy names it."""
        return PolicyTarget(self.name, self.role, self.kinds(), command, self.gate.site)


ANYWHERE: Final = Here()


OF_PEOPLE = (
    *(
        req.Create,
        req.Reload,
        req.Enslave,
        req.Free,
        req.Delete,
        req.Decide,
        req.Resume,
        req.Pause,
        req.TakeStep,
        req.Continue,
    ),
    *(req.SetPlacement, req.SetControl, req.Disturb),
)
"""Requests that shape the tree, or decide something: no page of somebody else makes them."""


def expect_permitted(asker: str, may: Permissions, request: req.AnyRequest, kinds: Iterable[str]) -> None:
    """Refuse a request that the manifest of the asker's page does not permit.

    Args:
        asker: its name.
        may: what the page may do.
        request: what is asked.
        kinds: of the robot that is asked.

    Raises:
        NotPermitted: it may not.
    """
    if isinstance(request, req.Call) and not may.may_call(kinds, request.command):
        raise NotPermitted(robot=asker, what=f"call {next(iter(kinds), '*')}.{request.command}")
    if isinstance(request, OF_PEOPLE):
        raise NotPermitted(robot=asker, what=f"ask for {type(request).__name__}")


def authorise(
    principal: Principal, request: req.AnyRequest, state: RobotState | None, here: Here = ANYWHERE
) -> None:
    """Refuse a request that its principal may not make.

    Args:
        principal: who asks.
        request: what is asked.
        state: of the robot that is asked; None: another agent is asked, or it does not matter.
        here: the agent that is asked, and the policy.

    Raises:
        NotAllowed: the principal may not ask for this.
        Denied: the policy does not allow it.
    """
    gate = here.gate
    shared = gate.owner is not None and gate.closed  # with other users of this machine, limited by its policy
    if not principal.site and principal.user != user_name(os.geteuid()) and not shared:
        reason = f"the processes of this realm belong to {user_name(os.geteuid())}"
        raise NotAllowed(who=principal.person or principal.user, what=type(request).__name__, reason=reason)
    if is_limited(principal, gate):
        _keep_to_policy(principal, request, state, here)
    if isinstance(request, req.PrepareMove) and request.asker is not None and gate.closed:
        _expect(gate, request.asker, "create", here.target())
    if not isinstance(request, OF_LEASES):
        return
    lease = None if state is None else state.lease.current
    away = isinstance(request, req.Release) and lease is not None and lease.away
    if request.parent.key != principal.agent and not (away and principal.person):  # a person frees a child
        reason = f"it speaks for {request.parent.name} and is not {request.parent.name}"
        who = principal.agent or f"process {principal.process}"
        raise NotAllowed(who=who, what=type(request).__name__, reason=reason)
    if isinstance(request, req.Petition) and request.asker is not None and gate.closed:
        _expect(gate, request.asker, "command", here.target())


def expect_right(principal: Principal, right: str, target: PolicyTarget, gate: PolicyGate) -> None:
    """Check a right of somebody on an agent of which the asked one only knows.

    Args:
        principal: who asks, or has asked.
        right: that is needed.
        target: the agent.
        gate: the policy.

    Raises:
        Denied: the policy does not allow it.
    """
    if is_limited(principal, gate):
        _expect(gate, gate.asker(principal), right, target)


def expect_still(principal: Principal, command: str, here: Here, right: str = "command") -> None:
    """Check that a command may go on whose asker was allowed to have it carried out.

    Args:
        principal: who has asked for it.
        command: its name.
        here: the robot.
        right: by which it has begun.

    Raises:
        Denied: the policy of now does not allow it.
    """
    if principal != ITSELF and is_limited(principal, here.gate):
        asker, target = here.gate.asker(principal), here.target(command)
        if not (asker.assistant and here.gate.may(asker, ASK, target).allowed):
            _expect(here.gate, asker, right, target)


def is_limited(principal: Principal, gate: PolicyGate) -> bool:
    """Whether a policy limits who asks; an assistant is limited also where there is none."""
    own = not principal.site and not principal.terminal and principal.user == user_name(os.geteuid())
    return (gate.closed or principal.assistant != "") and not own  # what this user's agents ask for no person


def _keep_to_policy(
    principal: Principal, request: req.AnyRequest, state: RobotState | None, here: Here
) -> None:
    gate, asker, right = here.gate, here.gate.asker(principal), NEEDS[type(request)]
    if right == AGENTS:
        _expect(gate, asker, "administrate", PolicyTarget("", REALM))
        return
    if right in (STOP, ANYBODY) or _ends_its_own(principal, request, state):
        return
    if right == MEMBER:
        if isinstance(request, req.Register) and (gate.policy is None or not gate.policy.names(asker)):
            _refuse(gate, asker, "see", here.target())
        if isinstance(request, req.Register) and gate.owner is not None and not principal.site:
            _expect_to_list_its_own(principal, request, gate.owner)
        return
    right = _right_for(request, right)
    target = here.target(request.command if isinstance(request, req.Call) else "")
    if isinstance(request, req.Migrate):
        robot = here.robot(request.robot)
        target = PolicyTarget(request.robot, "robot", () if robot is None else robot.kinds, "", gate.site)
    if isinstance(request, req.Call) and asker.assistant and not gate.may(asker, right, target).allowed:
        _expect(gate, asker, ASK, target)
        gate.expect_permit(asker, _permitted(principal, request, state, here))
        return
    _expect(gate, asker, right, target)
    if isinstance(request, req.Reload):
        _expect_to_reload(gate, asker, request.page.name, here)


def _right_for(request: req.AnyRequest, right: str) -> str:
    """Return the right that a request needs, whose class needs this one."""
    match request:
        case req.FindEntries(take=False):
            return "see"
        case req.SetControl(what="take"):
            return "take"
        case _:
            return right


def _expect_to_list_its_own(principal: Principal, request: req.Register, owner: int) -> None:
    """In a shared realm nobody lists, or takes from a list, an agent of another user."""
    listed = [one.address.key for one in request.listings] + [one.key for one, _ in request.withdrawn]
    for key in listed:
        user = user_of(key)
        if principal.user not in (user_name(owner), "" if user is None else user_name(user)):
            reason = f"{key} is no agent of this user"
            raise NotAllowed(who=principal.user, what="Register", reason=reason)


def _permitted(principal: Principal, call: req.Call, state: RobotState | None, here: Here) -> PermittedCall:
    life = state.address.key if state is not None else ""
    stops = state.stop.generation if state is not None else -1
    believed = principal.site or here.gate.apart  # its gateway, or the host, puts it in, and nobody else
    vouched = call.vouched if believed and call.permit else None
    return PermittedCall(call.permit, life, stops, call.command, call.arguments, call.key, vouched)


def _ends_its_own(principal: Principal, request: req.AnyRequest, state: RobotState | None) -> bool:
    """Whether a request only ends what its principal has begun: a call, or its own lease."""
    if isinstance(request, req.Release):
        return request.parent.key == principal.agent
    if isinstance(request, req.SetControl):
        return request.what == "leave"
    if not isinstance(request, req.Cancel) or not request.key or state is None:
        return False
    call = state.calls.live.get(request.key)
    return call is not None and call.principal == principal


def _expect_to_reload(gate: PolicyGate, asker: Person, name: str, here: Here) -> None:
    """Another page commands the children of its robot: it needs the right to command them, too."""
    robot = here.robot(name)
    if robot is None:
        return  # there is nothing to reload
    _expect(gate, asker, "command", PolicyTarget(name, "robot", robot.kinds, "", gate.site))
    for child, kinds in robot.children:  # it may be at another site: a pattern that names one does not fit
        _expect(gate, asker, "command", PolicyTarget(child, "robot", kinds))


def _expect(gate: PolicyGate, asker: Person, right: str, target: PolicyTarget) -> None:
    if not gate.may(asker, right, target).allowed:
        _refuse(gate, asker, right, target)


def _refuse(gate: PolicyGate, asker: Person, right: str, target: PolicyTarget) -> NoReturn:
    reason = gate.may(asker, right, target).reason
    raise Denied(who=str(asker), right=right, target=str(target), reason=reason, ask=gate.ask)


_SEEN = BY_NAME["see"].roles


# -- what an answer shows --------------------------------------------------------------------------


def shown(reply: req.Reply, principal: Principal, here: Here) -> req.Reply:  # noqa: PLR0911 # one for each
    """Return an answer without the robots that its asker may not see."""
    gate = here.gate
    if not is_limited(principal, gate):
        return reply
    asker = gate.asker(principal)

    def sees(name: str, kinds: tuple[str, ...] = (), role: str = "robot") -> bool:
        known = here.robot(name) if role == "robot" and not kinds else None
        found = kinds if known is None else known.kinds
        if (role, name) == (here.role, here.name):
            found = here.kinds()
        return gate.may(asker, "see", PolicyTarget(name, role, found, "", gate.site)).allowed

    replace = msgspec.structs.replace
    match reply:
        case req.Found(listings=listings):
            return replace(
                reply,
                listings=tuple(
                    one
                    for one in listings
                    if sees(one[0].address.name, tuple(one[0].kinds), one[0].address.role)
                ),
            )
        case req.HostDescribed(robots=robots):
            kept = tuple(one for one in robots if sees(one.name))
            names = {one.name for one in kept}
            pages = {name: page for name, page in reply.pages.items() if name in names}
            abandoned = tuple(one for one in reply.abandoned if one.partition(".")[0] in names)
            return replace(reply, robots=kept, pages=pages, abandoned=abandoned)
        case req.History(lines=lines):
            return replace(
                reply, lines=tuple(one for one in lines if any(sees(one.name, (), role) for role in _SEEN))
            )
        case req.OrdersFound(orders=orders):
            return replace(reply, orders=tuple(one for one in orders if sees(one.robot)))
        case req.KnownFound(agents=agents):
            kept_agents = tuple(
                one
                for one in agents
                if sees(one.name, () if one.robot is None else one.robot.kinds, one.role)
            )
            return replace(reply, agents=kept_agents)
        case req.EventsRead(events=events):
            return replace(reply, events=tuple(one for one in events if sees(one.event.robot)))
        case _:
            return reply
