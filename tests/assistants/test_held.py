"""What attackers tried at a seat: to use limits twice, to keep a key that was replaced, to forget stops."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import httpx2
import pytest

from robotree.assistants import record
from robotree.assistants.keys import GOOD, AssistantKeys
from robotree.assistants.record import Record
from robotree.assistants.seat import Going
from robotree.assistants.serving import over_http
from robotree.vr.base.errors import AssistantUnknown, BudgetSpent, PermitNeeded, PermitRefused
from tests.assistants.hall import Hall, Lift
from tests.waiting import PATIENCE, until


async def test_calls_at_the_same_time_share_what_is_left(hall: Hall) -> None:
    hall.rule(", metres: 0.3, seconds: 90")
    begun: list[Going] = []
    refused = 0
    tried = [hall.seat.call("cart-1", "walk", {"x": 1000.0}, "w", 60.0) for _ in range(4)]
    for each in await asyncio.gather(*tried, return_exceptions=True):
        if isinstance(each, BudgetSpent):
            refused += 1
        else:
            assert isinstance(each, Going)
            begun.append(each)
    assert refused == 3, "the first has booked all metres"
    for going in begun:
        going.end("enough")
        assert await going.wait(PATIENCE)
    left = hall.seat.record.budget().left("seconds", hall.seat.terms, time.time())
    assert left > 60, "what was not used is given back"
    hall.rule(", seconds: 90")
    both = [await hall.walk(1000.0) for _ in range(2)]
    assert sum(going.call.deadline for going in both) <= left
    with pytest.raises(BudgetSpent, match="seconds"):
        await hall.walk(1000.0)
    assert not any(going.over for going in both)


async def test_what_is_booked_is_on_the_disk_before_the_call_is_sent(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    left: dict[str, float] = {}

    async def sent(*_given: Any, **_named: Any) -> None:
        found = Record(hall.folder, "claude").budget()  # as a server sees it that is started after a kill
        now = time.time()
        left["seconds"] = found.left("seconds", hall.seat.terms, now)
        left["metres"] = found.left("metres", hall.seat.terms, now)

    monkeypatch.setattr(hall.realm_client, "carry_out", sent)
    hall.rule(", metres: 5, seconds: 90")
    going = await hall.walk(1.0)
    assert await going.wait(PATIENCE)
    assert left["seconds"] <= 30
    assert left["metres"] < 5
    assert hall.seat.record.budget().left("metres", hall.seat.terms, time.time()) == 5


async def test_metres_are_booked_on_as_robots_move(hall: Hall) -> None:
    going = await hall.far(", metres: 100")
    first = going.metres
    await until(lambda: going.metres > first, "more is booked")
    kept = Record(hall.folder, "claude").budget()
    assert kept.used("metres", time.time()) >= going.metres > first
    going.end("enough")
    assert await going.wait(PATIENCE)
    used = Record(hall.folder, "claude").budget().used("metres", time.time())
    assert used == pytest.approx(going.way.metres)


async def test_who_cannot_be_counted_does_not_go_on(hall: Hall) -> None:
    going = await hall.far()
    (hall.folder / "assistants" / "claude.used.json").write_text("{")
    await until(lambda: going.why_ended != "", "it is ended")
    assert "cannot be kept" in going.why_ended
    assert await going.wait(PATIENCE)
    assert [one.became for one in hall.seat.record.entries()][-1] == "failed", "its end is written down"


@pytest.mark.parametrize("stopped", ["", "cart-1"])
async def test_a_stop_of_a_robot_below_makes_a_permit_void(hall: Hall, stopped: str) -> None:
    async with contextlib.AsyncExitStack() as stack:
        await hall.bring(stack, Lift("lift-1"))
        await until(lambda: "lift-1" in hall.floor.catalogue.robots, "it is listed")
        await hall.realm_client.enslave("lift-1", "cart", "cart-1")
        hall.rule(right="ask")
        with pytest.raises(PermitNeeded) as needed:
            await hall.seat.call("lift-1", "raise_it", {"x": 0.05}, "w", 5.0)
        permit = needed.value.data["permit"]
        hall.floor.permits.answer(permit, yes=True, by="anna")
        if stopped:
            await hall.realm_client.stop(stopped)
            await until(lambda: hall.stopped, "it is stopped")
            await hall.realm_client.resume("lift-1")
            await until(lambda: not hall.stopped, "it is released")
            with pytest.raises(PermitRefused, match="a robot below it was stopped"):
                await hall.seat.begin(permit)
        else:
            going = await hall.seat.begin(permit)
            assert await going.wait(PATIENCE)


async def test_a_key_that_was_replaced_ends_what_the_old_one_began(hall: Hall) -> None:
    going = await hall.far()
    hall.keys.invite("claude")
    assert await going.wait(PATIENCE)
    assert "is gone" in str(going.error)
    with pytest.raises(AssistantUnknown, match="taken back"):
        hall.seat.touch()


async def test_a_key_that_has_ended_is_good_no_more(tmp_path: Path) -> None:
    now = [1e6]
    keys = AssistantKeys(tmp_path, lambda: now[0])
    name, proof = keys.proved(keys.invite("claude"))
    assert keys.good(name, proof)
    now[0] += GOOD
    assert not keys.good(name, proof)


HELLO = {
    "protocolVersion": "2025-06-18",
    "capabilities": {},
    "clientInfo": {"name": "test", "version": "1"},
}


class Door:
    """The door over HTTP, and clients that keep to no protocol in how they leave."""

    def __init__(self, address: str) -> None:
        self.address = address
        self.http = httpx2.AsyncClient(timeout=PATIENCE)

    def _sent(self, key: str, session: str) -> dict[str, str]:
        sent = {"Authorization": f"Bearer {key}", "Accept": "application/json, text/event-stream"}
        return sent | ({"Mcp-Session-Id": session} if session else {})

    async def hello(self, key: str) -> tuple[int, str]:
        """Open a session; return the status and its name."""
        body = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": HELLO}
        answer = await self.http.post(self.address, headers=self._sent(key, ""), json=body)
        session = answer.headers.get("mcp-session-id", "")
        if session:
            ready = {"jsonrpc": "2.0", "method": "notifications/initialized"}
            await self.http.post(self.address, headers=self._sent(key, session), json=ready)
        return answer.status_code, session

    def calling(self, key: str, session: str, tool: str, given: dict[str, Any]) -> Any:
        """Return the stream of an answer, to be left at will."""
        params = {"name": tool, "arguments": given}
        body = {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": params}
        return self.http.stream("POST", self.address, headers=self._sent(key, session), json=body)


@pytest.fixture
async def door(hall: Hall) -> AsyncIterator[Door]:
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(over_http(hall.floor, hall.keys, 0, ready.set_result))
    found = Door(await ready)
    yield found
    await found.http.aclose()
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)


async def test_a_command_does_not_outlive_the_connection_that_waits_for_it(hall: Hall, door: Door) -> None:
    key = hall.keys.invite("claude")
    _, session = await door.hello(key)
    walk = {"x": 1000.0, "_why": "w"}
    async with door.calling(key, session, "cart-1__walk", walk) as answer:
        assert answer.status_code == 200
        await until(lambda: hall.cart.at > 0, "it walks")
    await until(lambda: hall.agent.description().busy == "", "it has ended")
    ends = [one.text for one in Record(hall.folder, "claude").entries() if one.became == "failed"]
    assert "the connection of the assistant has ended" in ends[-1]


async def test_who_has_a_new_key_is_served_and_who_has_the_old_one_is_not(hall: Hall, door: Door) -> None:
    first = hall.keys.invite("claude")
    assert (await door.hello(first))[0] == 200
    hall.keys.revoke("claude")
    assert (await door.hello(first))[0] == 401
    second = hall.keys.invite("claude")
    _, session = await door.hello(second)
    assert session
    async with door.calling(second, session, "cart-1__where", {"_why": "w"}) as answer:
        assert '"result"' in (await answer.aread()).decode()
    assert (await door.hello(first))[0] == 401


async def test_what_was_refused_pushes_nothing_out_of_the_record(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(record, "LARGEST", 20_000)
    going = await hall.walk(0.01)
    assert await going.wait(PATIENCE)
    for number in range(30):
        hall.seat.record.write("refused", command="x" * 4000, text=f"{number}")
    for _ in range(3):
        await hall.seat.stop("cart-1")
    assert {"begun", "done"} <= {one.became for one in Record(hall.folder, "claude").entries(1000)}
