"""The right to order is looked at when an order is left, and again when it begins."""

from __future__ import annotations

import msgspec
import pytest

from robotree.vr.base.envelope import Envelope, this_clock
from robotree.vr.base.errors import Denied
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import Voucher
from robotree.vr.base.requests import (
    AnyRequest,
    CancelOrder,
    LeaveOrder,
    MarkSeen,
    Raised,
    Reply,
    decode_reply,
)
from tests.vr.orders.conftest import Rover, Stage
from tests.vr.orders.test_orders import remembered

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


async def ask_as(stage: Stage, person: str, key: str, request: AnyRequest) -> Reply:
    """Ask for a person with a key of the realm, as a gateway does."""
    proof = msgspec.msgpack.encode(Voucher(person, person, 7, member=True))
    transport = stage.transports["operator"]
    body = msgspec.msgpack.encode(Envelope(request, "", stage.loop.time(), 5.0, this_clock(), proof, "pts/1"))
    async for reply in transport.request(key, body, timeout=5.0):
        found = decode_reply(reply, key=key)
        if isinstance(found, Raised):
            raise found.revive()
        return found
    raise AssertionError("no answer")


async def test_who_may_not_order_leaves_nothing_and_ends_nothing_of_others(stage: Stage) -> None:
    stage.network.gate = gate = PolicyGate()
    directory = await stage.directory("d1")
    await stage.person()
    ledger = await remembered(stage)
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
        await ask_as(stage, "ben", directory.address.key, leave)
    with pytest.raises(Denied):
        await ask_as(
            stage,
            "anna",
            directory.address.key,
            msgspec.structs.replace(leave, key="f" * 16, command="go_to"),
        )
    await ask_as(stage, "anna", directory.address.key, leave)
    with pytest.raises(Denied):
        await ask_as(stage, "ben", directory.address.key, CancelOrder(key=leave.key))
    gate.policy = read_policy(f"realm: test\nversion: 2\n{NO_MORE}")
    rover = Rover("r1")
    await stage.robot(rover, ledger)
    await stage.until(lambda: directory.book.store.orders[leave.key].over)
    order = directory.book.store.orders[leave.key]
    assert (order.state, rover.done) == ("refused", [])
    assert "anna" in order.why
    await ask_as(stage, "ben", directory.address.key, MarkSeen(keys=(leave.key,)))  # it is not his
    assert not directory.book.store.orders[leave.key].seen
    await ask_as(stage, "anna", directory.address.key, MarkSeen(keys=(leave.key,)))
    assert directory.book.store.orders[leave.key].seen
