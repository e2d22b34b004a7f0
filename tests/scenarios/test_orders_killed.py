"""Orders of a real rover whose process, and whose directories, are killed at any moment."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import signal
from collections import Counter
from pathlib import Path

import pytest

from robotree.client.joining import joined
from robotree.tui.demo_crash import begun_in
from robotree.tui.processes.crew import Crew
from robotree.vr.base.errors import VrError
from robotree.vr.base.order import Order
from robotree.vr.supervision.realm_client import RealmClient

pytestmark = [pytest.mark.e2e]

REALM = "killed"
PATIENCE = 120.0
"""[s] for all to have a result; a busy machine starts a process in several."""
BY_ITS_LINK = "failed: rover-1.move was cancelled: The link to who commands has ended"
"""What becomes of a motion whose proxy is killed in its middle: its controller holds (decision 0020)."""
AT_ONCE = 3
"""Orders that wait together."""


async def leave(realm_client: RealmClient, step: float) -> str:
    """Leave an order, at whichever directory answers."""
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                return (await realm_client.orders.leave("rover-1", "move", {"x": step, "y": 0.0})).order.key
            except VrError:
                await asyncio.sleep(0.2)


def outcome(order: Order) -> str:
    """Return the state of an order that is over; of one that was not done with the reason."""
    return order.state if order.state == "done" else f"{order.state}: {order.why}"


async def until_over(realm_client: RealmClient, keys: list[str]) -> dict[str, str]:
    """Wait until each order has its result; returns by key what has become of it."""
    async with asyncio.timeout(PATIENCE):
        while True:
            try:
                found = {each.key: each for each in (await realm_client.orders.board()).orders}
            except VrError:
                found = {}
            if all(key in found and found[key].over for key in keys):
                return {key: outcome(found[key]) for key in keys}
            await asyncio.sleep(0.2)


async def campaign(folder: Path, kills: int, seed: int) -> Counter[str]:
    """Kill processes at random moments; returns what became of how many orders.

    Nothing is carried out twice, and each order has its result.
    """
    chance, states, goals = random.Random(seed), Counter[str](), folder / "goals"
    async with Crew(REALM, key="none", restarts=True) as crew:
        sim, *_ = await crew.start_all(
            ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", "none", "--log", str(goals)),
            ("directory", "d1"),
            ("directory", "d2"),
        )
        await crew.start("proxy", "rover", "rover-1", "--connect", sim.address)
        async with joined(REALM) as realm_client:
            async with asyncio.timeout(PATIENCE):
                while await realm_client.orders.robot("rover-1") is None:  # noqa: ASYNC110
                    await asyncio.sleep(0.1)
            done, keys = 0, list[str]()
            while done < kills:
                new = [await leave(realm_client, chance.choice([0.05, -0.05])) for _ in range(AT_ONCE)]
                keys += new
                for _ in range(min(2, kills - done)):
                    await asyncio.sleep(chance.uniform(0.0, 1.0))
                    victims = [each for each in crew.members if each.words[0] in {"proxy", "directory"}]
                    victim = chance.choice(sorted(victims, key=lambda each: each.words))
                    with contextlib.suppress(ProcessLookupError):  # it is just being started again
                        os.kill(victim.pid, signal.SIGKILL)
                        done += 1
                states.update((await until_over(realm_client, new)).values())
    begun = Counter(goal.key for goal in begun_in(goals))
    assert max(begun.values(), default=0) <= 1, "a motion has begun twice"
    assert len(begun) <= len(keys)
    assert states["done"] <= len(begun)
    assert {each for each in states if each.startswith("failed")} <= {BY_ITS_LINK}, "an unexplained failure"
    return states


@pytest.mark.timeout(400)
async def test_orders_survive_kills_of_robot_and_directories(place: Path) -> None:
    states = await campaign(place, 4, 1)
    assert states.total() == 2 * AT_ONCE
    assert states["done"]


@pytest.mark.soak
@pytest.mark.timeout(3600)
async def test_three_hundred_kills(place: Path) -> None:
    states = await campaign(place, 300, 2)
    assert states["done"]
