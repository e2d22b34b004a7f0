"""What is left for a robot that is away happens once, when it is back."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import pytest

from robotree.vr.base.errors import (
    BadArgument,
    BadEnd,
    Denied,
    NoDirectory,
    NoSuchCommand,
    NoSuchOrder,
    NothingToConfirm,
    NotInDoubt,
    NotOrdered,
    NotRemembered,
    OrderOver,
    ShortTicket,
)
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import Credentials, Voucher, principal_of, vouched
from robotree.vr.base.requests import (
    AnyRequest,
    CancelOrder,
    FetchOrders,
    LeaveOrder,
    MarkSeen,
    RobotDeleted,
    ShareRecords,
    TakeOrder,
    TellOrders,
)
from robotree.vr.exchange.authority import AGENTS, NEEDS, Here, authorise
from robotree.vr.exchange.client import RobotClient
from robotree.vr.orders.ledger import Ledger, LedgerEntry
from tests.vr.orders.conftest import Rover, Stage
from tests.vr.policy.conftest import ask_as


async def remembered(stage: Stage, name: str = "r1") -> Ledger:
    """Have a rover come, be remembered, and be switched off; returns its ledger."""
    ledger = Ledger(None)
    agent = await stage.robot(Rover(name), ledger)
    await stage.until(
        lambda: all(any(a.name == name for a in s.book.store.agents.values()) for s in stage.services)
    )
    await stage.switch_off(agent)
    return ledger


async def furnished(stage: Stage, *names: str) -> Any:
    """Have directories, a person, and a rover that is away; returns them and its ledger."""
    directories = [await stage.directory(name) for name in names or ("d1",)]
    return *directories, await stage.person(), await remembered(stage)


async def test_an_order_is_carried_out_once_when_its_robot_is_back(stage: Stage) -> None:
    directory, person, ledger = await furnished(stage)
    left = await person.orders.leave("r1", "drive", {"x": "50 cm"})
    assert (left.order.state, left.order.arguments["x"]) == ("waiting", 0.5)
    rover = Rover("r1")
    agent = await stage.robot(rover, Ledger(None), identity="of-another-site")
    await asyncio.sleep(20)
    assert not rover.done, "it has the name alone"
    key, book = left.order.key, directory.book
    for found in (book.fetch("of-another-site"), book.take(key, "of-another-site")[0]):
        assert not found.orders, "and is told of nothing"
    await stage.switch_off(agent)
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await stage.until(lambda: directory.book.store.orders[key].over)
    done = directory.book.store.orders[key]
    assert (done.state, done.value, rover.done) == ("done", 0.5, [key])
    assert [each.key for each in await person.orders.inbox()] == [key]
    await person.orders.mark_seen([done])
    assert not await person.orders.inbox()


async def test_bad_input_is_refused_in_a_sentence_and_nothing_is_kept(stage: Stage) -> None:
    person = await stage.person()
    with pytest.raises(NoDirectory, match="start one with `robotree directory"):
        await person.orders.leave("r1", "drive", {"x": 1.0})
    directory = await stage.directory("d1")
    await stage.until(lambda: bool(person.orders.directories))
    with pytest.raises(NotRemembered, match="no directory remembers one"):
        await person.orders.leave("r1", "drive", {"x": 1.0})
    await remembered(stage)
    with pytest.raises(NoSuchCommand, match="it has: drive"):
        await person.orders.leave("r1", "fly", {})
    with pytest.raises(BadArgument, match="x"):
        await person.orders.leave("r1", "drive", {"x": "3 kg"})
    with pytest.raises(NotOrdered, match="its author does not allow it"):
        await person.orders.leave("r1", "jog", {})
    with pytest.raises(BadEnd, match="--until"):
        await person.orders.leave("r1", "drive", {"x": 1.0}, begin_within=1e9)
    with pytest.raises(NoSuchOrder):
        await person.orders.cancel("beef")
    with pytest.raises(ShortTicket, match="at least 4 letters"):
        await person.orders.cancel("b")
    assert not directory.book.store.orders


async def test_an_order_for_a_robot_that_never_returns_expires(stage: Stage) -> None:
    directory, person, ledger = await furnished(stage)
    left = await person.orders.leave("r1", "drive", {"x": 1.0}, begin_within=30.0)
    await asyncio.sleep(32)
    assert directory.book.store.orders[left.order.key].state == "expired"
    with pytest.raises(OrderOver, match="expired"):
        await person.orders.cancel(left.order.key)
    assert "in time" in (await person.orders.inbox())[0].why
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await asyncio.sleep(8)
    assert not rover.done


async def test_a_directory_that_was_away_learns_everything_and_nothing_is_done_twice(stage: Stage) -> None:
    first, second, person, ledger = await furnished(stage, "d1", "d2")
    left = await person.orders.leave("r1", "drive", {"x": 1.0})
    assert len(left.confirmed) == 2
    await stage.kill_directory(second)
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    key = left.order.key
    await stage.until(lambda: first.book.store.orders[key].state == "done")
    await stage.kill_directory(first)
    second = await stage.directory("d2")  # with the old copy alone
    await stage.until(lambda: second.book.store.orders[key].state == "done")
    assert rover.done == [key]
    first = await stage.directory("d1")
    await stage.until(lambda: first.book.store.orders[key] == second.book.store.orders[key])


async def test_what_was_acknowledged_survives_the_death_of_the_directory(stage: Stage) -> None:
    directory, person, _ = await furnished(stage)
    left = await person.orders.leave("r1", "drive", {"x": 1.0})
    await person.orders.hold("r1")
    await stage.kill_directory(directory)
    again = await stage.directory("d1")
    assert again.book.store.orders[left.order.key].state == "waiting"
    assert [hold.robot for hold in again.book.holds()] == ["r1"]
    assert again.address == directory.address


async def test_an_order_cancelled_while_its_robot_does_another_one_is_not_carried_out(stage: Stage) -> None:
    """All directories have confirmed the cancel, and the robot had fetched the order before."""
    await stage.directory("d1")
    await stage.directory("d2")
    person = await stage.person()
    ledger = await remembered(stage)
    first = (await person.orders.leave("r1", "drive", {"x": 1.0, "seconds": 5.0})).order.key
    second = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await stage.until(lambda: rover.done == [first])
    cancelled = await person.orders.cancel(second)
    assert (cancelled.order.state, cancelled.unconfirmed) == ("cancelled", ())
    await asyncio.sleep(30)
    assert rover.done == [first]


async def test_a_cancel_names_the_directory_that_did_not_confirm_it(stage: Stage) -> None:
    await stage.directory("d1")
    second = await stage.directory("d2")
    person = await stage.person()
    ledger = await remembered(stage)
    key = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    await stage.kill_directory(second)
    cancelled = await person.orders.cancel(key[:8])
    assert [label.partition(".")[0] for label in cancelled.unconfirmed] == ["d2"]
    await stage.directory("d2")  # it is back with its copy, and hears of the cancel at once
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await asyncio.sleep(10)
    assert not rover.done


async def test_what_one_directory_knows_as_cancelled_does_not_begin_though_another_one_has_it_waiting(
    stage: Stage,
) -> None:
    _, second, person, ledger = await furnished(stage, "d1", "d2")
    order = (await person.orders.leave("r1", "drive", {"x": 1.0})).order
    await person.orders.cancel(order.key)
    second.book.store.orders[order.key] = order
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await asyncio.sleep(20)
    assert not rover.done


async def test_a_running_order_that_is_cancelled_ends(stage: Stage) -> None:
    directory, person, ledger = await furnished(stage)
    key = (await person.orders.leave("r1", "drive", {"x": 1.0, "seconds": 60.0})).order.key
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await stage.until(lambda: bool(rover.done))
    assert (await person.orders.cancel(key)).order.state == "taken"
    await stage.until(lambda: directory.book.store.orders[key].over, within=10)
    assert directory.book.store.orders[key].state == "failed"
    assert "cancelled" in directory.book.store.orders[key].why
    assert rover.x == 0.0


async def test_a_stop_holds_who_is_away_until_a_person_releases_it(stage: Stage) -> None:
    directory, person, ledger = await furnished(stage)
    key = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    await stage.directory("d2")
    stage.network.freeze(stage.transports["d2"])
    assert await person.orders.hold() == (["d1"], ["d2"]), "who does not answer is named"
    stage.network.thaw(stage.transports["d2"])
    (copy,) = directory.book.take(key, "r1-for-life")[0].orders
    assert copy.state == "waiting", "nor does it begin when it has not heard of the hold"
    rover = Rover("r1")
    agent = await stage.robot(rover, ledger)
    await asyncio.sleep(20)
    assert not rover.done
    await RobotClient(person._transport, agent.address).resume()  # is not a person's release
    await person.orders.release(ago=3600.0)  # was given before the stop
    await asyncio.sleep(20)
    assert not rover.done
    await person.orders.release()
    await stage.until(lambda: rover.done == [key])


async def test_the_release_of_one_robot_leaves_the_others_held(stage: Stage) -> None:
    await stage.directory("d1")
    person = await stage.person()
    ledgers = {name: await remembered(stage, name) for name in ("r1", "r2")}
    for name in ledgers:
        await person.orders.leave(name, "drive", {"x": 1.0})
    await person.orders.hold()
    await person.orders.release("r1")
    rovers = [Rover("r1"), Rover("r2")]
    for rover in rovers:
        await stage.robot(rover, ledgers[rover.name])
    await stage.until(lambda: bool(rovers[0].done))
    await asyncio.sleep(20)
    assert not rovers[1].done


async def test_a_robot_that_is_stopped_busy_or_bound_begins_nothing(stage: Stage) -> None:
    _, person, ledger = await furnished(stage)
    rover = Rover("r1")
    agent = await stage.robot(rover, ledger)
    client = RobotClient(person._transport, agent.address)
    await client.safe_stop("the test")
    key = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    await asyncio.sleep(10)
    assert not rover.done
    await client.resume()
    await stage.until(lambda: rover.done == [key])


@pytest.mark.parametrize(
    ("command", "remembers", "ends"),
    [("drive", True, ("doubt", 0)), ("drive", False, ("doubt", 0)), ("go_to", True, ("done", 1))],
    ids=["what adds up", "who has lost its ledger", "what may be repeated"],
)
async def test_an_order_in_whose_middle_its_robot_was_killed_is_in_doubt_unless_it_may_be_repeated(
    stage: Stage, command: str, *, remembers: bool, ends: tuple[str, int]
) -> None:
    directory, person, ledger = await furnished(stage)
    key = (await person.orders.leave("r1", command, {"x": 1.0, "seconds": 60.0})).order.key
    agent = await stage.robot(Rover("r1"), ledger)
    await stage.until(lambda: key in ledger.entries and ledger.entries[key].begun)
    await stage.switch_off(agent)
    rover = Rover("r1")
    await stage.robot(rover, ledger if remembers else Ledger(None))
    await stage.until(lambda: directory.book.store.orders[key].over, within=100.0)
    assert (directory.book.store.orders[key].state, rover.done.count(key)) == ends


async def test_an_intent_that_no_directory_heard_of_begins_when_one_confirms_it(stage: Stage) -> None:
    """Killed between the intent and the first move: nothing has begun, so nothing is in doubt."""
    directory, person, ledger = await furnished(stage)
    order = (await person.orders.leave("r1", "drive", {"x": 1.0})).order
    ledger.put(LedgerEntry(msgspec.structs.replace(order, state="taken")))
    stage.network.freeze(stage.transports["d1"])
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await asyncio.sleep(20)
    assert not rover.done, "nobody has confirmed it"
    stage.network.thaw(stage.transports["d1"])
    await stage.until(lambda: directory.book.store.orders[order.key].over)
    assert (directory.book.store.orders[order.key].state, rover.done) == ("done", [order.key])


async def test_a_command_that_has_changed_is_refused(stage: Stage) -> None:
    directory, person, ledger = await furnished(stage)
    left = await person.orders.leave("r1", "drive", {"x": 1.0})
    old = msgspec.structs.replace(left.order, mark="another")
    directory.book.store.put(orders=[old])
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await stage.until(lambda: directory.book.store.orders[old.key].over)
    refused = directory.book.store.orders[old.key]
    assert (refused.state, rover.done) == ("refused", [])
    assert "not as it was when it was ordered" in refused.why


async def test_a_robot_that_somebody_moved_since_asks_before_it_begins(stage: Stage) -> None:
    directory, person, ledger = await furnished(stage)
    await person.orders.hold("r1")
    key = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    rover = Rover("r1")
    agent = await stage.robot(rover, ledger)
    client = RobotClient(person._transport, agent.address)
    await asyncio.sleep(1)
    await client.call("drive", {"x": 2.0}, caller="anna@desk")
    await person.orders.release("r1")
    await stage.until(lambda: bool(directory.book.store.orders[key].asks))
    await asyncio.sleep(10)
    assert len(rover.done) == 1
    await person.orders.confirm(key)
    await stage.until(lambda: len(rover.done) == 2)
    await stage.until(lambda: directory.book.store.orders[key].over)
    with pytest.raises(NothingToConfirm):
        await person.orders.confirm(key)


class Measured(Rover):
    """A rover that says where it stands."""

    reading_units: ClassVar[Mapping[str, str]] = {"x": "m"}


async def test_a_robot_that_was_moved_by_hand_asks_and_one_that_moved_by_order_does_not(
    stage: Stage, tmp_path: Path
) -> None:
    directory = await stage.directory("d1")
    person = await stage.person()
    ledger, rover = Ledger(tmp_path / "ledger.db"), Measured("r1")
    agent = await stage.robot(rover, ledger)
    await stage.until(lambda: ledger.rest == {"r1-for-life": {"x": 0.0}})
    await stage.until(lambda: bool(directory.book.store.agents))
    await stage.switch_off(agent)
    first, second = [(await person.orders.leave("r1", "drive", {"x": 1.0})).order.key for _ in range(2)]
    ledger.close()
    ledger = Ledger(tmp_path / "ledger.db")
    again = Measured("r1")
    again.x = 0.02  # it was switched on where it stood
    agent = await stage.robot(again, ledger)
    orders = directory.book.store.orders
    await stage.until(lambda: orders[second].over)
    assert (orders[first].state, orders[second].state) == ("done", "done"), "its own way is no hand"
    await stage.until(lambda: "r1-for-life" in ledger.rest)
    third = await person.orders.leave("r1", "drive", {"x": 1.0})
    await stage.until(lambda: orders[third.order.key].over)
    await asyncio.sleep(6)
    await stage.switch_off(agent)
    await asyncio.sleep(1)
    fourth = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    carried = Measured("r1")
    carried.x = again.x + 0.3
    await stage.robot(carried, ledger)
    await stage.until(lambda: "moved r1" in orders[fourth].asks)
    assert not carried.done
    fifth = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    await asyncio.sleep(10)
    assert not carried.done, "what was left later waits for the answer"
    await person.orders.confirm(fourth)
    await stage.until(lambda: orders[fifth].over)
    assert orders[fourth].state == orders[fifth].state == "done"
    ledger.close()


async def test_clocks_that_differ_by_hours_neither_expire_nor_prolong_an_order(stage: Stage) -> None:
    directory = await stage.directory("d1")
    late = await stage.directory("d2", skew=-7200.0)
    person = await stage.person()
    ledger = await remembered(stage)
    left = await person.orders.leave("r1", "drive", {"x": 1.0}, begin_within=600.0)
    key = left.order.key
    await stage.until(lambda: key in late.book.store.orders and key in directory.book.store.orders)
    apart = directory.book.store.orders[key].begin_by - late.book.store.orders[key].begin_by
    assert abs(apart - 7200.0) < 5.0
    rover = Rover("r1")
    await stage.robot(rover, ledger, skew=3600.0)
    await stage.until(lambda: rover.done == [key])


@pytest.mark.parametrize(
    ("command", "arguments", "state", "why"),
    [("drive", {"x": 1.0, "seconds": 30.0}, "done", ""), ("fail", {}, "failed", "over")],
)
async def test_an_order_that_expires_while_it_runs_goes_on_and_a_failure_is_told_with_its_reason(
    stage: Stage, command: str, arguments: dict[str, float], state: str, why: str
) -> None:
    directory, person, ledger = await furnished(stage)
    key = (await person.orders.leave("r1", command, arguments, begin_within=10.0)).order.key
    await stage.robot(Rover("r1"), ledger)
    await stage.until(lambda: directory.book.store.orders[key].over)
    assert directory.book.store.orders[key].state == state
    assert why in directory.book.store.orders[key].why


async def test_what_only_reads_is_remembered_where_its_author_allows_it(stage: Stage) -> None:
    directory = await stage.directory("d1")
    rover = Rover("r1")
    rover.x = 3.0
    agent = await stage.robot(rover)
    await stage.until(lambda: "r1-for-life" in directory._read)
    await asyncio.sleep(6)
    await stage.switch_off(agent)
    known = await (await stage.person()).orders.robot("r1")
    assert known is not None
    assert known.answers["place"][1] == 3.0
    assert known.readings == {"x": 3.0}


async def test_what_a_robot_answered_last_is_not_older_than_its_last_command(stage: Stage) -> None:
    directory = await stage.directory("d1")
    person = await stage.person()
    agent = await stage.robot(Rover("r1"))
    await stage.until(lambda: "place" in directory._latest("r1-for-life").answers)  # type: ignore[union-attr]
    client = RobotClient(person._transport, agent.address)
    await client.call("drive", {"x": 2.0, "seconds": 1.0}, caller="anna@desk")
    await asyncio.sleep(1)
    await stage.switch_off(agent)
    known = await person.orders.robot("r1")
    assert known is not None
    assert known.answers["place"][1] == known.readings["x"] == 2.0


async def test_a_robot_that_is_deleted_is_not_away(stage: Stage) -> None:
    directory, person, _ = await furnished(stage)
    key = (await person.orders.leave("r1", "drive", {"x": 1.0})).order.key
    directory._spread_later(directory.book.deleted("r1-for-life"))
    known = await person.orders.robot("r1")
    assert known is not None
    assert known.deleted
    assert directory.book.store.orders[key].state == "refused"
    with pytest.raises(NotOrdered, match="was deleted"):
        await person.orders.leave("r1", "drive", {"x": 1.0})


async def test_a_person_settles_an_order_in_doubt(stage: Stage) -> None:
    first, second, person, ledger = await furnished(stage, "d1", "d2")
    left = await person.orders.leave("r1", "drive", {"x": 1.0, "seconds": 60.0})
    rover, key = Rover("r1"), left.order.key
    agent = await stage.robot(rover, ledger)
    await stage.until(lambda: bool(rover.done))
    with pytest.raises(NotInDoubt):
        await person.orders.settle(key, "done")
    await stage.kill_directory(second)
    await stage.switch_off(agent)
    await stage.robot(Rover("r1"), Ledger(None))  # its memory is lost
    await stage.until(lambda: first.book.store.orders[key].state == "doubt")
    copy = first.book.store.orders[key]
    settled = (await person.orders.settle(key, "undone")).order
    assert settled.state == "failed"
    assert "not done" in settled.why
    second = await stage.directory("d2")
    second.book.keep(orders=[copy])  # which has heard of the doubt alone
    await stage.until(lambda: second.book.store.orders[key].state == "failed")
    assert [each.state for each in await person.orders.inbox()] == ["failed"]


async def test_a_robot_that_waits_for_orders_keeps_nobody_waiting_when_it_ends(stage: Stage) -> None:
    await stage.directory("d1")
    agent = await stage.robot(Rover("r1"))
    await asyncio.sleep(2.0)
    began = stage.loop.time()
    await agent.close()
    assert stage.loop.time() - began < 0.1


async def test_a_directory_says_once_that_its_disk_is_full(
    stage: Stage, caplog: pytest.LogCaptureFixture
) -> None:
    directory = await stage.directory("d1")
    assert directory.book.store._file is not None
    directory.book.store._file.file.execute("PRAGMA max_page_count=1")  # it cannot grow any more
    for number in range(8):
        await stage.robot(Rover(f"r{number}"))
    await asyncio.sleep(60)
    warnings = [record.getMessage() for record in caplog.records if "its disk is full" in record.getMessage()]
    assert len(warnings) == 1
    assert "make room on that disk" in warnings[0]


# -- the right to order is looked at when an order is left, and again when it begins ---------------


MAY = """
persons: {anna: planner, ben: viewer}
roles:
  planner: {see: "*", order: "r1.drive"}
  viewer: {see: "*"}
"""
NO_MORE = """
persons: {ben: viewer}
roles:
  viewer: {see: "*"}
"""


async def test_who_may_not_order_leaves_nothing_and_ends_nothing_of_others(stage: Stage) -> None:
    stage.network.gate = gate = PolicyGate()
    directory = await stage.directory("d1")
    await stage.person()
    operator, ledger = stage.transports["operator"], await remembered(stage)
    gate.policy = read_policy(f"realm: test\nversion: 1\n{MAY}")
    leave = LeaveOrder(
        key="0123456789abcdef",
        robot="r1",
        command="drive",
        arguments={"x": 1.0},
        begin_within=600.0,
        may_take=60.0,
    )
    with pytest.raises(Denied, match="order"):
        await ask_as(operator, "ben", directory.address.key, leave)
    with pytest.raises(Denied):
        await ask_as(
            operator,
            "anna",
            directory.address.key,
            msgspec.structs.replace(leave, key="f" * 16, command="go_to"),
        )
    await ask_as(operator, "anna", directory.address.key, leave)
    with pytest.raises(Denied):
        await ask_as(operator, "ben", directory.address.key, CancelOrder(key=leave.key))
    gate.policy = read_policy(f"realm: test\nversion: 2\n{NO_MORE}")
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await stage.until(lambda: directory.book.store.orders[leave.key].over)
    order = directory.book.store.orders[leave.key]
    assert (order.state, rover.done) == ("refused", [])
    assert "anna" in order.why
    await ask_as(operator, "ben", directory.address.key, MarkSeen(keys=(leave.key,)))  # it is not his
    assert not directory.book.store.orders[leave.key].seen
    await ask_as(operator, "anna", directory.address.key, MarkSeen(keys=(leave.key,)))
    assert directory.book.store.orders[leave.key].seen


WORDS = """
persons: {"robots@hall": worker, "boss@hall": boss}
roles:
  worker: {see: "*", command: "*", order: "*", create: "*", release: "*", migrate: "*", resume: "*"}
  boss: {administrate: yes}
"""
AMONG_AGENTS = (
    FetchOrders(identity="i1"),
    TakeOrder(key="0123456789abcdef", identity="i1"),
    TellOrders(orders=(), now=0.0),
    RobotDeleted(identity="i1"),
    ShareRecords(now=0.0),
)
"""Requests of robots and directories to each other: they are believed in what they say of others."""


@pytest.mark.parametrize("request_", AMONG_AGENTS, ids=lambda one: type(one).__name__)
def test_who_speaks_as_an_agent_from_elsewhere_must_be_allowed_to_administrate(request_: AnyRequest) -> None:
    """All other rights together are not enough, also not for a process that has no terminal."""
    assert {type(one) for one in AMONG_AGENTS} == {kind for kind, right in NEEDS.items() if right == AGENTS}
    gate, me = PolicyGate(), os.geteuid()
    gate.policy, here = read_policy(f"realm: test\nversion: 1\n{WORDS}"), Here("directory", "d1", gate)
    for terminal in ("", "pts/1"):
        worker = vouched(msgspec.msgpack.encode(Voucher("hall", "robots", 7)), "host/h/1", terminal)
        with pytest.raises(Denied, match=r"robots@hall may not administrate realm"):
            authorise(worker, request_, None, here)
        boss = vouched(msgspec.msgpack.encode(Voucher("hall", "boss", 7)), "", terminal)
        authorise(boss, request_, None, here)
    authorise(principal_of(Credentials(7, me), "host/h/1", ""), request_, None, here)
    gate.owner = me + 1  # several users of this machine share the realm
    other = me + 70_002
    with pytest.raises(Denied, match=f"{other} may not administrate realm"):
        authorise(principal_of(Credentials(7, other), "", ""), request_, None, here)


async def test_records_of_another_site_change_nothing_without_the_right(stage: Stage) -> None:
    stage.network.gate = gate = PolicyGate()
    directory = await stage.directory("d1")
    await stage.person()
    await remembered(stage)
    operator = stage.transports["operator"]
    gate.policy = read_policy(f"realm: test\nversion: 1\n{WORDS}")
    agents = directory.book.store.agents
    (known,) = [one for one in agents.values() if one.name == "r1"]
    forged = ShareRecords(
        now=0.0, agents=(msgspec.structs.replace(known, deleted=1.0, seen=known.seen + 9.0),)
    )
    for request in (forged, RobotDeleted(identity=known.identity)):
        with pytest.raises(Denied, match="robots@hall may not administrate realm"):
            await ask_as(operator, "robots@hall", directory.address.key, request)
        assert not agents[known.identity].deleted
    await ask_as(operator, "boss@hall", directory.address.key, RobotDeleted(identity=known.identity))
    assert agents[known.identity].deleted, "who may administrate is believed: so the test could fail"
