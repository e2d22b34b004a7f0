"""Whether a robot that moves between two sites in the middle of a motion repeats or leaves out a step.

    python bench/travel.py [--moves N] [--delay MS] [--speedup FACTOR] [--json]

Two sites as in `robotree demo travel`, a line between them that delays, and a robot that moves the arm of one
of them in small and watched steps, without end. Meanwhile it moves to and fro between the sites, code and
state, in the middle of its steps. The controller of the arm writes down each goal that it begins, and the
speed of the tool is what its readings say.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import time
from contextlib import AsyncExitStack, suppress
from typing import Any

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


async def measured(moves: int, sites: Travel, speedup: float) -> dict[str, Any]:
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
    took.sort()
    return {
        "moves": moves, "steps": sweeps * STEPS, "twice": twice, "lost": lost,
        "move_p50_s": round(took[len(took) // 2], 2), "move_max_s": round(took[-1], 2),
        "tool_m_per_s": round(tool.fastest, 4), "limit_m_per_s": LIMIT,
    }  # fmt: skip


async def run(moves: int, delay: int, speedup: str) -> dict[str, Any]:
    """Start everything, and measure."""
    with places() as folders:
        async with AsyncExitStack() as stack:
            sites = Travel(folders, REALM, delay, speedup, stack)
            await sites.start(None)
            return await measured(moves, sites, float(speedup))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--moves", type=int, default=200)
    parser.add_argument("--delay", type=int, default=150)
    parser.add_argument("--speedup", default="1")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found = asyncio.run(run(given.moves, given.delay, given.speedup))
    if given.json:
        print(json.dumps(found))
        return
    print(
        f"{found['moves']} moves during {found['steps']} steps: {found['twice']} twice, {found['lost']} lost"
    )
    print(f"a move took {found['move_p50_s']} s (p50), {found['move_max_s']} s at most")
    print(f"the tool was at most {found['tool_m_per_s']} m/s fast, of {found['limit_m_per_s']}")


if __name__ == "__main__":
    main()
