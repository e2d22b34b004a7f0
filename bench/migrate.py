"""How long a robot pauses when it moves between two hosts, and how long a host takes that all robots leave.

    python bench/migrate.py [--moves N] [--robots N]

A robot walks over a child in a third process and moves to and fro in the middle of its command. The pause is
what the hosts measure: from the moment when its code is to come to a stand to the one when the other host
says that it has it. Beside it a bare call of the child, and a bare fdatasync(2), in the same run.
"""

from __future__ import annotations

import asyncio
import os
import re
import statistics
import time
from pathlib import Path

import hosts
from hosts import HostProcess, counters
from measuring import apart, clock, cpu, options, quantile, tell

from robotree.client.joining import joined
from robotree.vr.supervision.realm_client import RealmClient


async def moved(realm_client: RealmClient, moves: int) -> dict[str, float]:
    """Measure the pauses of moves in the middle of a command."""
    await realm_client.create(hosts.__file__, "walker", "h1", "Top")
    await realm_client.enslave("walker", "below", "counter")
    bare = statistics.median(await realm_client.call("walker", "measure", {"repeats": 200}))
    seconds = moves * 0.5 + 20.0
    walk = asyncio.ensure_future(
        realm_client.call("walker", "walk", {"seconds": seconds}, deadline=2 * seconds)
    )
    pauses: list[float] = []
    for number in range(moves):
        await asyncio.sleep(0.1)
        note = await realm_client.migrate("walker", "h1" if number % 2 else "h2")
        found = re.search(r"([\d.]+) ms", note)
        pauses.append(float(found[1]) if found else float("nan"))
    await realm_client.cancel("walker")
    await asyncio.gather(walk, return_exceptions=True)
    first, *warm = pauses
    return {
        "pause, first, ms": first,
        "pause, p50, ms": statistics.median(warm),
        "pause, p99, ms": quantile(warm, 0.99),
        "bare call of the child, us": bare,
    }


def synced(folder: Path, rounds: int = 50) -> float:
    """Return how long a bare fdatasync of a small append takes [ms], the median."""
    times: list[float] = []
    with (folder / "bare").open("ab", buffering=0) as file:
        for _ in range(rounds):
            file.write(bytes(4000))
            times += clock(lambda: os.fdatasync(file.fileno()), 1)
    return statistics.median(times) / 1e3


async def left(realm_client: RealmClient, robots: int, homes: list[HostProcess]) -> dict[str, float]:
    """Measure how long it takes until many robots have left a host, and what the busier host has to do."""
    for start in range(0, robots, 20):
        names = [f"idle-{number}" for number in range(start, min(start + 20, robots))]
        await asyncio.gather(*(realm_client.create(hosts.__file__, name, "h1", "Bottom") for name in names))
    before, began = [cpu(host.process.pid) for host in homes], time.perf_counter()
    gone = await realm_client.drain("h1")
    seconds = time.perf_counter() - began
    most = max(cpu(host.process.pid) - used for host, used in zip(homes, before, strict=True))
    return {f"{len(gone)} robots have left, s": seconds, "processor of the busier host, s": most}


async def run(folder: Path, moves: int, robots: int) -> dict[str, float]:
    """Start all, and measure."""
    homes = [HostProcess(name, folder / name) for name in ("h1", "h2")]
    async with counters("counter"), joined("bench") as realm_client:
        try:
            for host in homes:
                host.start()
                await realm_client.arrival("host", host.name, within=30.0)
            await realm_client.arrival("robot", "counter", within=30.0)
            sync = {"bare fdatasync, ms": synced(folder)}
            return {**sync, **await moved(realm_client, moves), **await left(realm_client, robots, homes)}
        finally:
            for host in homes:
                host.kill()


if __name__ == "__main__":
    given = options(__doc__, moves=200, robots=1000)
    with apart() as folder:
        tell(asyncio.run(run(folder, given.moves, given.robots)))
