"""How long a choice takes: among a thousand listed robots, and for twenty robots that choose at once.

    python bench/choosing.py [--robots N] [--choosers N]

All agents are in one process, on the network in memory, in real time. The baseline is one request to one
robot (`Describe`), measured in the same run.
"""

from __future__ import annotations

import asyncio
import random
import statistics
import time

from measuring import clocked, options, until

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing
from robotree.vr.exchange.client import RobotClient
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.scripts import chooser
from robotree.vr.scripts.requirement import requirement
from robotree.vr.world.network import MemoryNetwork

WHERE = "battery > 30 and near hall"


class Rover(Robot):
    """A rover."""

    def readings(self) -> dict[str, float]:
        return {"battery": 80.0}

    @command
    def move(self) -> None:
        """Drive."""


class Guide(VirtualRobot):
    """Chooses a rover."""

    rover = Child("Rover", choose="free", where=WHERE)


def among(count: int) -> list[float]:
    """Return times [s] for three candidates among so many robots, each tenth in the hall."""
    listings = [
        Listing(
            address=Address("robot", f"r{number}", "1"),
            kinds=("Rover",),
            attributes={"place": "shed" if number % 10 else "hall"},
        )
        for number in range(count)
    ]
    wanted, took = requirement(WHERE), list[float]()
    for _ in range(200):
        began = time.perf_counter()
        may = chooser.candidates(listings, "Rover", wanted, random.random)
        for _ in range(chooser.ASKED):
            next(may)
        took.append(time.perf_counter() - began)
    return took


async def at_once(choosers: int) -> tuple[float, float]:
    """Return the time [s] until so many choosers have a robot each, and that of one request."""
    network = MemoryNetwork()
    await LookupService(network.join("lookup"), "lookup").start()
    agents = list[RobotAgent]()
    for number in range(choosers + 5):
        transport = network.join(f"r{number}")
        rover = Rover(f"r{number}", {"place": "hall"})
        agents.append(RobotAgent(rover, transport, registrar=Registrar(transport)))
        await agents[-1].start()
        await agents[-1].listed()
    client = RobotClient(network.join("operator"), agents[0].address)
    asked = await clocked(50, lambda _: client.describe())
    guides = [RobotAgent(Guide(f"g{number}"), network.join(f"g{number}")) for number in range(choosers)]
    began = time.perf_counter()
    await asyncio.gather(*(guide.start() for guide in guides))
    await until(lambda: all(guide.runtime.look(lambda state: state.slots.bonds()) for guide in guides))
    took = time.perf_counter() - began
    for guide in guides:
        await guide.close()
    return took, statistics.median(asked)


def main() -> None:
    """Measure and print."""
    given = options(__doc__, robots=1000, choosers=20)
    times = among(given.robots)
    print(
        f"candidates among {given.robots}: {statistics.median(times) * 1e3:.2f} ms,"
        f" most {max(times) * 1e3:.2f} ms"
    )
    took, one = asyncio.run(at_once(given.choosers))
    print(f"{given.choosers} at once: {took:.3f} s from their start; one request: {one * 1e3:.2f} ms")


if __name__ == "__main__":
    main()
