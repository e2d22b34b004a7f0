"""What the log of commands costs on the way of a call: a nested call with it, and without it.

    python bench/command_log.py [--rounds N]

Two chains of two robots in one process, alike but that the robots of one keep no log of their commands. They
are called in turns, `REPEATS` calls each, in the thread of the calling page; ratio of the medians and of the
fastest tenth, which is what is left where other programs run beside it.
"""

from __future__ import annotations

import asyncio
import statistics
from typing import Any

from calls import Chained, Leaf
from measuring import apart, options

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


async def measure(rounds: int) -> dict[str, list[float]]:
    """Measure both in turns; the times of all calls [us]."""
    transport, process = await join(), Process()
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


def main() -> None:
    """Print both, and their ratio."""
    with apart():
        times = asyncio.run(measure(options(__doc__, rounds=200).rounds))
    tenth = {name: statistics.mean(sorted(found)[: len(found) // 10]) for name, found in times.items()}
    median = {name: statistics.median(found) for name, found in times.items()}
    for name in times:
        print(f"{name:8} a log: fastest tenth {tenth[name]:6.2f} us, median {median[name]:6.2f} us")
    ratios = (tenth["with"] / tenth["without"], median["with"] / median["without"])
    print("ratio          {:22.3f} {:17.3f}".format(*ratios))


if __name__ == "__main__":
    main()
