"""The right to order is looked at when an order is left, and again when it begins."""

from __future__ import annotations

import os

import msgspec
import pytest

from robotree.vr.base.errors import Denied
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
from tests.vr.orders.conftest import Rover, Stage
from tests.vr.orders.test_orders import remembered
from tests.vr.policy.conftest import ask_as

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
