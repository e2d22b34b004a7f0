"""Robots that find their place: two sites, a slow line, real meshes, gateways, threads and journals."""

from __future__ import annotations

import asyncio
import time

import pytest

from robotree.vr.base.requests import DescribeHost, HostDescribed
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.client import RobotClient
from tests.vr.moving.test_between_sites import Home, homes
from tests.vr.moving.test_moves import LEAF, TOUR
from tests.vr.sites.site import MemoryHub, hub, sites
from tests.waiting import PATIENCE, until

__all__ = ["homes", "hub", "sites"]

pytestmark = pytest.mark.real_threads

DELAY = 0.1
"""[s] one way between the sites."""


def tour(*options: str) -> str:
    """Return a page of a tour with options of its class."""
    head = "class Tour(VirtualRobot):\n"
    assert head in TOUR
    return TOUR.replace(head, head + "".join(f"    {option}\n" for option in options))


AUTO = 'placement = "auto"'


def slow(hub: MemoryHub) -> None:
    """Delay what crosses between the sites."""
    loop = asyncio.get_running_loop()

    def hold(topic: str, body: bytes) -> list[bytes]:
        loop.call_soon_threadsafe(loop.call_later, DELAY, hub.inject, topic, body)
        return []

    hub.on_way = hold


async def test_a_robot_moves_beside_the_one_that_it_calls_and_says_why(
    homes: dict[str, Home], hub: MemoryHub
) -> None:
    near, far = homes["lab:h1"], homes["hall:h2"]
    slow(hub)
    robots: dict[str, RobotClient] = {}
    for name, page in {"placed": tour(AUTO), "pinned": tour(AUTO, "pinned = True"), "asked": tour()}.items():
        leaf = await far.create(f"leaf-{name}", LEAF)
        robots[name] = await near.create(name, page)
        await until(lambda key=leaf.address.key: near.site.member.presence.there(key))  # type: ignore[misc]
        await robots[name].enslave("arm", leaf.address)
    assert "better off" in await robots["asked"].place("advise")
    for home in (near, far):
        home.host.finds_places(used=lambda: 0.0)
    advised, over = near.host.agents["asked"].runtime, asyncio.Event()
    latest = time.monotonic() + PATIENCE

    async def work(name: str) -> None:
        """Have a robot tour until all have found out, and see that nothing is done twice or left out."""
        tours = 0
        while not over.is_set() and time.monotonic() < latest:
            assert await robots[name].call("tour", {"steps": 15}, deadline=PATIENCE) == list(range(15))
            tours += 1
            assert far.fields(f"leaf-{name}")["done"] == list(range(15)) * tours
            if far.has("placed") and advised.advised == "hall:h2":
                over.set()

    await asyncio.gather(*map(work, robots))
    assert (near.has("pinned"), near.has("asked"), near.has("placed")) == (True, True, False)
    shown = await robots["placed"].describe()
    assert shown.placement == "auto"
    assert shown.placed.startswith("hall:h2 is nearer than h1: its ")
    assert (await robots["pinned"].describe()).advice == "its author has pinned it"
    assert "hall:h2 is nearer" in (await robots["asked"].describe()).advice
    (slot,) = (await robots["asked"].describe()).slots
    assert slot.round_trip > 1.5 * DELAY
    described = await ask(
        near.site.member, near.host.address.key, DescribeHost(), HostDescribed, timeout=PATIENCE
    )
    assert described.ways[far.host.address.key] > 1.5 * DELAY
    assert described.load is not None
    assert described.load.robots == 2
