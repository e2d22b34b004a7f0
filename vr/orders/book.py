"""The rules of a directory: which orders may be left, what becomes of them, and how two memories become one.

It does no input or output but that of its store, and reads no clock but the one that it is given. The service
uses it for a realm, and the command line for a memory that somebody has taken along, without any network.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from operator import attrgetter
from typing import Any, NamedTuple

import msgspec

from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.description import CommandSpec, RobotDescription, offered
from robotree.vr.base.errors import (
    BadEnd,
    NoSuchCommand,
    NoSuchOrder,
    NothingToConfirm,
    NotInDoubt,
    NotOrdered,
    NotRemembered,
    OrderOver,
)
from robotree.vr.base.order import (
    LONGEST_ORDER,
    RANK,
    KnownAgent,
    Order,
    OrderHold,
    clock_ahead,
    expect_one,
    mark_of,
    merged,
    merged_hold,
    merged_known,
    shifted,
    shifted_hold,
    shifted_known,
)
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import (
    HoldOrders,
    LeaveOrder,
    OrderOutcome,
    OrdersFound,
    ReadKnown,
    ReadOrders,
    RecordsShared,
    ReleaseHolds,
    ShareRecords,
    TellOrders,
)
from robotree.vr.orders.store import OrderStore

SHORTEST = 1.0
"""[s] in which an order must begin at least."""
LONGEST_COMMAND = 7 * 86400.0
"""[s] that an ordered command may take."""
MOST_WAITING = 10_000
"""Orders that a directory keeps."""
KEPT = 30 * 86400.0
"""[s] for which an order that is over and was taken note of is kept; twice that without."""


class OrderNews(NamedTuple):
    """Records that have changed, for the other directories."""

    orders: tuple[Order, ...] = ()
    agents: tuple[KnownAgent, ...] = ()
    holds: tuple[OrderHold, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.orders or self.agents or self.holds)


class OrderBook:
    """See the module."""

    def __init__(
        self, name: str, store: OrderStore, unix: Callable[[], float], *, owner: str = "", site: str = ""
    ) -> None:
        """Take the memory.

        Args:
            name: of the directory.
            store: with its records.
            unix: returns the time [s] since 1970.
            owner: the one who has taken it along, and whose orders are left in it; empty: it is a realm's.
            site: name of this machine in a realm of several; empty: there is one machine.
        """
        self.name, self.store, self.unix, self.owner, self.site = name, store, unix, owner, site
        self.label = f"{name}.{store.id[:4]}"
        """Its name among those that hold an order: sites may have directories of one name."""
        self._commands: dict[str, tuple[RobotDescription, frozenset[str]]] = {}
        """Names of the commands of each robot, by identity, as they were looked at last."""
        self.here: Callable[[KnownAgent], bool] = lambda _: False
        """Whether a robot is here now."""

    # -- people -----------------------------------------------------------------------------------

    def leave(self, request: LeaveOrder, principal: Principal) -> Order:
        """Check an order against what is remembered of its robot, and make the record; it is not kept yet.

        Raises:
            NotRemembered: no robot of this name is.
            SeveralRobots: several are, and none or several of them are here.
            NoSuchCommand: the robot had no such command.
            BadArgument: the arguments do not fit the command.
            NotOrdered: its author does not allow it, the robot was deleted or takes no orders, or the key is
                another order's.
            BadEnd: it has no end that can be.
        """
        known = self.store.orders.get(request.key)
        if known is not None:
            if (known.robot, known.command) != (request.robot, request.command):
                raise NotOrdered(
                    robot=request.robot, command=request.command, reason="its key is that of another order"
                )
            return known
        agent = self.robot(request.robot, request.identity)
        spec = expect_command(agent, request.command)
        arguments = check_arguments(spec, request.arguments, robot=agent.name)
        if not SHORTEST <= request.begin_within <= LONGEST_ORDER:
            raise BadEnd(seconds=request.begin_within)
        expect_orderable(agent, spec)
        open_orders = sum(not each.over for each in self.store.orders.values())
        if open_orders >= MOST_WAITING:
            reason = f"{open_orders} orders wait already"
            raise NotOrdered(robot=agent.name, command=spec.name, reason=reason)
        now = self.unix()
        return Order(
            key=request.key,
            robot=agent.name,
            identity=agent.identity,
            command=request.command,
            arguments=dict(arguments),
            who=self.owner_of(principal, request.device),
            principal=msgspec.structs.replace(principal, agent="", process=0),
            left=now - max(request.ago, 0.0),
            at=now,
            begin_by=now + request.begin_within,
            may_take=min(max(request.may_take, SHORTEST), LONGEST_COMMAND),
            mark=mark_of(spec),
            result=spec.result,
            holders=(self.label,),
        )

    def owner_of(self, principal: Principal, device: str = "") -> str:
        """Return whose inbox gets the results of what a principal orders: the same at each directory."""
        site = principal.site or self.site
        own = f"{principal.user}@{site}" if site else principal.user
        return self.owner or (f"{own}/{device}" if device else own)

    def cancel(self, key: str, by: str) -> Order:
        """Return an order as it is once somebody wants it to end; it is not kept yet.

        Raises:
            NoSuchOrder: there is none of this key.
            OrderOver: it is over.
        """
        order = self.order(key)
        if order.state == "cancelled":
            return order
        if order.over:
            advice = "its result is in `robotree inbox`" if order.state != "expired" else "nothing was done"
            raise OrderOver(key=order.ticket, robot=order.robot, state=order.shown, advice=advice)
        if order.state == "taken":
            return msgspec.structs.replace(order, cancelled_by=by)
        return msgspec.structs.replace(order, state="cancelled", at=self.unix(), cancelled_by=by)

    def confirm(self, key: str, by: str) -> Order:
        """Return an order whose robot may begin it though it asks; it is not kept yet.

        Raises:
            NoSuchOrder: there is none of this key.
            NothingToConfirm: nothing is asked.
        """
        order = self.order(key)
        if order.over or not (order.asks or order.confirmed_by):
            raise NothingToConfirm(robot=order.robot, key=order.ticket, state=order.shown)
        return msgspec.structs.replace(order, confirmed_by=by)

    def settle(self, key: str, outcome: OrderOutcome, by: str) -> Order:
        """Return an order in doubt as a person says that it ended; it is not kept yet.

        It stays so, whatever copy in doubt comes later: what is over by somebody's word is further on.

        Raises:
            NoSuchOrder: there is none of this key.
            NotInDoubt: it is not in doubt.
        """
        order = self.order(key)
        if order.state != "doubt":
            raise NotInDoubt(key=order.ticket, robot=order.robot, state=order.shown)
        now = self.unix()
        if outcome == "done":
            return msgspec.structs.replace(order, state="done", at=now, why=f"{by} says so", seen=False)
        why = f"{by} says that it was not done; order it again if it is still wanted"
        return msgspec.structs.replace(order, state="failed", at=now, why=why, seen=False)

    def seen(self, keys: Iterable[str], who: str) -> OrderNews:
        """Take note that the results of orders have been taken, of those that are `who`'s (`owner_of`)."""
        found = (self.store.orders.get(key) for key in keys)
        own = (each for each in found if each and not each.seen and f"{each.who}/".startswith(f"{who}/"))
        return self.keep(orders=[msgspec.structs.replace(each, seen=True) for each in own])

    def order(self, key: str) -> Order:
        """Return the order of a key.

        Raises:
            NoSuchOrder: there is none.
        """
        found = self.store.orders.get(key)
        if found is None:
            raise NoSuchOrder(key=key)
        return found

    def find(self, request: ReadOrders, who: str = "") -> OrdersFound:
        """Return the orders that match, the oldest first, and the holds that are in force.

        Args:
            request: what is asked.
            who: asks, as `owner_of` says.
        """
        orders = tuple(
            sorted(
                (
                    each
                    for each in self.store.orders.values()
                    if each.key.startswith(request.key)
                    and request.robot in ("", each.robot)
                    and (not request.mine or each.who == who or each.who.startswith(f"{who}/"))
                ),
                key=by_age,
            )
        )
        return OrdersFound(now=self.unix(), orders=orders, holds=self.holds())

    # -- what is remembered -----------------------------------------------------------------------

    def robot(self, name: str, identity: str = "") -> KnownAgent:
        """Return the one robot of a name that is remembered; of several the one that is here.

        Raises:
            NotRemembered: none is.
            SeveralRobots: several are.
        """
        found = [each for each in self.store.agents.values() if each.role == "robot" and each.name == name]
        if identity:
            found = [each for each in found if each.identity.startswith(identity)]
        if not found:
            raise NotRemembered(name=name)
        meant = [each for each in found if not each.deleted] or [max(found, key=lambda each: each.deleted)]
        if len(meant) > 1:
            meant = [each for each in meant if self.here(each)] or meant
        return expect_one(meant)

    def known(self, request: ReadKnown) -> list[KnownAgent]:
        """Return what is remembered, by name."""
        found: list[KnownAgent] = []
        for each in self.store.agents.values():
            if request.name not in ("", each.name):
                continue
            robot = each.robot
            if request.kind and (robot is None or request.kind not in robot.kinds):
                continue
            if request.command and (
                robot is None or request.command not in self._names(each.identity, robot)
            ):
                continue
            found.append(_brief(each) if request.brief else each)
        return sorted(found, key=lambda each: (each.role, each.name, each.identity))

    def _names(self, identity: str, robot: RobotDescription) -> frozenset[str]:
        known = self._commands.get(identity)
        if known is None or known[0] is not robot:
            known = self._commands[identity] = robot, frozenset(each.name for each in robot.commands)
        return known[1]

    def take_along(self, names: Iterable[str], who: str) -> OrderNews:
        """Take note of who takes robots along.

        Raises:
            NotRemembered: one is not known.
            SeveralRobots: several of a name are.
        """
        now, changed = self.unix(), list[KnownAgent]()
        for name in names:
            agent = self.robot(name)
            changed.append(msgspec.structs.replace(agent, taken_by={**agent.taken_by, who: now}))
        return self.keep(agents=changed)

    # -- robots -----------------------------------------------------------------------------------

    def fetch(self, identity: str) -> OrdersFound:
        """Return what a robot has to do, in the order in which it was left, and what holds it."""
        orders = tuple(
            sorted(
                (each for each in self.store.orders.values() if each.identity == identity and not each.over),
                key=by_age,
            )
        )
        holds = tuple(each for each in self.store.holds.values() if each.holds(identity))
        return OrdersFound(now=self.unix(), orders=orders, holds=holds)

    def take(self, key: str, identity: str) -> tuple[OrdersFound, OrderNews]:
        """Take note that a robot is about to begin an order, unless it is over here or the robot is held."""
        order, news = self.store.orders.get(key), OrderNews()
        held = tuple(each for each in self.store.holds.values() if each.holds(identity))
        now = self.unix()
        if order is None or order.identity != identity:
            return OrdersFound(now=now, holds=held), news
        if order.state == "waiting" and order.begin_by < now:
            order = msgspec.structs.replace(order, state="expired", at=now, why=EXPIRED)
        elif order.state == "waiting" and not held:
            order = msgspec.structs.replace(order, state="taken", at=now)
        news = self.keep(orders=[order])
        return OrdersFound(now=now, orders=(order,), holds=held), news

    def tell(self, request: TellOrders) -> tuple[OrdersFound, OrderNews]:
        """Take how a robot's orders fare; returns the copies here that are further on."""
        by, now = clock_ahead(self.unix(), request.now), self.unix()
        told = [shifted(each, by) for each in request.orders]
        news = self.keep(orders=told)
        mine = [self.store.orders[each.key] for each in told]
        ahead = tuple(m for m, each in zip(mine, told, strict=True) if _is_ahead(m, each))
        return OrdersFound(now=now, orders=ahead), news

    def deleted(self, identity: str) -> OrderNews:
        """Take note that a robot was deleted; what waits for it is refused."""
        agent, now = self.store.agents.get(identity), self.unix()
        agents = [] if agent is None or agent.deleted else [msgspec.structs.replace(agent, deleted=now)]
        orders = [
            msgspec.structs.replace(each, state="refused", at=now, why=f"{each.robot} was deleted")
            for each in self.store.orders.values()
            if each.identity == identity and each.state == "waiting"
        ]
        return self.keep(orders=orders, agents=agents)

    # -- holds ------------------------------------------------------------------------------------

    def holds(self) -> tuple[OrderHold, ...]:
        """Return the holds that are in force, the oldest first."""
        return tuple(
            sorted(
                (each for each in self.store.holds.values() if not each.released), key=lambda each: each.at
            )
        )

    def hold(self, request: HoldOrders, by: str) -> OrderNews:
        """Keep robots from beginning what was ordered.

        Raises:
            NotRemembered: no robot of this name is known.
        """
        now = self.unix()
        if not request.robot and request.id in self.store.holds:
            return OrderNews()
        if not request.robot:
            return self.keep(holds=[OrderHold(id=request.id, by=by, at=now)])
        meant = [
            each
            for each in self.store.agents.values()
            if each.role == "robot" and each.name == request.robot and not each.deleted
        ]
        if not meant:
            raise NotRemembered(name=request.robot)
        meant = [each for each in meant if f"{request.id}-{each.identity}" not in self.store.holds]
        return self.keep(
            holds=[
                OrderHold(
                    id=f"{request.id}-{each.identity}",
                    identity=each.identity,
                    robot=each.name,
                    by=by,
                    at=now,
                )
                for each in meant
            ]
        )

    def release(self, request: ReleaseHolds, by: str) -> OrderNews:
        """Let robots begin again; holds that came after the person gave it stay."""
        now, changed = self.unix(), list[OrderHold]()
        given = now - max(request.ago, 0.0)
        names = {
            each.identity: each.name for each in self.store.agents.values() if each.name == request.robot
        }
        for hold in self.holds():
            if hold.at > given:
                continue
            if not request.robot or (hold.identity and hold.robot == request.robot):
                changed.append(msgspec.structs.replace(hold, released=now, released_by=by))
            elif not hold.identity:
                freed = tuple(sorted({*hold.freed, *names}))
                changed.append(msgspec.structs.replace(hold, freed=freed))
        return self.keep(holds=changed)

    # -- two memories that become one -------------------------------------------------------------

    def share(self, request: ShareRecords) -> tuple[RecordsShared, OrderNews]:
        """Take what another directory has; returns what is further on here, and what was news."""
        by = clock_ahead(self.unix(), request.now)
        orders = [shifted(each, by) for each in request.orders]
        agents = [shifted_known(each, by) for each in request.agents]
        holds = [shifted_hold(each, by) for each in request.holds]
        news = self.keep(orders=orders, agents=agents, holds=holds)
        store = self.store
        more = RecordsShared(
            now=self.unix(),
            orders=tuple(order for each in orders if (order := store.orders[each.key]) != each),
            agents=tuple(agent for each in agents if (agent := store.agents[each.identity]) != each),
            holds=tuple(hold for each in holds if (hold := store.holds[each.id]) != each),
        )
        return more, news

    def keep(
        self,
        orders: Iterable[Order] = (),
        agents: Iterable[KnownAgent] = (),
        holds: Iterable[OrderHold] = (),
    ) -> OrderNews:
        """Merge records into the memory, in one transaction; returns those that have changed it.

        Raises:
            DirectoryUnusable: nothing was kept.
        """
        store = self.store
        news = OrderNews(
            tuple(_changed(orders, store.orders, attrgetter("key"), merged)),
            tuple(_changed(agents, store.agents, attrgetter("identity"), merged_known)),
            tuple(_changed(holds, store.holds, attrgetter("id"), merged_hold)),
        )
        if news:
            store.put(*news)
        return news

    def sweep(self) -> OrderNews:
        """Have orders expire, and forget old ones."""
        now = self.unix()
        expired = [
            msgspec.structs.replace(each, state="expired", at=now, why=EXPIRED)
            for each in self.store.orders.values()
            if each.state == "waiting" and each.begin_by < now
        ]
        old = [
            each.key
            for each in self.store.orders.values()
            if each.over and each.begin_by + each.may_take + (KEPT if each.seen else 2 * KEPT) < now
        ]
        if old:
            self.store.put(forget=old)
        return self.keep(orders=expired)


EXPIRED = "its robot did not begin it in time"
"""Why an order has expired."""


def by_age(order: Order) -> tuple[float, str]:
    """Sort orders by when they were left."""
    return order.left, order.key


def described(agent: KnownAgent) -> RobotDescription:
    """Return the description of a robot that is remembered.

    Raises:
        NotRemembered: it is a view.
    """
    if agent.robot is None:
        raise NotRemembered(name=agent.name)
    return agent.robot


def expect_command(agent: KnownAgent, command: str) -> CommandSpec:
    """Return a command of a robot that is remembered.

    Raises:
        NoSuchCommand: it had none of this name.
    """
    robot = described(agent)
    spec = robot.command(command)
    if spec is None:
        known = offered((each.name for each in robot.commands), command)
        raise NoSuchCommand(robot=agent.name, command=command, known=known)
    return spec


def expect_orderable(agent: KnownAgent, spec: CommandSpec) -> None:
    """Refuse an order that nobody could carry out.

    Raises:
        NotOrdered: the author does not allow it, the robot was deleted, or has no identity.
    """
    reason = ""
    if agent.deleted:
        reason = f"{agent.name} was deleted"
    elif spec.offline != "queue":
        reason = 'its author does not allow it (`@command(offline="queue")`)'
    elif not described(agent).identity:
        reason = f"{agent.name} forgets with its process which orders it has begun"
    if reason:
        raise NotOrdered(robot=agent.name, command=spec.name, reason=reason)


def _brief(agent: KnownAgent) -> KnownAgent:
    robot = agent.robot
    if robot is not None:
        robot = msgspec.structs.replace(robot, commands=(), slots=(), kept={}, calls={})
    return msgspec.structs.replace(agent, robot=robot, picture=b"", answers={})


def _changed(
    given: Iterable[Any], known: Mapping[str, Any], key: Callable[[Any], str], merge: Any
) -> list[Any]:
    """Return the records that change what is known, as they are then; several of one key count together."""
    found: dict[str, Any] = {}
    for each in given:
        before = found.get(key(each), known.get(key(each)))
        after = each if before is None else merge(before, each)
        if after != before:
            found[key(each)] = after
    return list(found.values())


def _is_ahead(mine: Order, other: Order) -> bool:
    return RANK[mine.state] > RANK[other.state] or (
        bool(mine.cancelled_by or mine.confirmed_by)
        and (mine.cancelled_by, mine.confirmed_by) != (other.cancelled_by, other.confirmed_by)
    )
