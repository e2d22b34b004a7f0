"""A call of a program against the call that the supervisor makes inside, between real processes.

    python bench/programs.py [CALLS]

One interleaved run; a robot on a host carries out a command that does nothing.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from robotree import connect
from robotree.client.asynchronous import AsyncRealm
from robotree.client.blocking import Realm

PAGE = """
from robotree.vr import VirtualRobot, command

class Idle(VirtualRobot):
    @command
    def rest(self) -> int:
        return 1
"""
ROUND = 50
"""Calls of one kind before it is the other's turn."""


async def inside(realm: AsyncRealm, count: int) -> list[float]:
    """Return how long each of some calls of `RealmClient` took [s]."""
    return [await clocked(lambda: realm.realm_client.call("idle", "rest", {})) for _ in range(count)]


async def outside(realm: AsyncRealm, count: int) -> list[float]:
    """Return the same for the client of asyncio."""
    return [await clocked(realm["idle"].rest) for _ in range(count)]


async def clocked(call: Callable[[], object]) -> float:
    """Return how long one call took [s]."""
    began = time.perf_counter()
    await call()  # type: ignore[misc] # a coroutine
    return time.perf_counter() - began


def main() -> None:
    """Print the medians, and their ratios."""
    calls = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        os.environ["XDG_RUNTIME_DIR"] = folder
        os.environ.pop("ROBOTREE_REALM", None)
        page = Path(folder, "idle.py")
        page.write_text(PAGE)
        members = [
            subprocess.Popen(
                [sys.executable, "-m", "robotree.tui", *words, "--tether"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
            )
            for words in (("lookup", "l1"), ("host", "h1"))
        ]
        for member in members:
            member.stdout.readline()  # type: ignore[union-attr] # a pipe
        try:
            with connect() as realm:
                measure(realm, page, calls)
        finally:
            for member in members:
                member.stdin.close()  # type: ignore[union-attr] # a pipe
                member.wait()


def measure(realm: Realm, page: Path, calls: int) -> None:
    """Play the rounds."""
    idle = realm.create(str(page), "idle")
    taken: dict[str, list[float]] = {"inside": [], "asyncio": [], "blocking": []}
    for _ in range(calls // ROUND):
        taken["inside"] += realm.wait_for(inside(realm.behind, ROUND))
        taken["asyncio"] += realm.wait_for(outside(realm.behind, ROUND))
        for _ in range(ROUND):
            began = time.perf_counter()
            idle.rest()
            taken["blocking"].append(time.perf_counter() - began)
    base = statistics.median(taken["inside"])
    for name, seconds in taken.items():
        middle = statistics.median(seconds)
        print(f"{name:10} {middle * 1e6:8.0f} us  {middle / base:5.2f}x  n={len(seconds)}")


if __name__ == "__main__":
    main()
