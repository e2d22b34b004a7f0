"""One assistant over robots in memory: its budgets, its flood, its end, and a key that is taken back."""

from __future__ import annotations

import asyncio
import contextlib
import time
from pathlib import Path
from types import SimpleNamespace

import mcp_types as types
import msgspec
import pytest

from robotree.assistants import record
from robotree.assistants import seat as seats
from robotree.assistants.budget import Budget, Use
from robotree.assistants.record import Record
from robotree.assistants.server import AssistantServer
from robotree.vr.base.errors import AssistantUnknown, BudgetSpent, PermitNeeded
from robotree.vr.base.policy import AssistantTerms
from tests.assistants.hall import STEP, Cart, Hall
from tests.waiting import PATIENCE, until


def test_what_was_used_counts_for_its_time_whatever_the_clock_does(tmp_path: Path) -> None:
    terms, now = AssistantTerms(calls=2, metres=3.0, seconds=10.0), [1e6]
    budget = Budget([Use(1e6 + 500, "metres", 2.5)])  # the clock was put back since
    assert budget.left("metres", terms, 1e6) == 0.5
    assert budget.left("metres", terms, 1e6 + 500 + 3600) == 3.0

    def spend(found: Budget, at: float) -> None:
        found.expect("calls", terms, at, assistant="claude")
        found.use("calls", 1.0, at)

    def spend_thrice(found: Budget, at: float) -> None:
        for _ in range(3):
            spend(found, at)

    for _ in range(2):
        Record(tmp_path, "claude", lambda: now[0]).change(spend)
    again = Record(tmp_path, "claude", lambda: now[0])  # a server that is started anew
    with pytest.raises(BudgetSpent, match="calls") as spent:
        again.change(spend)
    assert spent.value.data["seconds"] == 60
    Record(tmp_path, "other", lambda: now[0]).change(spend)
    now[0] += 60.0
    with pytest.raises(BudgetSpent):
        again.change(spend_thrice)
    again.change(spend)
    assert again.budget().used("calls", now[0]) == 1


def test_many_uses_are_a_short_list_and_none_is_forgotten_early() -> None:
    terms, budget = AssistantTerms(calls=10_000), Budget()
    for number in range(6000):
        budget.use("calls", 1.0, 1e6 + number / 100)
    assert len(budget.uses) <= 121
    assert budget.used("calls", 1e6 + 59.99) == 6000
    for later in (10.0, 30.0, 59.0):
        truly = sum(number / 100 > later for number in range(6000))
        assert truly <= budget.used("calls", 1e6 + 60 + later) <= truly + 51
    assert budget.left("calls", terms, 1e6 + 120) == 10_000


async def test_its_robots_move_as_far_as_its_metres_go(hall: Hall) -> None:
    going = await hall.far(", metres: 0.2")
    assert await going.wait(PATIENCE)
    assert "has used its 0.2 m an hour" in str(going.error)
    assert going.way.metres > 0.2
    await until(lambda: hall.agent.description().busy == "", "it has ended")
    with pytest.raises(BudgetSpent, match="metres"):
        await hall.walk(1001.0)
    looked = await hall.seat.call("cart-1", "where", {}, "to look", 5.0)
    assert await looked.wait(PATIENCE)
    assert looked.result() == hall.cart.at, "who only reads moves nothing"


async def test_its_commands_run_as_long_as_its_seconds_go(hall: Hall) -> None:
    hall.rule(", seconds: 0.4")
    going = await hall.seat.call("cart-1", "wait", {}, "to see", 60.0)
    assert going.call.deadline <= 0.4
    assert await going.wait(PATIENCE)
    assert going.error is not None
    assert hall.seat.record.budget().left("seconds", hall.seat.terms, time.time()) < 0.2
    hall.seat.record.change(lambda budget, now: budget.use("seconds", 0.2, now))
    with pytest.raises(BudgetSpent, match="seconds of motion"):
        await hall.walk(0.01)


async def test_a_flood_is_not_dealt_with_and_a_stop_in_it_is_heard(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [1000.0]
    monkeypatch.setattr(seats, "time", SimpleNamespace(monotonic=lambda: now[0], time=lambda: 1e6))
    server = AssistantServer(hall.seat)
    for _ in range(seats.REQUESTS):
        hall.seat.touch()
    with pytest.raises(BudgetSpent, match="requests: 50 of 50 a second"):
        hall.seat.touch()
    with server._request(urgent=True):
        assert await hall.seat.stop(None) == ("cart-1",)
    assert hall.stopped
    now[0] += 1.0
    hall.seat.touch()


@pytest.mark.parametrize("gone", ["hold", "stop", "finish"])
async def test_when_it_is_gone_its_robots_do_what_the_policy_says(hall: Hall, gone: str) -> None:
    going = await hall.far(f", gone: {gone}")
    closing = asyncio.create_task(hall.seat.close())
    if gone == "finish":
        here = hall.cart.at
        await until(lambda: hall.cart.at > here + 5 * STEP, "it walks on")
        assert not going.over
        going.end("enough")
    assert await going.wait(PATIENCE)
    await closing
    await until(lambda: hall.agent.description().busy == "", "it has ended")
    assert hall.stopped == (gone == "stop")
    assert f"it has gone: {gone}" in [one.text for one in hall.seat.record.entries()]


async def test_a_key_that_is_taken_back_ends_what_runs(hall: Hall) -> None:
    going = await hall.far()
    hall.keys.revoke("claude")
    assert await going.wait(PATIENCE)
    assert "is gone" in str(going.error)
    await until(lambda: hall.agent.description().busy == "", "it has ended")
    with pytest.raises(AssistantUnknown, match="taken back"):
        hall.seat.touch()
    assert "its key was taken back: hold" in [one.text for one in hall.seat.record.entries()]


async def test_who_is_silent_while_something_runs_is_gone(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    going = await hall.far()
    hall.seat.open = 1  # a request waits for its answer: it is there
    monkeypatch.setattr(seats, "LEASE", 0.1)
    here = hall.cart.at
    await until(lambda: hall.cart.at > here + 20 * STEP, "it walks on")
    assert not going.over
    hall.seat.open = 0
    assert await going.wait(PATIENCE)
    assert "is gone" in str(going.error)


async def test_the_same_call_asked_twice_is_one_permit(hall: Hall) -> None:
    hall.rule(right="ask")
    found: list[object] = []
    for x, why in ((1.0, "first"), (1.0, "again"), (2.0, "another")):
        with pytest.raises(PermitNeeded) as needed:
            await hall.seat.call("cart-1", "walk", {"x": x}, why, 60.0)
        found.append(needed.value.data["permit"])
    assert found[0] == found[1] != found[2]
    hall.floor.permits.answer(str(found[0]), yes=False, by="anna")
    with pytest.raises(PermitNeeded) as needed:
        await hall.seat.call("cart-1", "walk", {"x": 1.0}, "after a no", 60.0)
    assert needed.value.data["permit"] not in found


def test_what_is_used_is_one_line_each_and_is_written_anew_when_it_is_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record, "LONGEST_LOG", 1000)
    here, there = Record(tmp_path, "claude", lambda: 1e6), Record(tmp_path, "claude", lambda: 1e6)

    def move(budget: Budget, now: float) -> None:
        budget.use("metres", 1.0, now)

    path, sizes = tmp_path / "assistants" / "claude.used.json", list[int]()
    for number in range(40):
        (here if number % 3 else there).change(move)
        here.sync()
        sizes.append(path.stat().st_size)
    assert max(sizes) <= 1000
    assert here.budget().used("metres", 1e6) == there.budget().used("metres", 1e6) == 40
    assert Record(tmp_path, "claude", lambda: 1e6).budget().used("metres", 1e6) == 40
    path.write_bytes(msgspec.json.encode([Use(1e6, "metres", 2.0)]))  # as earlier versions wrote it
    here.change(move)
    assert there.budget().used("metres", 1e6) == 3


async def test_robots_of_one_kind_share_what_their_tools_have_in_common(hall: Hall) -> None:
    async with contextlib.AsyncExitStack() as stack:
        await hall.bring(stack, Cart("cart-2"))
        await until(lambda: len(hall.floor.catalogue.robots) == 2, "both are listed")
        tools = hall.seat.tools()
        assert tools["cart-1__walk"].schema is tools["cart-2__walk"].schema
        assert "robot cart-2 (Cart)" in tools["cart-2__walk"].description
        await hall.bring(stack, Cart("cart-3"))
        await until(lambda: len(hall.floor.catalogue.robots) == 3, "one more is listed")
        assert hall.seat.tools()["cart-1__walk"] is tools["cart-1__walk"], "only the new one's are made"
        listed = types.ListToolsResult.model_validate(
            {"tools": AssistantServer(hall.seat)._tools_page(None)[0], "resultType": "complete"}
        )
        assert "cart-3__walk" in {tool.name for tool in listed.tools}
