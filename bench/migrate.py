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
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient

REALM = "bench-migrate"


class Counter(Robot):
    """The child: notes when it acts."""

    moments: list[float] = []  # noqa: RUF012 # one list for the only process that has it

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> float:
        """Note the moment, and return the argument."""
        Counter.moments.append(time.monotonic())
        return x


class Walker(VirtualRobot):
    """Walks as long as it may."""

    below = Child("Robot")

    @command
    def walk(self, seconds: float) -> int:
        """Act every 5 ms."""
        until, acts = self.now() + seconds, 0
        while self.now() < until:
            self.below.step(x=float(acts))
            self.sleep(0.005)
            acts += 1
            if acts % 100 == 0:
                self.checkpoint()
        return acts

    @command
    def measure(self, repeats: int) -> list[float]:
        """Call the child many times; the times of all calls [us]."""
        times: list[float] = []
        for _ in range(repeats):
            began = time.perf_counter()
            self.below.step(x=1.0)
            times.append((time.perf_counter() - began) * 1e6)
        return times


class Idle(VirtualRobot):
    """One of many that leave a host."""

    @command(effect="read")
    def ping(self) -> int:
        """Answer."""
        return 1


class HostProcess:
    """A host in a process of its own."""

    def __init__(self, name: str, folder: Path) -> None:
        """Start it; returns when it is ready."""
        line = [sys.executable, __file__, "--host", name, str(folder)]
        self.process = subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert self.process.stdout is not None  # noqa: S101 # started with a pipe
        self.process.stdout.readline()

    @property
    def used(self) -> float:
        """[s] of processor time that it has had (proc_pid_stat(5))."""
        words = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def kill(self) -> None:
        """End it at once."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()


async def moved(realm_client: RealmClient, moves: int) -> dict[str, float]:
    """Measure the pauses of moves in the middle of a command."""
    await realm_client.create(__file__, "walker", "h1", "Walker")
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


async def left(realm_client: RealmClient, robots: int, hosts: list[HostProcess]) -> dict[str, float]:
    """Measure how long it takes until many robots have left a host, and what the busier host has to do."""
    for start in range(0, robots, 20):
        names = [f"idle-{number}" for number in range(start, min(start + 20, robots))]
        await asyncio.gather(*(realm_client.create(__file__, name, "h1", "Idle") for name in names))
    before, began = [host.used for host in hosts], time.perf_counter()
    gone = await realm_client.drain("h1")
    seconds = time.perf_counter() - began
    most = max(host.used - used for host, used in zip(hosts, before, strict=True))
    return {"robots": float(len(gone)), "seconds": seconds, "cpu_s": most}


async def run(moves: int, robots: int) -> dict[str, Any]:
    """Start all, and measure."""
    with tempfile.TemporaryDirectory() as folder:
        hosts = [HostProcess(name, Path(folder, name)) for name in ("h1", "h2")]
        transport = await join(REALM)
        agent = RobotAgent(Counter("counter"), transport)
        try:
            await agent.start()
            async with joined(REALM) as realm_client:
                for name in ("h1", "h2"):
                    await realm_client.arrival("host", name, within=30.0)
                await realm_client.arrival("robot", "counter", within=30.0)
                sync = synced(Path(folder))
                found = {**await moved(realm_client, moves), **await left(realm_client, robots, hosts)}
                return {**found, "sync_ms": sync}
        finally:
            await agent.close()
            await transport.close()
            for host in hosts:
                host.kill()


def main() -> None:
    """Measure and print."""
    if sys.argv[1:2] == ["--host"]:
        name, folder = sys.argv[2:]
        place = place_of(Path(folder), "", "")
        assert place is not None  # noqa: S101 # a folder is given
        asyncio.run(
            run_host(name, realm=REALM, keep=Keeping(place), ready=lambda _: print("ready", flush=True))
        )
        return
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
