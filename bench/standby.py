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
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from robotree.client.joining import joined
from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.run import Keeping, place_of, run_host
from robotree.vr.agents.standby import SHORTEST_AFTER
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.vr.space.postgres import lacking, server

REPEATS = 200
"""Calls in one measurement."""
FRAME = 185
"""[bytes] in the journal for a call between processes."""


class Counter(Robot):
    """The child: notes when it acts."""

    moments: list[float] = []  # noqa: RUF012 # one list for the only process that has it

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> float:
        """Note the moment, and return the argument."""
        Counter.moments.append(time.monotonic())
        return x


class Top(VirtualRobot):
    """Calls its child."""

    below = Child("Robot")

    @command
    def measure(self, repeats: int) -> list[float]:
        """Call the child many times; the times of all calls [us]."""
        times: list[float] = []
        for _ in range(repeats):
            began = time.perf_counter()
            self.below.step(x=1.0)
            times.append((time.perf_counter() - began) * 1e6)
        return times

    @command
    def patrol(self) -> None:
        """Act every now and then."""
        while True:
            self.below.step(x=1.0)
            self.sleep(0.02)


class HostProcess:
    """A host in a process of its own."""

    def __init__(self, name: str, folder: Path, *, of: str = "", url: str = "") -> None:
        """Prepare it."""
        self.name, self._words = name, [name, str(folder), of, url]

    def start(self) -> None:
        """Start it; returns when it is ready, or stands by."""
        line = [sys.executable, __file__, "--host", *self._words]
        self.process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert self.process.stdout is not None  # noqa: S101 # started with a pipe
        self.process.stdout.readline()

    def kill(self) -> None:
        """End it at once. Twice is once."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


async def bind(realm_client: RealmClient, host: HostProcess) -> str:
    """Make a robot on a host, on top of its counter; returns its name."""
    while not realm_client.directory.present("host", host.name):  # noqa: ASYNC110 # a table, which tells nobody
        await asyncio.sleep(0.01)
    await realm_client.create(__file__, f"top-{host.name}", host.name, "Top")
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


async def next_effect(after: float) -> float:
    """Return when the counter acts for the first time after a moment [s]."""
    async with asyncio.timeout(60.0):
        while not Counter.moments or Counter.moments[-1] <= after:  # noqa: ASYNC110 # of another thread
            await asyncio.sleep(0.002)
    return next(moment for moment in Counter.moments if moment > after)


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
    transport = await join()
    for name in ("of-kept", "of-far", "of-h0"):
        await RobotAgent(Counter(name), transport).start()
    async with joined("bench") as realm_client:
        found = await steps(realm_client, folder, url, rounds)
        found |= await take_overs(realm_client, folder, "", count)
    await transport.close()
    return found


def main() -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--take-overs", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--host", nargs=4, help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.host:
        name, folder, of, url = chosen.host
        place = place_of(Path(folder), url, of or name)
        assert place is not None  # noqa: S101 # it has a folder
        keep = Keeping(place, of, SHORTEST_AFTER)
        asyncio.run(run_host(name, keep=keep, ready=lambda _: print("ready", flush=True)))
        return 0
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
