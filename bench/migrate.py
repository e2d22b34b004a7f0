"""How long a robot pauses when it moves between two hosts, and how long a host takes that all robots leave.

    python bench/migrate.py [--moves N] [--robots N] [--json]

A robot walks over a child in a third process and moves to and fro in the middle of its command. The pause is
what the hosts measure: from the moment when its code is to come to a stand to the one when the other host
says that it has it. Beside it a bare call of the child, and a bare fdatasync(2), in the same run.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from robotree.client.joining import joined
from robotree.vr.supervision.realm_client import RealmClient

sys.path.insert(0, str(Path(__file__).parents[1]))
from bench import hosts
from bench.hosts import HostProcess, counters

REALM = "bench-migrate"


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
    warm.sort()
    return {
        "first_ms": first,
        "p50_ms": statistics.median(warm),
        "p99_ms": warm[min(len(warm) - 1, int(len(warm) * 0.99))],
        "call_us": bare,
    }


def synced(folder: Path, rounds: int = 50) -> float:
    """Return how long a bare fdatasync of a small append takes [ms], the median."""
    times: list[float] = []
    with (folder / "bare").open("ab", buffering=0) as file:
        for _ in range(rounds):
            file.write(bytes(4000))
            began = time.perf_counter()
            os.fdatasync(file.fileno())
            times.append((time.perf_counter() - began) * 1e3)
    return statistics.median(times)


async def left(realm_client: RealmClient, robots: int, homes: list[HostProcess]) -> dict[str, float]:
    """Measure how long it takes until many robots have left a host, and what the busier host has to do."""
    for start in range(0, robots, 20):
        names = [f"idle-{number}" for number in range(start, min(start + 20, robots))]
        await asyncio.gather(*(realm_client.create(hosts.__file__, name, "h1", "Bottom") for name in names))
    before, began = [host.used for host in homes], time.perf_counter()
    gone = await realm_client.drain("h1")
    seconds = time.perf_counter() - began
    most = max(host.used - used for host, used in zip(homes, before, strict=True))
    return {"robots": float(len(gone)), "seconds": seconds, "cpu_s": most}


async def run(moves: int, robots: int) -> dict[str, Any]:
    """Start all, and measure."""
    with tempfile.TemporaryDirectory() as folder:
        homes = [HostProcess(name, Path(folder, name), realm=REALM) for name in ("h1", "h2")]
        async with counters("counter", realm=REALM), joined(REALM) as realm_client:
            try:
                for host in homes:
                    host.start()
                    await realm_client.arrival("host", host.name, within=30.0)
                await realm_client.arrival("robot", "counter", within=30.0)
                sync = synced(Path(folder))
                found = {**await moved(realm_client, moves), **await left(realm_client, robots, homes)}
                return {**found, "sync_ms": sync}
            finally:
                for host in homes:
                    host.kill()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=200)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found = asyncio.run(run(given.moves, given.robots))
    if given.json:
        print(json.dumps(found))
        return
    first, half, most = found["first_ms"], found["p50_ms"], found["p99_ms"]
    print(f"pause: first {first:.1f} ms, then p50 {half:.1f}, p99 {most:.1f} ms")
    print(
        f"(a bare call of the child: {found['call_us']:.0f} us; a bare fdatasync: {found['sync_ms']:.2f} ms)"
    )
    print(
        f"{found['robots']:.0f} robots have left their host within {found['seconds']:.1f} s;"
        f" the busier host had {found['cpu_s']:.1f} s of a processor, load {os.getloadavg()[0]:.0f}"
    )


if __name__ == "__main__":
    main()
