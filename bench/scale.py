"""What a crowd of virtual robots in one real host costs: start, memory and idling.

    python bench/scale.py [ROBOTS] [ROUNDS]

A host and a lookup service are processes of their own; the robots are created over the network of the
machine, many at once, as `robotree create` does it. Each round is followed by the baseline, in the same run:
a process that starts as many threads, one for each robot, that only wait, which is what a robot costs at
least where an agent has a thread (JADE). Prints medians. Wanted: start at most 1 ms each, memory
at most 60 kB each, idle at most 2 % of a core.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable
from pathlib import Path

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew, Member
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient

ROBOTS, ROUNDS = 1000, 3
IN_FLIGHT = 256
"""Requests that wait for the host at once: each start waits 0.1 s until its name is known to everybody."""
REST = 10.0
"""[s] over which idling is measured."""
TICK = os.sysconf("SC_CLK_TCK")
REALM = "bench"

SOURCE = '''
from robotree.vr import VirtualRobot, command


class Crowd(VirtualRobot):
    """One of many."""

    @command
    def add(self, a: float, b: float) -> float:
        """Add two numbers."""
        return a + b
'''

WANTED = {"start, wall": 1000.0, "start, CPU": 1000.0, "memory": 60.0, "idle": 2.0}


def cpu(pid: int) -> float:
    """Return the CPU time of a process so far [s]: proc_pid_stat(5), utime and stime."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def memory(pid: int) -> float:
    """Return what a process has in memory [kB]: proc_pid_status(5), VmRSS."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith("VmRSS:"))


async def at_once(count: int, work: Callable[[int], Awaitable[object]]) -> None:
    """Do something for each number, `IN_FLIGHT` at a time."""
    places = asyncio.Semaphore(IN_FLIGHT)

    async def one(number: int) -> None:
        async with places:
            await work(number)

    await asyncio.gather(*map(one, range(count)))


async def share(pid: int) -> float:
    """Return what a process takes of a core while nobody asks it anything [%]."""
    before, began = cpu(pid), time.perf_counter()
    await asyncio.sleep(REST)
    return 100 * (cpu(pid) - before) / (time.perf_counter() - began)


async def crowd(robots: int, found: dict[str, list[float]]) -> None:
    """Fill one host, and take its figures."""
    async with Crew(REALM) as crew:
        await crew.start("lookup", "lookup-1")
        host: Member = await crew.start("host", "host-1")
        transport = await join(REALM)
        realm_client = RealmClient(transport)
        await realm_client.start()
        client = HostClient(transport, (await realm_client.hosts())[0].address)
        bundle = Bundle(SOURCE, "crowd.py", "")
        await client.create(bundle, "first")  # what is loaded once is not the crowd's
        empty, before, began = memory(host.pid), cpu(host.pid), time.perf_counter()
        await at_once(robots, lambda number: client.create(bundle, f"r{number}"))
        found["start, wall"].append((time.perf_counter() - began) / robots * 1e6)
        found["start, CPU"].append((cpu(host.pid) - before) / robots * 1e6)
        found["memory"].append((memory(host.pid) - empty) / robots)
        await realm_client.close()
        await transport.close()
        await asyncio.sleep(2)
        found["idle"].append(await share(host.pid))
        async with joined(REALM) as watched:
            heard = 0

            def hear(_name: str, _state: object) -> None:
                nonlocal heard
                heard += 1

            registration = await watched.watch_state(None, hear)
            await asyncio.sleep(2)
            heard = 0
            found["idle, all states watched"].append(await share(host.pid))
            found["states a second"].append(heard / REST)
            await registration.close()


def threads(count: int) -> None:
    """The baseline: start threads that wait, and print microseconds and kB of each."""
    over = threading.Event()
    empty, began = memory(os.getpid()), time.perf_counter()
    waiting = [threading.Thread(target=over.wait, daemon=True) for _ in range(count)]
    for thread in waiting:
        thread.start()
    took = time.perf_counter() - began
    print(took / count * 1e6, (memory(os.getpid()) - empty) / count)
    over.set()


async def main(robots: int, rounds: int) -> None:
    """Take turns and print the medians."""
    found = defaultdict[str, list[float]](list)
    for _ in range(rounds):
        await crowd(robots, found)
        bare = [sys.executable, __file__, "threads", str(robots)]
        said = await asyncio.to_thread(subprocess.check_output, bare, text=True)
        for name, value in zip(
            ("a thread: start", "a thread: memory"), map(float, said.split()), strict=True
        ):
            found[name].append(value)
    print(
        f"{robots} robots in one host, {IN_FLIGHT} created at once; medians of {rounds} rounds (all of them)"
    )
    units = {
        "start": "us each",
        "a thread: start": "us each",
        "memory": "kB each",
        "a thread: memory": "kB each",
    }
    for name, values in found.items():
        unit = units.get(name) or units.get(name.partition(",")[0]) or ("%" if "idle" in name else "")
        median, wanted = statistics.median(values), WANTED.get(name)
        verdict = (
            "" if wanted is None else f"  wanted {wanted:g}: {'kept' if median <= wanted else 'NOT kept'}"
        )
        print(f"{name:26} {median:9.1f} {unit:8} ({', '.join(f'{one:.1f}' for one in values)}){verdict}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["threads"]:
        threads(int(sys.argv[2]))
        sys.exit()
    with tempfile.TemporaryDirectory(prefix="rt-") as apart:
        os.environ.update(XDG_RUNTIME_DIR=apart, XDG_STATE_HOME=apart, ROBOTREE_REALM=REALM)
        given = [int(word) for word in sys.argv[1:3]]
        asyncio.run(main(*(*given, *(ROBOTS, ROUNDS)[len(given) :])))
