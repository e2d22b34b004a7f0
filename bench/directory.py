"""How long an order takes to be left, carried out and answered, and a question among many behaviours.

    python bench/directory.py

Baseline of the first figure is one SQLite commit with `synchronous=FULL` of the same row on the same disk;
it is measured alternately. A directory, a robot and a person are in one process and talk over Unix sockets.
"""

from __future__ import annotations

import asyncio
import sqlite3
import statistics
import time
from pathlib import Path

import msgspec
from measuring import apart, clock, until

from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, RobotDescription
from robotree.vr.base.order import KnownAgent
from robotree.vr.base.requests import ReadKnown
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.local import join
from robotree.vr.orders.book import OrderBook
from robotree.vr.orders.ledger import Ledger, OrderMemory
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore
from robotree.vr.supervision.realm_client import RealmClient

LEFT, BEHAVIOURS, ROBOTS = 100, 1000, 100


class Rover(Robot):
    """A rover that is quick."""

    @command(offline="queue")
    def move(self, x: float) -> float:
        """Move."""
        return x


async def orders(folder: Path) -> None:
    """Measure orders."""
    transports = [await join() for _ in range(3)]
    store, ledger = OrderStore(folder / "directory.db"), Ledger(folder / "orders.db")
    directory = DirectoryService(transports[0], "d1", store)
    await directory.start()
    registrar = Registrar(transports[1])

    def agent() -> RobotAgent:
        memory = OrderMemory(ledger, "the-rover")
        return RobotAgent(Rover("r1"), transports[1], registrar=registrar, orders=memory)

    rover = agent()
    await rover.start()
    person = RealmClient(transports[2])
    await person.start()
    await until(lambda: "the-rover" in store.agents)
    await rover.close()
    baseline = sqlite3.connect(folder / "baseline.db", isolation_level=None)
    baseline.executescript(
        "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; CREATE TABLE record (k TEXT, b BLOB);"
    )
    taken, commits = list[float](), list[float]()
    for number in range(LEFT):
        began = time.perf_counter()
        left = await person.orders.leave("r1", "move", {"x": 1.0})
        taken.append(time.perf_counter() - began)
        row = (str(number), msgspec.msgpack.encode(left.order))
        commits += clock(
            lambda row=row: baseline.execute("INSERT OR REPLACE INTO record VALUES (?, ?)", row), 1
        )
    usual, one = statistics.median(taken), statistics.median(commits) / 1e6
    times = usual / one
    print(f"an order left, durable: {usual * 1e3:.2f} ms; one commit: {one * 1e3:.2f} ms; ratio {times:.1f}")
    await _carry_out(agent(), directory, LEFT)
    again = agent()
    for _ in range(10):
        await person.orders.leave("r1", "move", {"x": 1.0})
    await _carry_out(again, directory, 10)
    await person.close()
    await directory.close()
    await registrar.close()
    for transport in transports:
        await transport.close()


async def _carry_out(rover: RobotAgent, directory: DirectoryService, number: int) -> None:
    began = time.perf_counter()
    await rover.start()
    await until(lambda: all(each.over for each in directory.book.store.orders.values()))
    took = time.perf_counter() - began
    print(f"{number} orders, from the robot's arrival to the last result: {took * 1e3:.0f} ms")
    await rover.close()


def behaviours() -> None:
    """Measure a question for one behaviour among those of many robots."""
    store = OrderStore(None)
    for number in range(ROBOTS):
        commands = tuple(CommandSpec(name=f"behaviour_{each}") for each in range(BEHAVIOURS))
        robot = RobotDescription(
            address=Address("robot", f"r{number}", "1"), kinds=("Rover", "Robot"), commands=commands
        )
        store.put(agents=[KnownAgent(name=f"r{number}", identity=f"i{number}", robot=robot)])
    book, question = (
        OrderBook("d", store, time.time),
        ReadKnown(command=f"behaviour_{BEHAVIOURS - 1}", brief=True),
    )
    taken = statistics.median(clock(lambda: book.known(question), 50)) / 1e3
    count = len(book.known(question))
    print(f"{count} of {ROBOTS} robots with {BEHAVIOURS} behaviours each are found in {taken:.2f} ms")


if __name__ == "__main__":
    with apart() as folder:
        asyncio.run(orders(folder))
    behaviours()
