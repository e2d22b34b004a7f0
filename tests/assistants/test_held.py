"""What attackers tried at a seat: to use limits twice, to keep a key that was replaced, to forget stops."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from robotree.assistants import seat as seats
from robotree.assistants.record import Record
from robotree.assistants.seat import Going
from robotree.vr.base.errors import BudgetSpent
from tests.assistants.hall import Hall, opened
from tests.waiting import PATIENCE, until


@pytest.fixture
async def hall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Hall]:
    monkeypatch.setattr(seats, "LEASE", 10 * PATIENCE)  # no request comes here
    async with opened(tmp_path) as found:
        yield found


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
    deadlines = [(await hall.walk(1000.0)).call.deadline for _ in range(2)]
    assert sum(deadlines) <= left
    with pytest.raises(BudgetSpent, match="seconds"):
        await hall.walk(1000.0)


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
