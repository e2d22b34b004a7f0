"""What the full screen costs: CPU, key to first byte, bytes on the line; and the start of the command line.

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
import fcntl
import math
import os
import pty
import select
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import AsyncIterator, Iterable
from pathlib import Path
from typing import Any

TICKS = os.sysconf("SC_CLK_TCK")
LATEST = 30.0
"""[s] until the first picture, on a machine that has much else to do."""
SETTLE = 4.0
"""[s] after that, until everything is drawn."""
COUNTER = 9
"""Descriptor of the file in which the child counts the states that it was told."""
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


def play_bare() -> None:
    """Be a Textual app with one widget whose line differs after each key: no page can be quicker."""
    from textual.app import App, ComposeResult
    from textual.events import Key
    from textual.widgets import Static

    class Bare(App[None]):
        keys = 0

        def compose(self) -> ComposeResult:
            yield Static("0")

        def on_key(self, event: Key) -> None:
            del event
            self.keys += 1
            self.query_one(Static).update(f"{self.keys}", layout=False)

    Bare().run()


# -- the parent: a terminal and a clock ------------------------------------------------------------


class Terminal:
    """A pty with a program in it."""

    def __init__(self, words: Iterable[str], size: tuple[int, int]) -> None:
        """Start the program in a terminal of this many columns and rows."""
        self._counter = tempfile.TemporaryFile()  # noqa: SIM115 # open as long as the program runs
        self.pid, self.fd = pty.fork()
        if self.pid == 0:
            os.dup2(self._counter.fileno(), COUNTER)
            os.set_inheritable(COUNTER, True)  # dup2 does nothing where it has this number already
            os.environ.update(TERM="xterm-256color", COLORTERM="truecolor")
            os.execv(sys.executable, [sys.executable, *words])  # noqa: S606 # this program again
        fcntl.ioctl(self.fd, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))

    def drain(self, seconds: float, *, first: bool = False) -> tuple[int, float]:
        """Read for a while, or until the first bytes; returns how many came, and how long it took [s]."""
        began, count = time.monotonic(), 0
        while (left := began + seconds - time.monotonic()) > 0:
            if not select.select([self.fd], [], [], left)[0]:
                break
            count += len(os.read(self.fd, 1 << 16))
            if first:
                break
        return count, time.monotonic() - began

    def cpu(self) -> float:
        """[s] of CPU that the program has taken."""
        fields = open(f"/proc/{self.pid}/stat", encoding="ascii").read().rpartition(")")[2].split()  # noqa: PTH123, SIM115 # Linux's own file
        return (int(fields[11]) + int(fields[12])) / TICKS

    def ran(self) -> float:
        """[s] that all its threads have run, to the microsecond."""
        paths = Path(f"/proc/{self.pid}/task").glob("*/schedstat")
        return sum(int(path.read_text().split()[0]) for path in paths) / 1e9

    def told(self) -> int:
        """Return how many states the program was told."""
        return int(struct.unpack("q", os.pread(self._counter.fileno(), 8, 0) or bytes(8))[0])

    def end(self) -> None:
        """End the program."""
        os.kill(self.pid, 9)
        os.waitpid(self.pid, 0)
        os.close(self.fd)


def measure(  # what a case is
    name: str, count: int, hz: float, arguments: argparse.Namespace, *, calm: bool = False, keys: bytes = b""
) -> None:
    """Run one case and print its line; no robots: Textual alone. `keys` are pressed before it."""
    words = [__file__, "--play", str(count), str(hz), *(["calm"] if calm else [])]
    if not count:
        words = [__file__, "--bare"]
    size = tuple(int(part) for part in arguments.size.split("x"))
    terminal = Terminal(words, (size[0], size[1]))
    try:
        terminal.drain(LATEST, first=True)
        terminal.drain(SETTLE)
        if keys:
            os.write(terminal.fd, keys)
            terminal.drain(SETTLE / 2)
        before, told = terminal.cpu(), terminal.told()
        sent, took = terminal.drain(arguments.seconds)
        share, states = (terminal.cpu() - before) / took, (terminal.told() - told) / took
        delays = []
        for press in range(PRESSES):
            terminal.drain(0.06 + 0.013 * (press % 7))
            os.write(terminal.fd, b"\x1b[A" if press % 2 else b"\x1b[B")
            delays.append(terminal.drain(1.0, first=True)[1])
    finally:
        terminal.end()
    delays.sort()
    p50, p95 = statistics.median(delays), delays[int(0.95 * len(delays))]
    print(
        f"{name:<30} {states:6.0f} states/s {share:6.1%} of a core {sent / took / 1000:6.1f} kB/s "
        f" key to byte p50 {1000 * p50:5.1f} ms  p95 {1000 * p95:5.1f} ms",
        flush=True,
    )


def plotted(arguments: argparse.Namespace) -> None:
    """Measure the page of readings with four plots, and without one."""
    size = tuple(int(part) for part in arguments.size.split("x"))
    for plots in (0, 4, 0, 4):
        terminal = Terminal([__file__, "--play", "2", "10", "plots", str(plots)], (size[0], size[1]))
        try:
            terminal.drain(LATEST, first=True)
            terminal.drain(SETTLE)
            before = terminal.ran()
            sent, took = terminal.drain(arguments.seconds)
            share = (terminal.ran() - before) / took
        finally:
            terminal.end()
        print(
            f"2 robots at 10 Hz, {plots} plots at 5 Hz {share:6.1%} of a core {sent / took / 1000:6.1f} kB/s",
            flush=True,
        )


def first_filter(count: int, arguments: argparse.Namespace, runs: int = 5) -> None:
    """Time the first `/` and its first letter in a new screen: wall, and CPU until the first byte."""
    size = tuple(int(part) for part in arguments.size.split("x"))
    took: dict[str, list[tuple[float, float]]] = {"first /": [], "its first letter": []}
    for _ in range(runs):
        terminal = Terminal([__file__, "--play", str(count), "0"], (size[0], size[1]))
        try:
            terminal.drain(LATEST, first=True)
            terminal.drain(SETTLE)
            for name, key in zip(took, (b"/", b"9"), strict=True):
                before = terminal.ran()
                os.write(terminal.fd, key)
                wall = terminal.drain(3.0, first=True)[1]
                took[name].append((wall, terminal.ran() - before))
                terminal.drain(0.8)
        finally:
            terminal.end()
    for name, found in took.items():
        walls, cpus = zip(*found, strict=True)
        print(
            f"{count} robots, {name:<18} median {1000 * statistics.median(walls):4.0f} ms, at most "
            f"{1000 * max(walls):4.0f} ms; of CPU {1000 * statistics.median(cpus):4.1f} ms",
            flush=True,
        )


def start(words: list[str], runs: int = 5) -> float:
    """Return the median [s] that a command takes from its start to its end."""
    took: list[float] = []
    for _ in range(runs):
        began = time.monotonic()
        subprocess.run(
            [sys.executable, "-m", "robotree.tui", *words], capture_output=True, check=False
        )  # our own program
        took.append(time.monotonic() - began)
    return statistics.median(took)


async def hand_over(times: int = 40) -> None:
    """Time how long control takes from one operator to what the other one hears, over sockets."""
    from robotree.vr import Robot
    from robotree.vr.agents.agent import RobotAgent
    from robotree.vr.base.envelope import sitting_at
    from robotree.vr.network.local import join
    from robotree.vr.supervision.realm_client import RealmClient

    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        root = Path(folder)
        agent = RobotAgent(Robot("arm"), await join("hands", root=root))
        await agent.start()
        people = {name: RealmClient(await join("hands", root=root)) for name in ("pts/1", "pts/2")}
        heard, shown = asyncio.Event(), [""]

        def hear(_: str, state: Any) -> None:
            shown[0] = state.operator
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
            while not shown[0].endswith(other):
                heard.clear()
                await heard.wait()
            found.append((time.perf_counter() - began) * 1e3)
            holder, other = other, holder
        low, middle, high = statistics.quantiles(found, n=4)
        print(f"hand-over: {middle:.1f} ms ({low:.1f} to {high:.1f}, most {max(found):.1f}), {times} times,"
              f" load {os.getloadavg()[0]:.0f}")  # fmt: skip
        await agent.close()


def main() -> None:  # noqa: PLR0911 # one for each way to measure
    """Measure all cases."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--hz", type=float, default=10.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--size", default="160x48")
    parser.add_argument("--filter", action="store_true", help="time the first `/` alone")
    parser.add_argument("--plan", action="store_true", help="measure the plan of a place alone")
    parser.add_argument("--plots", action="store_true", help="measure four plots alone")
    parser.add_argument("--hands", action="store_true", help="time a hand-over between two operators alone")
    parser.add_argument("--play", nargs="+", help=argparse.SUPPRESS)
    parser.add_argument("--bare", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.bare:
        play_bare()
        return
    if arguments.hands:
        asyncio.run(hand_over())
        return
    if arguments.play:
        count, hz = int(arguments.play[0]), float(arguments.play[1])
        if "plots" in arguments.play:
            asyncio.run(play_plots(count, hz, int(arguments.play[-1])))
            return
        asyncio.run(play(count, hz, calm="calm" in arguments.play))
        return
    print(
        f"load {os.getloadavg()[0]:.1f}, terminal {arguments.size}, {arguments.seconds:g} s each", flush=True
    )
    if arguments.plots:
        plotted(arguments)
        return
    if arguments.filter:
        first_filter(arguments.robots, arguments)
        return
    if arguments.plan:
        measure("100 robots, 4 Hz, list", 100, 4.0, arguments)
        measure("100 robots, 4 Hz, plan", 100, 4.0, arguments, keys=b"F")
        return
    measure("bare Textual, one widget", 0, 0.0, arguments)
    measure("5 robots, idle", 5, 0.0, arguments)
    measure("300 robots, idle", 300, 0.0, arguments)
    measure(f"{arguments.robots} robots, idle", arguments.robots, 0.0, arguments)
    measure("100 robots, 10 Hz", 100, 10.0, arguments)
    measure(f"{arguments.robots} robots, {arguments.hz:g} Hz", arguments.robots, arguments.hz, arguments)
    measure(
        f"{arguments.robots} robots, {arguments.hz:g} Hz, --calm",
        arguments.robots,
        arguments.hz,
        arguments,
        calm=True,
    )
    print(f"robotree --help {1000 * start(['--help']):5.0f} ms")


if __name__ == "__main__":
    main()
