"""The verbs about orders: what is left for robots that are away, and the results that wait."""

from __future__ import annotations

import time
from collections.abc import Container, Iterable, Sequence
from typing import TYPE_CHECKING, Any

from robotree.tui.errors import ValueRefused
from robotree.tui.line import values, verbs
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import CALL_LIMIT, Outcome, Teller, plain
from robotree.tui.seen import absence, wording
from robotree.vr.base.readable import quantity

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.errors import NoSuchRobot
    from robotree.vr.base.order import KnownAgent, Order, OrderHold
    from robotree.vr.base.requests import OrderLeft
    from robotree.vr.supervision.realm_client import RealmClient

HELD_BY = "`robotree resume` releases it"


async def call_or_leave(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Have a command carried out and wait for it, or leave it as an order.

    Raises:
        RobotAbsent: the robot is away, and nothing was left.
    """
    from robotree.vr.base.errors import NoSuchRobot

    if line.flag("--queue"):
        return await leave(realm_client, line, teller)
    for option in ("--until", "--robot"):
        if line.text(option):
            raise ValueRefused(option, "it is for an order; give --queue, too")
    try:
        return await verbs.call(realm_client, line, teller)
    except NoSuchRobot as error:
        _, command = values.dotted(line.text("ROBOT.COMMAND"), "ROBOT.COMMAND")
        return await _remembered(realm_client, error, command, teller)


async def show_or_remember(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Describe one robot, with what it reads now; one that is away, with what is remembered of it."""
    from robotree.vr.base.errors import NoSuchRobot

    try:
        return await verbs.show(realm_client, line, teller)
    except NoSuchRobot as error:
        known = await realm_client.orders.robot(str(error.data["name"]))
        if known is None:
            raise
    now = time.time()
    data: dict[str, Any] = {} if known.robot is None else plain(known.robot)
    about = {
        name: plain(getattr(known, name)) for name in ("seen", "described", "read", "deleted", "taken_by")
    }
    remembered = {"readings": plain(known.readings), "state": absence.how(known, now), **about}
    return Outcome({**data, **remembered, "age": round(now - known.seen, 1)}, known_portrait(known, now))


async def _remembered(realm_client: RealmClient, error: NoSuchRobot, command: str, teller: Teller) -> Outcome:
    """Answer for a robot that is away, where the author of the command allows that.

    Raises:
        NoSuchRobot: nobody remembers the robot.
        RobotAbsent: it is away, and only an order can be left for it, or not even that.
    """
    from robotree.vr.base.errors import RobotAbsent

    name = str(error.data["name"])
    known = await realm_client.orders.robot(name)
    if known is None or known.robot is None:
        raise error
    now, spec = time.time(), known.robot.command(command)
    how = absence.how(known, now)
    if spec is not None and spec.offline == "memory" and command in known.answers:
        when, value = known.answers[command]
        teller.warn(f"{name} is {how}; this is what it answered {absence.age(when, now)}")
        rows = wording.result(spec.result, value)
        return Outcome(plain(value), wording.columns([row if row[0] else row[1:] for row in rows]))
    if known.deleted:
        advice = "it does not come back"
    elif spec is not None and spec.offline == "queue":
        advice = f"leave an order for it: `robotree call --queue {name}.{command} …`"
    else:
        advice = "its author allows no order of this command; start it, then call again"
    raise RobotAbsent(name=name, how=how, advice=advice)


async def leave(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Leave a command as an order (`call --queue`)."""
    robot, command = values.dotted(line.text("ROBOT.COMMAND"), "ROBOT.COMMAND")
    left = await realm_client.orders.leave(
        robot,
        command,
        values.assignments(line.many("PARAMETER=VALUE")),
        begin_within=until(line.text("--until")),
        may_take=values.duration(line.text("--within")) if line.text("--within") else CALL_LIMIT,
        identity=line.text("--robot"),
    )
    return told_left(left, teller)


def told_left(left: OrderLeft, teller: Teller) -> Outcome:
    """Return the result of an order that was left: its ticket, its end, and who has it."""
    order = left.order
    if left.unconfirmed:
        names = absence.names(left.unconfirmed)
        teller.warn(f"{names} did not confirm it; the order is kept by {absence.names(left.confirmed)}")
    number = len(left.confirmed)
    held = f"{number} {'directory holds' if number == 1 else 'directories hold'} it"
    text = (
        f"order {order.ticket}: {order.robot}.{order.command} is left,"
        f" to begin by {absence.clock(order.begin_by)}; {held}"
    )
    data = {**data_of(order), "confirmed": list(left.confirmed), "unconfirmed": list(left.unconfirmed)}
    return Outcome(data, text)  # fmt: skip


def data_of(order: Order) -> dict[str, Any]:
    """Return an order as plain data."""
    return {**plain(order), "state": order.state, "shown": order.shown, "ticket": order.ticket}


def until(text: str) -> float:
    """Return in how many seconds an order must begin: `2h`, `30min`, or a time of the day, `18:00`.

    Raises:
        ValueRefused: it is neither.
    """
    from robotree.vr.supervision.orders import USUAL_END

    if not text:
        return USUAL_END
    if ":" not in text:
        try:
            return values.duration(text)
        except ValueRefused:
            raise _no_end(text) from None
    try:
        hour, minute = (int(part) for part in text.split(":"))
    except ValueError:
        raise _no_end(text) from None
    if not (0 <= hour < 24 and 0 <= minute < 60):
        raise _no_end(text)
    now = time.localtime()
    seconds = (hour - now.tm_hour) * 3600 + (minute - now.tm_min) * 60 - now.tm_sec
    return float(seconds if seconds > 0 else seconds + 86400)


def _no_end(text: str) -> ValueRefused:
    """Return why a text does not say until when an order may begin."""
    return ValueRefused(
        "WHEN",
        f"{text!r} says no end: write how long from now, as 30min, 2h or 3d (s, min, h, d; 30 days at most),"
        " or the next time that a clock shows, as 18:00",
    )


async def orders(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """List orders, the oldest first, and what holds robots."""
    board = await realm_client.orders.board(robot=line.text("NAME"), mine=line.flag("--mine"))
    if board.silent:
        teller.warn(f"{', '.join(board.silent)} does not answer; what it has is missing here")
    shown = board.orders if line.flag("--all") else [each for each in board.orders if not each.seen]
    holds = [each for each in board.holds if line.text("NAME") in ("", each.robot) or not each.robot]
    data = {
        "orders": [data_of(each) for each in shown],
        "holds": [plain(each) for each in holds],
        "silent": list(board.silent),
    }
    return Outcome(data, table(shown, holds, await _asking(realm_client, shown)))


async def _asking(realm_client: RealmClient, orders: Iterable[Order]) -> set[str]:
    """Return the robots that ask a person while they carry out an order."""
    if not any(each.state == "taken" for each in orders):
        return set()
    return {robot.name for robot in await realm_client.tree() if robot.asks}


def table(orders: Sequence[Order], holds: Sequence[Any] = (), asking: Container[str] = ()) -> str:
    """Return orders and holds as people read them; `asking`: see `about`."""
    rows: list[tuple[str, ...]] = [("TICKET", "ORDER", "STATE", "BY", "LEFT", "BEGIN BY", "ABOUT")]
    rows += [
        (
            each.ticket,
            f"{each.robot}.{each.command}",
            each.shown,
            each.who,
            absence.clock(each.left),
            absence.clock(each.begin_by),
            about(each, asking),
        )
        for each in orders
    ]
    lines = [wording.columns(rows) if orders else "no order is left"]
    return "\n".join([*lines, *held(holds, HELD_BY)])


def held(holds: Sequence[OrderHold], remedy: str) -> list[str]:
    """Return a line for each robot that is held, however often it was stopped, and the remedy."""
    of_robot: dict[str, list[OrderHold]] = {}
    for hold in holds:
        of_robot.setdefault(hold.robot, []).append(hold)
    return [
        f"{robot or 'every robot that is away'} is held since {absence.clock(min(each.at for each in stops))}"
        f" by {', '.join(dict.fromkeys(each.by for each in stops))}: {remedy}"
        for robot, stops in of_robot.items()
    ]


def about(order: Order, asking: Container[str] = ()) -> str:
    """Return why an order is as it is, or what it waits for; `asking`: the robots that ask a person."""
    if order.state == "waiting" and order.asks and not order.confirmed_by:
        return f"ASKS (order confirm {order.ticket}): {order.asks}"
    if order.state == "taken" and order.cancelled_by:
        return f"{order.cancelled_by} cancelled it; its robot has it already"
    if order.state == "taken" and order.robot in asking:
        return f"asks: `robotree decide {order.robot} done|again|abort`"
    if order.state == "done":
        rows = wording.result(order.result, order.value)
        return ", ".join(f"{name} {text}".strip() for name, text in rows)
    return order.why


async def order_show(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Show one order."""
    order = await realm_client.orders.order(line.text("TICKET"))
    return Outcome(data_of(order), portrait(order, await _asking(realm_client, [order])))


def portrait(order: Order, asking: Container[str] = ()) -> str:
    """Describe one order in full; `asking`: see `about`."""
    given = " ".join(f"{name}={value!r}" for name, value in order.arguments.items())
    facts = [
        ("ticket", order.ticket),
        ("key", order.key),
        ("order", f"{order.robot}.{order.command} {given}".rstrip()),
        ("state", order.shown),
        ("since", absence.clock(order.at)),
        ("about", about(order, asking)),
        ("left by", f"{order.who}, {absence.clock(order.left)}"),
        ("begin by", absence.clock(order.begin_by)),
        ("may take", f"{order.may_take:.0f} s"),
        ("held by", absence.names(order.holders)),
    ]
    return wording.columns([fact for fact in facts if fact[1]])


async def order_cancel(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """End an order."""
    left = await realm_client.orders.cancel(line.text("TICKET"))
    order = left.order
    if order.state == "taken":
        text = (
            f"{order.robot} has order {order.ticket} already; it is told to end it, and what came of it waits"
        )
    else:
        text = f"order {order.ticket} is {order.shown}"
    if left.unconfirmed:
        names = absence.names(left.unconfirmed)
        teller.warn(
            f"{names} did not confirm it and may have another copy: if {order.robot} hears of that one"
            f" alone, it is carried out; start {names} again, or stop {order.robot}"
        )
    data = {**data_of(order), "unconfirmed": list(left.unconfirmed)}
    return Outcome(data, text)


async def order_confirm(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Answer what a robot asks about an order."""
    left = await realm_client.orders.confirm(line.text("TICKET"))
    return Outcome(data_of(left.order), f"order {left.order.ticket} may begin")


async def order_settle(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Say what became of an order in doubt.

    Raises:
        ValueRefused: neither done nor undone.
    """
    outcome = line.text("OUTCOME")
    if outcome not in {"done", "undone"}:
        reason = f"{outcome!r} is none; look what the robot did, then write done or undone"
        raise ValueRefused("OUTCOME", reason)
    left = await realm_client.orders.settle(line.text("TICKET"), "done" if outcome == "done" else "undone")
    return Outcome(data_of(left.order), f"order {left.order.ticket} is {left.order.shown}: {left.order.why}")


async def inbox(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Print the results that wait for this user, and take them out of the inbox."""
    found = await realm_client.orders.inbox()
    if not line.flag("--keep"):
        await realm_client.orders.mark_seen(found)
    text = "\n".join(result_line(each) for each in found) or "no result waits"
    return Outcome([data_of(each) for each in found], text)


def result_line(order: Order) -> str:
    """Return the result of one order in a line."""
    told = about(order)
    begin = f"{absence.clock(order.at)}  {order.ticket}  {order.robot}.{order.command} is {order.shown}"
    return f"{begin}: {told}" if told else begin


def known_portrait(known: KnownAgent, now: float) -> str:
    """Describe a robot that is away: what is remembered of it, with its age."""
    if known.robot is None:
        return f"{known.name} is {absence.how(known, now)}"
    said = absence.age(known.described, now)
    text = wording.portrait(known.robot, absence.how(known, now))
    blocks = [f"{known.name} is {absence.how(known, now)}; this is what it said {said}:", text]
    if known.readings:
        rows = [
            (f"  {name}", quantity(value, known.robot.units.get(name, "")))
            for name, value in sorted(known.readings.items())
        ]
        blocks.append(f"readings, {absence.age(known.read, now)}\n{wording.columns(rows)}")
    for who, when in known.taken_by.items():
        blocks.append(f"{who} has taken it along {absence.age(when, now)}")
    return "\n\n".join(blocks)
