"""Robots that somebody has taken along: their memory lies in a file, and orders are left there.

The file belongs to one user of one machine. At the next contact with a directory its orders are left there
under the keys that they have, with the rights of the one who left them; what became of them comes back.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.tui.line import ordering, values
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import CALL_LIMIT, Outcome, Teller, plain
from robotree.tui.seen import absence, wording

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.order import Order
    from robotree.vr.orders.book import OrderBook
    from robotree.vr.supervision.realm_client import RealmClient

FILE = "taken.db"
"""In the folder of the realm's state."""
OWNER = "owner"
"""File beside it, with whose orders they are."""


def folder_of(realm: str) -> Path:
    """Return the folder of what was taken along; looking makes nothing."""
    from robotree.tui.processes.state_files import state_home

    return state_home() / realm / "taken"


def exists(realm: str) -> bool:
    """Whether this user has taken robots of a realm along."""
    return (folder_of(realm) / FILE).exists()


@contextlib.contextmanager
def opened(realm: str, owner: str = "") -> Generator[OrderBook]:
    """Open what was taken along.

    Args:
        realm: of the robots.
        owner: whose orders are left in it; empty: whose they were.

    Raises:
        NoPlaceForState: its folder cannot be made.
        DirectoryUnusable: another program uses it at this moment.
    """
    from robotree.files import private_folder, replace, text
    from robotree.tui.processes.state_files import needed_file
    from robotree.vr.orders.book import OrderBook
    from robotree.vr.orders.store import OrderStore

    folder = needed_file(realm, "taken")
    private_folder(folder)
    if owner:
        replace(folder / OWNER, owner.encode())
    store = OrderStore(folder / FILE)
    try:
        known = owner or text(folder / OWNER, 200)
        yield OrderBook("taken", store, time.time, owner=known)
    finally:
        store.close()


async def take(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Put what is known of robots onto this machine."""
    names, device = line.many("NAME"), line.text("--as")
    who, agents = await realm_client.orders.take_along(names, device)
    now = time.time()
    for each in agents:
        for other, when in each.taken_by.items():
            if other != who:
                teller.warn(
                    f"{other} has taken {each.name} along, too, {absence.age(when, now)}: what both order is"
                    " carried out in the order in which it was left"
                )
    with opened(realm_client.realm, who) as book:
        book.keep(agents=agents)
    text = f"taken along: {', '.join(names)}; `robotree call --queue`, `orders`, `show` need no network"
    return Outcome({"taken": list(names), "who": who}, text)


async def merge(realm_client: RealmClient, teller: Teller) -> int:
    """Leave the orders that were left without a network; returns how many were news to the directories."""
    from robotree.vr.base.errors import OrderError, VrError

    realm, number = realm_client.realm, 0
    if not realm or not exists(realm) or not await realm_client.orders.met():
        return 0
    with opened(realm) as book:
        book.sweep()
        known = {each.key: each for each in (await realm_client.orders.board()).orders}
        for order in list(book.store.orders.values()):
            try:
                if order.key in known:
                    if order.state == "cancelled" and not known[order.key].over:
                        await realm_client.orders.cancel(order.key)
                        known = {each.key: each for each in (await realm_client.orders.board()).orders}
                    book.keep(orders=[known[order.key]])
                elif order.state == "waiting":
                    left = await realm_client.orders.leave_again(order, order.who.partition("/")[2])
                    book.keep(orders=[left.order])
                    number += 1
            except OrderError as error:
                teller.warn(f"order {order.ticket} for {order.robot}: {error}")
            except VrError as error:
                teller.warn(str(error))
    return number


def offline(line: Line, realm: str, teller: Teller) -> Outcome | None:
    """Carry out a verb on what was taken along; None: it needs the realm.

    Raises:
        VrError: it is refused.
    """
    if line.verb not in _OFFLINE or not exists(realm) or (line.verb == "call" and not line.flag("--queue")):
        return None
    with opened(realm) as book:
        book.sweep()
        teller.warn(f"nobody is in realm {realm}; this is what was taken along")
        return _OFFLINE[line.verb](book, line)


def left_here(
    realm: str, robot: str, command: str, arguments: Mapping[str, Any], begin_within: float
) -> Order:
    """Leave an order in what was taken along.

    Args:
        realm: of the robot.
        robot: its name.
        command: of it.
        arguments: numbers in the declared units, or text with units.
        begin_within: [s] in which it must begin.

    Raises:
        VrError: it is refused.
    """
    with opened(realm) as book:
        return _left(book, robot, command, arguments, begin_within)


def cancelled_here(realm: str, key: str) -> Order:
    """End an order that was left in what was taken along.

    Raises:
        VrError: it is over, or there is none.
    """
    with opened(realm) as book:
        order = book.cancel(key, book.owner)
        book.keep(orders=[order])
        return order


def _left(
    book: OrderBook,
    robot: str,
    command: str,
    arguments: Mapping[str, Any],
    begin_within: float,
    may_take: float = CALL_LIMIT,
    identity: str = "",
) -> Order:
    from robotree.vr.base.chance import token
    from robotree.vr.base.principal import principal_of, this_process
    from robotree.vr.base.requests import LeaveOrder

    request = LeaveOrder(
        key=token(),
        robot=robot,
        command=command,
        arguments=dict(arguments),
        begin_within=begin_within,
        may_take=may_take,
        identity=identity,
    )
    order = book.leave(request, principal_of(this_process(), "", ""))
    book.keep(orders=[order])
    return order


def _call(book: OrderBook, line: Line) -> Outcome:
    robot, command = values.dotted(line.text("ROBOT.COMMAND"), "ROBOT.COMMAND")
    order = _left(
        book,
        robot,
        command,
        values.assignments(line.many("PARAMETER=VALUE")),
        ordering.until(line.text("--until")),
        values.duration(line.text("--within")) if line.text("--within") else CALL_LIMIT,
        line.text("--robot"),
    )
    end = absence.clock(order.begin_by)
    text = f"order {order.ticket}: {robot}.{command} is left here, to begin by {end}; no directory has it yet"
    return Outcome({**ordering.data_of(order), "confirmed": [], "unconfirmed": []}, text)


def _orders(book: OrderBook, line: Line) -> Outcome:
    from robotree.vr.base.requests import ReadOrders

    found = book.find(ReadOrders(robot=line.text("NAME"))).orders
    data = {"orders": [ordering.data_of(each) for each in found]}
    return Outcome({**data, "holds": [], "silent": []}, ordering.table(found))


def _one(book: OrderBook, ticket: str) -> Order:
    from robotree.vr.base.order import the_one

    return the_one(book.store.orders.values(), ticket)


def _order_show(book: OrderBook, line: Line) -> Outcome:
    order = _one(book, line.text("TICKET"))
    return Outcome(ordering.data_of(order), ordering.portrait(order))


def _order_cancel(book: OrderBook, line: Line) -> Outcome:
    order = book.cancel(_one(book, line.text("TICKET")).key, book.owner)
    book.keep(orders=[order])
    return Outcome(
        plain(order), f"order {order.ticket} is cancelled here; the directories hear of it next time"
    )


def _show(book: OrderBook, line: Line) -> Outcome:
    known, now = book.robot(line.text("NAME")), time.time()
    return Outcome(plain(known), ordering.known_portrait(known, now))


def _ls(book: OrderBook, _line: Line) -> Outcome:
    now = time.time()
    agents = sorted(book.store.agents.values(), key=lambda each: each.name)
    rows = [("NAME", "KIND", "STATE")]
    rows += [(each.name, each.robot.kind if each.robot else "-", absence.how(each, now)) for each in agents]
    data: list[Any] = [{"name": each.name, "state": absence.how(each, now)} for each in agents]
    return Outcome(data, wording.columns(rows))


_OFFLINE: dict[str, Callable[[OrderBook, Line], Outcome]] = {
    "call": _call,
    "orders": _orders,
    "order show": _order_show,
    "order cancel": _order_cancel,
    "show": _show,
    "ls": _ls,
}
"""Verbs that are carried out on what was taken along where nobody else is."""
