"""What a crowd of virtual robots in one real host costs: start, memory and idling.

    python bench/scale.py [ROBOTS] [ROUNDS]

A host and a lookup service are processes of their own; the robots are created over the network of the
machine, many at once, as `robotree create` does it. Prints medians. Wanted: start at most 1 ms each, memory
at most 60 kB each, idle at most 2 % of a core.
"""

from __future__ import annotations

import asyncio
import statistics
import time
from collections import defaultdict
from collections.abc import Awaitable, Callable

from measuring import apart, count_given, cpu, memory

from robotree.tui.processes.crew import Crew, Member
from robotree.vr.base.address import Address
from robotree.vr.bundle import Bundle
from robotree.vr.exchange.client import HostClient
from robotree.vr.network.local import join

IN_FLIGHT = 256
"""Requests that wait for the host at once: each start waits 0.1 s until its name is known to everybody."""
REST = 10.0
"""[s] over which idling is measured."""
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

WANTED = {
    "start, wall, us each": 1000.0,
    "start, CPU, us each": 1000.0,
    "memory, kB each": 60.0,
    "idle, % of a core": 2.0,
}


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
        (key,) = transport.presence.keys("host/host-1/*")
        client = HostClient(transport, Address.parse(key))
        bundle = Bundle(SOURCE, "crowd.py", "")
        await client.create(bundle, "first")  # what is loaded once is not the crowd's
        empty, before, began = memory(host.pid), cpu(host.pid), time.perf_counter()
        await at_once(robots, lambda number: client.create(bundle, f"r{number}"))
        found["start, wall, us each"].append((time.perf_counter() - began) / robots * 1e6)
        found["start, CPU, us each"].append((cpu(host.pid) - before) / robots * 1e6)
        found["memory, kB each"].append((memory(host.pid) - empty) / 1024 / robots)
        await transport.close()
        await asyncio.sleep(2)
        before, began = cpu(host.pid), time.perf_counter()
        await asyncio.sleep(REST)
        found["idle, % of a core"].append(100 * (cpu(host.pid) - before) / (time.perf_counter() - began))


async def main(robots: int, rounds: int) -> None:
    """Print the medians."""
    found = defaultdict[str, list[float]](list)
    for _ in range(rounds):
        await crowd(robots, found)
    print(f"{robots} robots in one host, {IN_FLIGHT} created at once; medians of {rounds} rounds (all)")
    for name, values in found.items():
        median, wanted = statistics.median(values), WANTED[name]
        each = ", ".join(f"{value:.1f}" for value in values)
        kept = "kept" if median <= wanted else "NOT kept"
        print(f"{name:26} {median:9.1f} ({each})  wanted {wanted:g}: {kept}")


if __name__ == "__main__":
    with apart(REALM):
        asyncio.run(main(count_given(1, 1000), count_given(2, 3)))
