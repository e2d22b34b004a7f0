"""Orders for robots, and what is remembered of a robot that is away: the records that directories exchange.

Of two copies of a record the one that is further on wins, whichever way and in whichever order they meet:
`merged` is commutative, associative and idempotent. So directories that were apart agree after one exchange.

    waiting < cancelled | expired < taken < refused < doubt < done | failed

Pure.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import msgspec

from robotree.vr.base.address import Role, everyone
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription
from robotree.vr.base.errors import NoSuchOrder, SeveralOrders, SeveralRobots, ShortTicket
from robotree.vr.base.principal import Principal

OrderState = Literal["waiting", "cancelled", "expired", "taken", "refused", "doubt", "done", "failed"]
"""taken: the robot has it. refused: it did not begin, and will not. doubt: it may have been carried out."""

RANK: Mapping[OrderState, int] = {
    "waiting": 0,
    "cancelled": 1,
    "expired": 1,
    "taken": 2,
    "refused": 3,
    "doubt": 4,
    "done": 5,
    "failed": 5,
}
"""Of two states that of the higher rank is true: what the robot says outranks what a directory says."""

OPEN: frozenset[OrderState] = frozenset({"waiting", "taken"})
"""States of an order that can still move its robot."""

SAME_CLOCK = 2.0
"""[s] by which two clocks may differ and still count as one: the way of a message takes some time, too."""

DIRECTORIES = everyone("directory")
"""Presence pattern of all directories."""
ORDER_NEWS = f"{DIRECTORIES}/orders"
"""Under which directories publish for whom orders have changed; not which."""

SHORTEST_TICKET = 4
"""Letters of a key that a person must write: one letter easily names an order that nobody meant."""

LONGEST_ORDER = 30 * 86400.0
"""[s] that an order may wait: every order has an end, for a robot forgets at some time what it has done."""

_encode = msgspec.msgpack.Encoder(order="sorted").encode


class Order(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One command that a robot is to carry out once, when it is there and free. Times are [s] since 1970."""

    key: str
    """Of the call that the robot makes of it; people call it the ticket."""
    robot: str
    """Name of the robot."""
    identity: str = ""
    """Which robot of this name: see `RobotDescription.identity`."""
    command: str
    arguments: dict[str, Any] = {}
    who: str = ""
    """The one whose inbox gets the result: a user, `anna@lab` from a site."""
    principal: Principal = Principal()
    """On whose rights it is carried out."""
    left: float = 0.0
    begin_by: float = 0.0
    """When it expires, if it has not begun."""
    may_take: float = 60.0
    """[s] that it may take from its beginning on."""
    mark: str = ""
    """`mark_of` the command as it was when the order was left."""
    state: OrderState = "waiting"
    at: float = 0.0
    """When it got into its state."""
    why: str = ""
    """Why it was refused, failed or is in doubt, as a sentence; what it waits for."""
    value: Any = None
    """The result."""
    result: tuple[FieldSpec, ...] = ()
    """What the result is."""
    seen: bool = False
    """Whether its owner has taken the result."""
    cancelled_by: str = ""
    """The one who wants it to end; the robot decides that if it has it already."""
    asks: str = ""
    """The question of its robot to a person before it begins; empty: none."""
    confirmed_by: str = ""
    """The one who has answered that question with yes."""
    holders: tuple[str, ...] = ()
    """Names of the directories that may have a copy of it."""

    @property
    def over(self) -> bool:
        """Whether it cannot move its robot any more."""
        return self.state not in OPEN

    @property
    def ticket(self) -> str:
        """The beginning of its key, for people."""
        return self.key[:8]

    @property
    def shown(self) -> str:
        """Its state in a word, for people."""
        if self.state == "refused" and self.cancelled_by:
            return "cancelled"
        return {"doubt": "in doubt"}.get(self.state, self.state)


class KnownAgent(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What is remembered of a robot or a view. Times are [s] since 1970."""

    role: Role = "robot"
    name: str
    identity: str
    robot: RobotDescription | None = None
    """The last description of it; None: it is a view."""
    described: float = 0.0
    readings: dict[str, float] = {}
    read: float = 0.0
    online: bool = True
    """Whether its controller was there."""
    picture: bytes = b""
    """The last picture, a JPEG."""
    pictured: float = 0.0
    answers: dict[str, tuple[float, Any]] = {}
    """The last results of commands that only read and may be remembered, with their times."""
    seen: float = 0.0
    """When it was seen last."""
    deleted: float = 0.0
    """When it was deleted: it never comes back; 0: it was not."""
    taken_by: dict[str, float] = {}
    """Who has taken it along, and when."""


class OrderHold(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A protective stop that holds for robots which are away, until a person releases it.

    Nothing that waits in a directory begins while it is in force.
    """

    id: str
    identity: str = ""
    """Of the robot that it holds; empty: all robots."""
    robot: str = ""
    """Name of that robot."""
    by: str = ""
    at: float = 0.0
    """[s] since 1970."""
    released: float = 0.0
    """When it was released; 0: it is in force."""
    released_by: str = ""
    freed: tuple[str, ...] = ()
    """Identities of robots for which a person has released it alone."""

    def holds(self, identity: str) -> bool:
        """Whether it keeps a robot from beginning what was ordered."""
        return not self.released and self.identity in ("", identity) and identity not in self.freed


def expect_ticket(ticket: str) -> None:
    """Refuse a ticket that is too short to be meant.

    Raises:
        ShortTicket: it is.
    """
    if len(ticket) < SHORTEST_TICKET:
        raise ShortTicket(key=ticket, least=SHORTEST_TICKET)


def the_one(orders: Iterable[Order], ticket: str) -> Order:
    """Return the one order whose key begins like this.

    Raises:
        ShortTicket: that is too short to name one.
        NoSuchOrder: there is none.
        SeveralOrders: there are several.
    """
    expect_ticket(ticket)
    found = [each for each in orders if each.key.startswith(ticket)]
    if not found:
        raise NoSuchOrder(key=ticket)
    if len(found) > 1:
        keys = ", ".join(sorted(each.key for each in found)[:5])
        raise SeveralOrders(key=ticket, count=len(found), keys=keys)
    return found[0]


def mark_of(command: CommandSpec) -> str:
    """Return a short text that is the same as long as a command means the same: names, units, effect."""
    plain = msgspec.structs.replace(command, doc="", available=True, parameters=_bare(command.parameters))
    plain = msgspec.structs.replace(plain, result=_bare(command.result))
    return hashlib.blake2b(_encode(plain), digest_size=8).hexdigest()


def _bare(fields: Iterable[FieldSpec]) -> tuple[FieldSpec, ...]:
    return tuple(msgspec.structs.replace(one, doc="", items=_bare(one.items)) for one in fields)


def merged(one: Order, other: Order) -> Order:
    """Return what is true of an order of which two copies are known."""
    first = max(one, other, key=_further)
    return msgspec.structs.replace(
        first,
        seen=one.seen or other.seen,
        cancelled_by=max(one.cancelled_by, other.cancelled_by),
        confirmed_by=max(one.confirmed_by, other.confirmed_by),
        holders=tuple(sorted({*one.holders, *other.holders})),
    )


def _further(order: Order) -> tuple[int, float, bytes]:
    """Order by state, then by time; the rest only has two directories decide alike."""
    plain = msgspec.structs.replace(order, seen=False, cancelled_by="", confirmed_by="", holders=())
    return RANK[order.state], order.at, _encode(plain)


def merged_known(one: KnownAgent, other: KnownAgent) -> KnownAgent:
    """Return what is remembered of a robot of which two directories remember something."""
    later = max(one, other, key=lambda each: (each.described, each.seen, _encode(each)))
    read = max(one, other, key=lambda each: (each.read, _encode(each.readings)))
    pictured = max(one, other, key=lambda each: (each.pictured, each.picture))
    state = max(one, other, key=lambda each: (each.seen, each.online))
    answers, taken_by = dict(one.answers), dict(one.taken_by)
    for name, answer in other.answers.items():
        before = answers.get(name)
        if before is None or (answer[0], _encode(answer[1])) > (before[0], _encode(before[1])):
            answers[name] = answer
    for who, when in other.taken_by.items():
        taken_by[who] = max(when, taken_by.get(who, 0.0))
    return msgspec.structs.replace(
        later,
        readings=read.readings,
        read=read.read,
        online=state.online,
        picture=pictured.picture,
        pictured=pictured.pictured,
        answers=dict(sorted(answers.items())),
        seen=max(one.seen, other.seen),
        deleted=max(one.deleted, other.deleted),
        taken_by=dict(sorted(taken_by.items())),
    )


def merged_hold(one: OrderHold, other: OrderHold) -> OrderHold:
    """Return what is true of a hold of which two copies are known: a release is never undone."""
    first = max(one, other, key=lambda each: (each.released, each.released_by, _encode(each)))
    return msgspec.structs.replace(first, freed=tuple(sorted({*one.freed, *other.freed})))


def expect_one(meant: Sequence[KnownAgent]) -> KnownAgent:
    """Return the only one of the robots of a name that are remembered.

    Raises:
        SeveralRobots: there are several.
    """
    if len(meant) > 1:
        known = ", ".join(sorted(each.identity[:8] for each in meant))
        example = f"--robot {meant[0].identity[:8]}"
        raise SeveralRobots(name=meant[0].name, count=len(meant), known=known, example=example)
    return meant[0]


def clock_ahead(own: float, other: float) -> float:
    """Return by how much the own clock is ahead of another one [s]; small differences are none.

    Args:
        own: [s] since 1970.
        other: [s] since 1970, as a message that has just come says.
    """
    by = own - other
    return by if abs(by) > SAME_CLOCK else 0.0


def shifted(order: Order, by: float) -> Order:
    """Return an order with its times on a clock that is ahead by so much [s]."""
    if not by:
        return order
    return msgspec.structs.replace(
        order, left=order.left + by, begin_by=order.begin_by + by, at=order.at + by if order.at else 0.0
    )


def shifted_known(known: KnownAgent, by: float) -> KnownAgent:
    """Return what is remembered with its times on a clock that is ahead by so much [s]."""
    if not by:
        return known

    def moved(time: float) -> float:
        return time + by if time else 0.0

    return msgspec.structs.replace(
        known,
        described=moved(known.described),
        read=moved(known.read),
        pictured=moved(known.pictured),
        seen=moved(known.seen),
        deleted=moved(known.deleted),
        answers={name: (moved(when), value) for name, (when, value) in known.answers.items()},
        taken_by={who: moved(when) for who, when in known.taken_by.items()},
    )


def shifted_hold(hold: OrderHold, by: float) -> OrderHold:
    """Return a hold with its times on a clock that is ahead by so much [s]."""
    if not by:
        return hold
    released = hold.released + by if hold.released else 0.0
    return msgspec.structs.replace(hold, at=hold.at + by, released=released)
