"""What the log of commands costs on the way of a call: a nested call with it, and without it.

    python bench/command_log.py [--rounds N]

Two chains of two robots in one process, alike but that the robots of one keep no log of their commands. They
are called in turns, `REPEATS` calls each, in the thread of the calling page; ratio of the medians and of the
fastest tenth, which is what is left where other programs run beside it.
"""

from __future__ import annotations

import argparse
import asyncio
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

from calls import Chained, Leaf

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.local import join
from robotree.vr.running.process import Process

REPEATS = 200
"""Calls of one chain before it is the other one's turn: some milliseconds."""


def _nothing(*_: object) -> None:
    """Keep no line."""


async def pair(transport: Any, process: Process, name: str, *, keeps: bool) -> RobotClient:
    """Start a parent and its child; returns a client of the parent."""
    child, parent = (
        RobotAgent(robot, transport, process=process) for robot in (Leaf(f"{name}-leaf"), Chained(name))
    )
    for agent in (child, parent):
        await agent.start()
        if not keeps:
            setattr(agent.runtime.log, "settle", _nothing)  # noqa: B010 # what is measured
    client = RobotClient(transport, parent.address)
    await client.enslave("below", child.address)
    return client


async def measure(rounds: int, root: Path) -> dict[str, list[float]]:
    """Measure both in turns; the times of all calls [us]."""
    transport, process = await join("bench", root=root), Process()
    chains = {
        name: await pair(transport, process, name, keeps=name == "with") for name in ("with", "without")
    }
    times: dict[str, list[float]] = {name: [] for name in chains}
    for turn in range(rounds):
        for name in sorted(chains, reverse=bool(turn % 2)):
            times[name] += await chains[name].call("measure", {"repeats": REPEATS})
    process.close()
    await transport.close()
    return times


def main() -> int:
    """Print both, and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=200)
    rounds = parser.parse_args().rounds
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        root = Path(folder, "run")
        root.mkdir(mode=0o700)
        times = asyncio.run(measure(rounds, root))
    tenth = {name: statistics.mean(sorted(found)[: len(found) // 10]) for name, found in times.items()}
    median = {name: statistics.median(found) for name, found in times.items()}
    for name in times:
        sys.stdout.write(
            f"{name:8} a log: fastest tenth {tenth[name]:6.2f} us, median {median[name]:6.2f} us\n"
        )
    ratios = (tenth["with"] / tenth["without"], median["with"] / median["without"])
    sys.stdout.write("ratio          {:22.3f} {:17.3f}\n".format(*ratios))
    return 0


if __name__ == "__main__":
    sys.exit(main())
