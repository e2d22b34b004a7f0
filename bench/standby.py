"""How soon a stand-by host has the robots of one that was killed, and what a journal in PostgreSQL costs.

    python bench/standby.py [--rounds N] [--take-overs N] [--json]

Two hosts, one with its journal in a folder and one in a PostgreSQL of its own on this machine, take the same
calls of a child in another process in turns, in one run; beside them a bare INSERT of as many bytes. A
take-over is measured from `kill -9` to the next effect; the stand-by waits 2.5 s from the last sign of life,
which came up to 0.5 s before.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
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
from bench.hosts import REPEATS, HostProcess, counters, next_effect
from tests.vr.space.postgres import lacking, server

FRAME = 185
"""[bytes] in the journal for a call between processes."""


async def bind(realm_client: RealmClient, host: HostProcess) -> str:
    """Make a robot on a host, on top of its counter; returns its name."""
    while not realm_client.directory.present("host", host.name):  # noqa: ASYNC110 # a table, which tells nobody
        await asyncio.sleep(0.01)
    await realm_client.create(hosts.__file__, f"top-{host.name}", host.name, "Top")
    await realm_client.enslave(f"top-{host.name}", "below", f"of-{host.name}")
    return f"top-{host.name}"


async def steps(realm_client: RealmClient, folder: Path, url: str, rounds: int) -> dict[str, float]:
    """Measure calls with both journals, in turns."""
    hosts = {"folder": HostProcess("kept", folder / "kept"), "postgres": HostProcess("far", folder, url=url)}
    times: dict[str, list[float]] = {way: [] for way in hosts}
    bare: list[float] = []
    for host in hosts.values():
        host.start()
    try:
        names = {way: await bind(realm_client, host) for way, host in hosts.items()}
        for _ in range(rounds):
            for way, name in names.items():
                times[way] += await realm_client.call(name, "measure", {"repeats": REPEATS})
            bare += inserts(url)
    finally:
        for host in hosts.values():
            host.kill()
    found = {f"call, journal in {way}, us": statistics.median(each) for way, each in times.items()}
    return {**found, "bare INSERT, us": statistics.median(bare)}


def inserts(url: str) -> list[float]:
    """Insert as many bytes as a call keeps, many times; the times [us]."""
    import psycopg

    times: list[float] = []
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("CREATE TABLE IF NOT EXISTS bare (body bytea)")
        for _ in range(REPEATS):
            began = time.perf_counter()
            connection.execute("INSERT INTO bare VALUES (%s)", (bytes(FRAME),))
            times.append((time.perf_counter() - began) * 1e6)
    return times


async def take_overs(realm_client: RealmClient, folder: Path, url: str, count: int) -> dict[str, float]:
    """Kill the host of a command; each time another one stands by, and has its robots then."""
    first = HostProcess("h0", folder / "log", url=url)
    first.start()
    name = await bind(realm_client, first)
    call = asyncio.ensure_future(realm_client.call(name, "patrol", {}, deadline=600.0))
    await next_effect(time.monotonic())
    took: list[float] = []
    host = first
    for number in range(1, count + 1):
        following = HostProcess(f"h{number}", folder / "log", of="h0", url=url)
        following.start()
        await asyncio.sleep(1.0)
        host.kill()
        killed = time.monotonic()
        took.append(await next_effect(killed + 0.5) - killed)
        host = following
    call.cancel()
    await asyncio.gather(call, return_exceptions=True)
    host.kill()
    where = "postgres" if url else "folder"
    return {f"take-over, {where}, p50 s": statistics.median(took), f"take-over, {where}, most s": max(took)}


async def measure(folder: Path, url: str, rounds: int, count: int) -> dict[str, Any]:
    """Measure all."""
    async with counters("of-kept", "of-far", "of-h0"), joined("bench") as realm_client:
        found = await steps(realm_client, folder, url, rounds)
        return found | await take_overs(realm_client, folder, "", count)


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--take-overs", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    if reason := lacking():
        print(reason, file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory(prefix="rt-") as folder, server() as database:
        runtime = Path(folder, "run")
        runtime.mkdir(mode=0o700)
        os.environ |= {"XDG_RUNTIME_DIR": str(runtime), "ROBOTREE_REALM": "bench"}
        found = asyncio.run(measure(Path(folder), database.url, chosen.rounds, chosen.take_overs))
    if chosen.json:
        print(json.dumps(found))
    else:
        for key, value in found.items():
            print(f"{key:32} {value:12.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
