"""How soon a stand-by host has the robots of one that was killed, and what a journal in PostgreSQL costs.

    python bench/standby.py [--rounds N] [--take-overs N]

Two hosts, one with its journal in a folder and one in a PostgreSQL of its own on this machine, take the same
calls of a child in another process in turns, in one run; beside them a bare INSERT of as many bytes. A
take-over is measured from `kill -9` to the next effect; the stand-by waits 2.5 s from the last sign of life,
which came up to 0.5 s before.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # the server is started as the tests do
from hosts import REPEATS, HostProcess, bind, counters, next_effect
from measuring import apart, clock, options, tell

from robotree.client.joining import joined
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.space.postgres import lacking, server

FRAME = 185
"""[bytes] in the journal for a call between processes."""


async def steps(realm_client: RealmClient, folder: Path, url: str, rounds: int) -> dict[str, float]:
    """Measure calls with both journals, in turns."""
    hosts = {"folder": HostProcess("kept", folder / "kept"), "postgres": HostProcess("far", folder, url=url)}
    times: dict[str, list[float]] = {way: [] for way in hosts}
    bare: list[float] = []
    for host in hosts.values():
        host.start()
    try:
        for host in hosts.values():
            await bind(realm_client, host, f"top-{host.name}", f"of-{host.name}")
        for _ in range(rounds):
            for way, host in hosts.items():
                times[way] += await realm_client.call(f"top-{host.name}", "measure", {"repeats": REPEATS})
            bare += inserts(url)
    finally:
        for host in hosts.values():
            host.kill()
    found = {f"call, journal in {way}, us": statistics.median(each) for way, each in times.items()}
    return {**found, "bare INSERT, us": statistics.median(bare)}


def inserts(url: str) -> list[float]:
    """Insert as many bytes as a call keeps, many times; the times [us]."""
    import psycopg

    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute("CREATE TABLE IF NOT EXISTS bare (body bytea)")
        return clock(lambda: connection.execute("INSERT INTO bare VALUES (%s)", (bytes(FRAME),)), REPEATS)


async def take_overs(realm_client: RealmClient, folder: Path, count: int) -> dict[str, float]:
    """Kill the host of a command; each time another one stands by, and has its robots then."""
    first = HostProcess("h0", folder / "log")
    first.start()
    await bind(realm_client, first, "top-h0", "of-h0")
    call = asyncio.ensure_future(realm_client.call("top-h0", "patrol", {}, deadline=600.0))
    await next_effect(time.monotonic())
    took: list[float] = []
    host = first
    for number in range(1, count + 1):
        following = HostProcess(f"h{number}", folder / "log", of="h0")
        following.start()
        await asyncio.sleep(1.0)
        host.kill()
        killed = time.monotonic()
        took.append(await next_effect(killed + 0.5) - killed)
        host = following
    call.cancel()
    await asyncio.gather(call, return_exceptions=True)
    host.kill()
    return {"take-over, p50 s": statistics.median(took), "take-over, most s": max(took)}


async def measure(folder: Path, url: str, rounds: int, count: int) -> dict[str, float]:
    """Measure all."""
    async with counters("of-kept", "of-far", "of-h0"), joined("bench") as realm_client:
        found = await steps(realm_client, folder, url, rounds)
        return found | await take_overs(realm_client, folder, count)


def main() -> None:
    """Print the figures."""
    given = options(__doc__, rounds=10, take_overs=10)
    if reason := lacking():
        raise SystemExit(reason)
    with apart() as folder, server() as database:
        tell(asyncio.run(measure(folder, database.url, given.rounds, given.take_overs)))


if __name__ == "__main__":
    main()
