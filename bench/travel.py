"""Whether a robot that moves between two sites in the middle of a motion repeats or leaves out a step.

    python bench/travel.py [--moves N] [--delay MS] [--speedup FACTOR]

Two sites as in `robotree demo travel`, a line between them that delays, and a robot that moves the arm of one
of them in small and watched steps, without end. Meanwhile it moves to and fro between the sites, code and
state, in the middle of its steps. The controller of the arm writes down each goal that it begins, and the
speed of the tool is what its readings say.
"""

from __future__ import annotations

import asyncio
import math
import statistics
import time
from contextlib import AsyncExitStack, suppress

from measuring import options, tell

from robotree.client.joining import joined
from robotree.tui.demo import ARM, HOST
from robotree.tui.demo_crash import begun_in
from robotree.tui.demo_sites import PLANT, places
from robotree.tui.demo_travel import NEAR_HOST, SMOOTH, STEPS, Travel, counted
from robotree.vr.base.errors import VrError

REALM = "bench-travel"
WAY = 0.1
"""[m] of all steps of one command."""
LIMIT = 0.25
"""[m/s] The fastest that the admittance law of the arm lets its tool go."""


class Tool:
    """Follows how fast the tool is, in the time of the simulated world."""

    def __init__(self, speedup: float) -> None:
        """Begin at rest."""
        self.fastest, self._before = 0.0, (0.0, (0.0, 0.0, 0.0))
        self._speedup = speedup

    def take(self, readings: dict[str, float], now: float) -> None:
        """Take a reading at a moment [s]."""
        if not {"x", "y", "z"} <= readings.keys():
            return
        at = (readings["x"], readings["y"], readings["z"])
        before, where = self._before
        if before and at != where:
            self.fastest = max(self.fastest, math.dist(at, where) / ((now - before) * self._speedup))
        if at != where or not before:
            self._before = now, at


async def measured(moves: int, sites: Travel, speedup: float) -> dict[str, float]:
    """Move the robot to and fro while it works."""
    async with joined(REALM) as realm_client:
        await sites.open(realm_client)
        tool, over, took = Tool(speedup), asyncio.Event(), list[float]()
        sweeps, before = 0, len(begun_in(sites.goals))

        async def work() -> None:
            nonlocal sweeps
            while not over.is_set():
                length = WAY if sweeps % 2 == 0 else -WAY
                await realm_client.call(SMOOTH, "sweep", {"steps": STEPS, "length": length}, deadline=3600.0)
                sweeps += 1

        async def watch() -> None:
            while True:
                with suppress(VrError):
                    tool.take((await realm_client.describe(ARM)).readings, time.monotonic())
                await asyncio.sleep(0.05)

        working, watching = asyncio.ensure_future(work()), asyncio.ensure_future(watch())
        for number in range(moves):
            await asyncio.sleep(0.3)
            began = time.monotonic()
            await realm_client.migrate(SMOOTH, f"{PLANT}:{NEAR_HOST}" if number % 2 == 0 else HOST)
            took.append(time.monotonic() - began)
        over.set()
        await working
        watching.cancel()
        twice, lost = counted(begun_in(sites.goals)[before:], sweeps * STEPS)
    return {
        "moves": moves,
        "steps": sweeps * STEPS,
        "steps twice": twice,
        "steps lost": lost,
        "a move, p50, s": statistics.median(took),
        "a move, most, s": max(took),
        f"the tool at its fastest, of {LIMIT} m/s": tool.fastest,
    }


async def run(moves: int, delay: int, speedup: str) -> dict[str, float]:
    """Start everything, and measure."""
    with places() as folders:
        async with AsyncExitStack() as stack:
            sites = Travel(folders, REALM, delay, speedup, stack)
            await sites.start(None)
            return await measured(moves, sites, float(speedup))


if __name__ == "__main__":
    given = options(__doc__, moves=200, delay=150, speedup="1")
    tell(asyncio.run(run(given.moves, given.delay, given.speedup)))
