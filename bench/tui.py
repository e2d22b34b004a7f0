"""What the full screen costs: CPU, key to first byte, bytes on the line.

    python bench/tui.py [--robots 1000] [--hz 10] [--seconds 10] [--size 160x48]
    python bench/tui.py --filter
    python bench/tui.py --plots
    python bench/tui.py --plan
    python bench/tui.py --hands

The supervisor runs in a terminal of its own (a pty). Its robots are played in its own process by a transport
that hands over encoded states, so decoding them is part of what is measured, and playing them, too; the
network's own cost is not (bench/lookup.py and docs/performance.md have that). CPU is user and system time of
the process, as a share of one core.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import os
import statistics
import struct
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from typing import Any

from measuring import COUNTER, Terminal, apart, cpu, middle, options, quantile, ran

LATEST = 30.0
"""[s] until the first picture, on a machine that has much else to do."""
SETTLE = 4.0
"""[s] after that, until everything is drawn."""
MOST_SPREAD = 100
"""Robots up to which each has a place of its own on the plan."""
PRESSES = 80
"""Keys whose answer is timed."""


# -- the child: a supervisor and the robots that it sees -------------------------------------------


class _Nothing:
    async def close(self) -> None:
        """There is nothing to take back."""


class Crowd:
    """A transport on which many robots speak and none has to run (`robotree.vr.base.transport.Transport`)."""

    def __init__(self, count: int, hz: float) -> None:
        """Play `count` robots that tell another state so many times a second; 0: the same each second."""
        from robotree.vr.base.address import Address
        from robotree.vr.base.description import RobotDescription
        from robotree.vr.base.policy import OPEN
        from robotree.vr.base.presence import Presence
        from robotree.vr.base.principal import this_process
        from robotree.vr.base.requests import Described, State, encode

        self.hz = hz
        self.addresses = [Address("robot", f"r{number}", "1") for number in range(count)]
        self.described = {
            address.key: encode(
                Described(robot=RobotDescription(address=address, kinds=("Arm", "Robot"), doc="An arm."))
            )
            for address in self.addresses
        }
        readings = [{"x": 0.1 * part, "y": 0.0, "z": 0.4, "progress": part / 20} for part in range(20)]
        self.bodies = [encode(State(busy="go_to", readings=reading)) for reading in readings]
        self.calm = encode(State(readings={"x": 0.1, "y": 0.0, "z": 0.4}))
        self.spread = [
            [
                encode(
                    State(busy="drive", readings={"x": 0.5 * (n % 10) + 0.05 * part, "y": 0.4 * (n // 10)})
                )
                for part in range(20)
            ]
            for n in range(count if count <= MOST_SPREAD else 0)
        ]
        """By robot: its states on its way, each robot in a place of its own."""
        self.told = 0
        self.gate, self.identity = OPEN, this_process()
        self.presence = Presence(held=lambda _: [], unheard=lambda _: [])
        for address in self.addresses:  # everybody is there from the beginning
            self.presence.count(address.key, there=True)

    async def serve(self, *_: Any) -> _Nothing:
        """Nobody asks."""
        return _Nothing()

    async def announce(self, *_: Any) -> _Nothing:
        """Nobody looks."""
        return _Nothing()

    def publish(self, *_: Any) -> None:
        """Nobody hears."""

    async def request(self, key: str, *_: Any, **__: Any) -> AsyncIterator[bytes]:
        """Describe a robot."""
        yield self.described[key]

    async def close(self) -> None:
        """Leave."""

    async def subscribe(self, pattern: str, handler: Any) -> _Nothing:
        """Begin to tell states."""
        if pattern.endswith("/state"):
            self._task = asyncio.create_task(self._play(handler))
        return _Nothing()

    async def _play(self, handler: Any) -> None:
        """Tell each robot's state in its turn, in as many portions as keep the loop free."""
        keys = [f"{address.key}/state" for address in self.addresses]
        portions, period = 20, 1 / (self.hz or 1.0)
        size = max(len(keys) // portions, 1)
        due = time.monotonic()
        for turn in range(10**9):
            for start in range(0, len(keys), size):
                self.told += len(keys[start : start + size])
                for number, key in enumerate(keys[start : start + size], start):
                    bodies = self.spread[number] if self.spread else self.bodies
                    handler(key, bodies[(turn + number) % 20] if self.hz else self.calm)
                due += period * size / len(keys)
                await asyncio.sleep(max(due - time.monotonic(), 0.0))


class WavingCrowd(Crowd):
    """A crowd whose readings differ from state to state, as those of robots that move do."""

    def __init__(self, count: int, hz: float) -> None:
        """Play robots with two waves."""
        from robotree.vr.base.requests import State, encode

        super().__init__(count, hz)
        self.bodies = [
            encode(State(readings={"x": math.sin(at * math.pi / 10), "fz": math.cos(at * 0.7)}))
            for at in range(20)
        ]


async def play_plots(count: int, hz: float, plots: int) -> None:
    """Be the supervisor of robots whose readings are plotted; without plots the same page."""
    from robotree.tui.screen.app import Supervisor
    from robotree.tui.screen.pages.readings import ReadingsPage
    from robotree.tui.screen.supervise import prompt_answers
    from robotree.vr.supervision.realm_client import RealmClient

    class Plotting(Supervisor):
        """Begins with the plots."""

        async def on_mount(self) -> None:
            """Tick, and open the page."""
            for number in range(plots):
                self.store.watched.ticked.tick((f"r{number // 2}", ("x", "fz")[number % 2]))
            self.call_later(self.push_screen, ReadingsPage())

    crowd = WavingCrowd(count, hz)
    realm_client = RealmClient(crowd)
    await realm_client.start()
    with prompt_answers():
        await Plotting(realm_client, realm="bench").run_async()


async def play(count: int, hz: float, *, calm: bool) -> None:
    """Be the supervisor of a crowd."""
    from robotree.tui.screen.app import Supervisor
    from robotree.tui.screen.supervise import prompt_answers
    from robotree.vr.supervision.realm_client import RealmClient

    crowd = Crowd(count, hz)
    realm_client = RealmClient(crowd)
    await realm_client.start()

    def count_up() -> None:
        os.pwrite(COUNTER, struct.pack("q", crowd.told), 0)
        asyncio.get_running_loop().call_later(0.1, count_up)

    count_up()
    with prompt_answers():
        await Supervisor(realm_client, realm="bench", calm=calm).run_async()


# -- the parent: a terminal and a clock ------------------------------------------------------------


@contextmanager
def shown(size: str, *words: object) -> Iterator[tuple[Terminal, Callable[[], int]]]:
    """Have the child in a terminal for the time of a block, and say how many states it was told."""
    columns, _, rows = size.partition("x")
    line = [__file__, "--play", *map(str, words)]
    with tempfile.TemporaryFile() as counter:
        terminal = Terminal(line, (int(columns), int(rows)), counter=counter.fileno())
        try:
            terminal.drain(LATEST, first=True)
            terminal.drain(SETTLE)
            yield terminal, lambda: struct.unpack("q", os.pread(counter.fileno(), 8, 0) or bytes(8))[0]
        finally:
            terminal.end()


def measure(
    name: str, count: int, hz: float, given: argparse.Namespace, *, calm: bool = False, keys: bytes = b""
) -> None:
    """Run one case and print its line. `keys` are pressed before it."""
    with shown(given.size, count, hz, *["calm"] * calm) as (terminal, told):
        if keys:
            os.write(terminal.fd, keys)
            terminal.drain(SETTLE / 2)
        before, known = cpu(terminal.pid), told()
        sent, took = terminal.drain(given.seconds)
        share, states = (cpu(terminal.pid) - before) / took, (told() - known) / took
        delays = list[float]()
        for press in range(PRESSES):
            terminal.drain(0.06 + 0.013 * (press % 7))
            os.write(terminal.fd, b"\x1b[A" if press % 2 else b"\x1b[B")
            delays.append(1000 * terminal.drain(1.0, first=True)[1])
    p50, p95 = statistics.median(delays), quantile(delays, 0.95)
    print(
        f"{name:<30} {states:6.0f} states/s {share:6.1%} of a core {sent / took / 1000:6.1f} kB/s "
        f" key to byte p50 {p50:5.1f} ms  p95 {p95:5.1f} ms",
        flush=True,
    )


def plotted(given: argparse.Namespace) -> None:
    """Measure the page of readings with four plots, and without one."""
    for plots in (0, 4, 0, 4):
        with shown(given.size, 2, 10, "plots", plots) as (terminal, _):
            before = ran(terminal.pid)
            sent, took = terminal.drain(given.seconds)
            share = (ran(terminal.pid) - before) / took
        print(
            f"2 robots at 10 Hz, {plots} plots at 5 Hz {share:6.1%} of a core {sent / took / 1000:6.1f} kB/s",
            flush=True,
        )


def first_filter(given: argparse.Namespace, runs: int = 5) -> None:
    """Time the first `/` and its first letter in a new screen: wall, and CPU until the first byte."""
    took: dict[str, list[tuple[float, float]]] = {"first /": [], "its first letter": []}
    for _ in range(runs):
        with shown(given.size, given.robots, 0) as (terminal, _):
            for name, key in zip(took, (b"/", b"9"), strict=True):
                before = ran(terminal.pid)
                os.write(terminal.fd, key)
                wall = terminal.drain(3.0, first=True)[1]
                took[name].append((1000 * wall, 1000 * (ran(terminal.pid) - before)))
                terminal.drain(0.8)
    for name, found in took.items():
        walls, cpus = zip(*found, strict=True)
        print(
            f"{given.robots} robots, {name:<18} median {statistics.median(walls):4.0f} ms, at most "
            f"{max(walls):4.0f} ms; of CPU {statistics.median(cpus):4.1f} ms",
            flush=True,
        )


async def hand_over(times: int = 40) -> None:
    """Time how long control takes from one operator to what the other one hears, over sockets."""
    from robotree.vr import Robot
    from robotree.vr.agents.agent import RobotAgent
    from robotree.vr.base.envelope import sitting_at
    from robotree.vr.network.local import join
    from robotree.vr.supervision.realm_client import RealmClient

    with apart("hands"):
        agent = RobotAgent(Robot("arm"), await join())
        await agent.start()
        people = {name: RealmClient(await join()) for name in ("pts/1", "pts/2")}
        heard, holding = asyncio.Event(), [""]

        def hear(_: str, state: Any) -> None:
            holding[0] = state.operator
            heard.set()

        for client in people.values():
            await client.start()
            await client.watch_state("arm", hear)
        found: list[float] = []
        holder, other = "pts/1", "pts/2"

        async def control(terminal: str, what: Any) -> None:
            with sitting_at(terminal):
                await people[terminal].control("arm", what)

        await control(holder, "get")
        for _ in range(times):
            await control(other, "ask")
            began = time.perf_counter()
            await control(holder, "offer")
            while not holding[0].endswith(other):
                heard.clear()
                await heard.wait()
            found.append((time.perf_counter() - began) * 1e3)
            holder, other = other, holder
        print(f"hand-over: {middle(found, 'ms')}, {times} times, load {os.getloadavg()[0]:.0f}")
        await agent.close()


def main() -> None:
    """Measure what was asked for."""
    if sys.argv[1:2] == ["--play"]:
        count, hz, *words = sys.argv[2:]
        if "plots" in words:
            asyncio.run(play_plots(int(count), float(hz), int(words[-1])))
        else:
            asyncio.run(play(int(count), float(hz), calm="calm" in words))
        return
    usual = {"robots": 1000, "hz": 10.0, "seconds": 10.0, "size": "160x48"}
    given = options(__doc__, **usual, filter=False, plots=False, plan=False, hands=False)
    print(f"load {os.getloadavg()[0]:.1f}, terminal {given.size}, {given.seconds:g} s each", flush=True)
    if given.hands:
        asyncio.run(hand_over())
    elif given.plots:
        plotted(given)
    elif given.filter:
        first_filter(given)
    elif given.plan:
        measure("100 robots, 4 Hz, list", 100, 4.0, given)
        measure("100 robots, 4 Hz, plan", 100, 4.0, given, keys=b"F")
    else:
        name = f"{given.robots} robots"
        measure(f"{name}, idle", given.robots, 0.0, given)
        measure(f"{name}, {given.hz:g} Hz", given.robots, given.hz, given)
        measure(f"{name}, {given.hz:g} Hz, --calm", given.robots, given.hz, given, calm=True)


if __name__ == "__main__":
    main()
