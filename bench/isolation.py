"""What it costs to keep a robot apart: until it can be called, a call of it, and its own memory; by level.

    python bench/isolation.py [--robots N] [--calls N]

Per level: a host of its own makes N robots of the same page one after the other, then each is called. A
robot's own memory is what no other process has, too (`Private_Dirty` and `Private_Clean` of
/proc/PID/smaps_rollup, proc(5)); of robots in the host's process that cannot be said. Also how long a panel
that is a program takes until it has drawn.
"""

from __future__ import annotations

import asyncio
import statistics
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from measuring import apart, clocked, cpu, options, tell

from robotree.tui.panels import frames
from robotree.tui.panels.outside import PanelProcess
from robotree.vr.agents.host import Host
from robotree.vr.agents.run import kept_by
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.permissions import LEVELS, Isolation
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.loader import LIMIT
from robotree.vr.exchange.client import HostClient, RobotClient
from robotree.vr.isolation.apart import ApartSetting, RobotsApart, lack_for
from robotree.vr.journal.journal import HostJournal
from robotree.vr.network.local import join
from robotree.vr.running.process import Process
from robotree.vr.running.runner import runner_of

PAGE = '''"""A page."""

from robotree.vr import VirtualRobot, command


class Adder(VirtualRobot):
    """Adds."""

    @command
    def add(self, a: int, b: int) -> int:
        """Add."""
        return a + b
'''
PANEL = """
from textual.widgets import Button

from robotree.tui.panels.author import RobotPanel


class Panel(RobotPanel):
    def compose(self):
        yield Button("drawn")
"""


async def measure(level: Isolation, robots: int, calls: int, folder: Path) -> dict[str, float]:
    """Measure one level."""
    transport, operator = await join(), await join()
    runner = runner_of(asyncio.get_running_loop())
    journal = HostJournal(folder / "h1", runner)
    process: Process[Any] = Process(runner, journal)
    way = kept_by(journal, process, transport)
    host = Host(way, "h1", process=process, journal=journal)
    setting = ApartSetting("h1", "bench", 5.0, 10.0, LIMIT, folder / "h1")
    host.apart = robots_apart = RobotsApart(setting, way)
    await host.start()
    await host.restore()
    client, page = HostClient(operator, host.address), Bundle(PAGE, "adder.py")
    try:
        (first,) = await clocked(1, lambda _: client.create(page, "first", None, level))
        addresses: list[Address] = []

        async def create(number: int) -> None:
            addresses.append((await client.create(page, f"r{number}", None, level)).address)

        ready = await clocked(robots, create)
        called = RobotClient(operator, addresses[0])
        took = await clocked(calls, lambda number: called.call("add", {"a": number, "b": 1}))
        found = {
            "first robot is there, ms": 1000 * first,
            "robot is there, p50, ms": 1000 * statistics.median(ready),
            "robot is there, most, ms": 1000 * max(ready),
            "call, p50, ms": 1000 * statistics.median(took),
        }
        if level != "none":
            processes = [robots_apart.robots[address.name].pid for address in addresses]
            own = [*map(_own, processes)]
            found |= {
                "processor of its start, ms": 1000 * statistics.mean(map(cpu, processes)),
                "own memory, p50, MB": statistics.median(own),
                "own memory, most, MB": max(own),
            }
        return found
    finally:
        await host.close()
        journal.close()
        await operator.close()
        await transport.close()


def _own(pid: int) -> float:
    """Return the memory [MB] that only this process, or its child in a box, has."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    rows = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
    private = sum(int(row.split()[1]) for row in rows if row.startswith("Private_")) / 1024
    return private + sum(_own(int(child)) for child in children)


class Hands:
    """Shows nothing, and notes when something was drawn."""

    def __init__(self) -> None:
        """Wait."""
        self.drawn = asyncio.Event()

    async def carry_out(self, command: str, arguments: Mapping[str, Any]) -> Any:
        """Refuse nothing: nothing is asked for."""

    async def look(self, view: str, camera: str, width: int, height: int) -> bytes:  # noqa: ARG002 # as it is asked
        """See `carry_out`."""
        return b""

    def draw_lines(self, lines: Mapping[int, list[frames.Span]]) -> None:
        """Note it."""
        if any("drawn" in text for spans in lines.values() for text, *_ in spans):
            self.drawn.set()

    def be_up(self, frame: frames.PanelUp) -> None:
        """It has not drawn yet."""

    def be_over(self, reason: str) -> None:
        """Fail."""
        raise SystemExit(f"the panel is over: {reason}")


async def panel(times: int) -> list[float]:
    """Return how long panels take until they have drawn [ms]."""
    robot = RobotDescription(address=Address("robot", "r", "1"), kinds=("Adder",), commands=())
    took: list[float] = []
    for _ in range(times):
        hands, began = Hands(), time.perf_counter()
        begin = frames.BeginPanel(PANEL, "adder.panel.py", {}, robot, 60, 20, dark=True)
        process = PanelProcess(begin, None, hands)
        await hands.drawn.wait()
        took.append(1000 * (time.perf_counter() - began))
        process.close()
        await asyncio.sleep(0.2)
    return took


def main() -> None:
    """Measure all levels that there are here."""
    given = options(__doc__, robots=20, calls=200)
    for level in LEVELS:
        print(f"level {level}")
        if level != "none" and (lack := lack_for(level)):
            print(lack)
            continue
        with apart() as folder:
            tell(asyncio.run(measure(level, given.robots, given.calls, folder)))
    panels = asyncio.run(panel(5))
    tell({"panel is drawn, p50, ms": statistics.median(panels), "panel is drawn, most, ms": max(panels)})


if __name__ == "__main__":
    main()
