"""A call of a program against the call that the supervisor makes inside, between real processes.

    python bench/programs.py [CALLS]

One interleaved run; a robot on a host carries out a command that does nothing.
"""

from __future__ import annotations

import os
import statistics
from pathlib import Path

from measuring import apart, clock, clocked, count_given, started

from robotree import connect
from robotree.client.asynchronous import AsyncRealm
from robotree.client.blocking import Realm

PAGE = """
from robotree.vr import VirtualRobot, command

class Idle(VirtualRobot):
    @command
    def rest(self) -> int:
        return 1
"""
ROUND = 50
"""Calls of one kind before it is the other's turn."""


async def inside(realm: AsyncRealm) -> list[float]:
    """Return how long each of some calls of `RealmClient` took [s]."""
    return await clocked(ROUND, lambda _: realm.realm_client.call("idle", "rest", {}))


async def outside(realm: AsyncRealm) -> list[float]:
    """Return the same for the client of asyncio."""
    return await clocked(ROUND, lambda _: realm["idle"].rest())


def measure(realm: Realm, page: Path, calls: int) -> None:
    """Play the rounds."""
    idle = realm.create(str(page), "idle")
    taken: dict[str, list[float]] = {"inside": [], "asyncio": [], "blocking": []}
    for _ in range(calls // ROUND):
        taken["inside"] += realm.wait_for(inside(realm.behind))
        taken["asyncio"] += realm.wait_for(outside(realm.behind))
        taken["blocking"] += [each / 1e6 for each in clock(idle.rest, ROUND)]
    base = statistics.median(taken["inside"])
    for name, seconds in taken.items():
        middle = statistics.median(seconds)
        print(f"{name:10} {middle * 1e6:8.0f} us  {middle / base:5.2f}x  n={len(seconds)}")


if __name__ == "__main__":
    with apart() as folder:
        os.environ.pop("ROBOTREE_REALM")
        page = folder / "idle.py"
        page.write_text(PAGE)
        words = (("lookup", "l1"), ("host", "h1"))
        with started(*(("-m", "robotree.tui", *each) for each in words)), connect() as realm:
            measure(realm, page, count_given(1, 2000))
