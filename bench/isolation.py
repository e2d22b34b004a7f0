"""What it costs to keep a robot apart: until it can be called, a call of it, and its own memory; by level.

    python bench/isolation.py [--robots N] [--calls N] [--json]

Per level: a host of its own makes N robots of the same page one after the other, then each is called. A
robot's own memory is what no other process has, too (`Private_Dirty` and `Private_Clean` of
/proc/PID/smaps_rollup, proc(5)); of robots in the host's process that cannot be said. Also how long a panel
that is a program takes until it has drawn.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

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


async def measure(level: Isolation, robots: int, calls: int, folder: Path) -> dict[str, Any]:
    """Measure one level."""
    transport = await join("bench", root=folder / "run")
    operator = await join("bench", root=folder / "run")
    runner = runner_of(asyncio.get_running_loop())
    journal = HostJournal(folder / "h1", runner)
    process: Process[Any] = Process(runner, journal)
    way = kept_by(journal, process, transport)
    host = Host(way, "h1", process=process, journal=journal)
    setting = ApartSetting("h1", "bench", 5.0, 10.0, LIMIT, folder / "h1")
    host.apart = apart = RobotsApart(setting, way)
    await host.start()
    await host.restore()
    client, page = HostClient(operator, host.address), Bundle(PAGE, "adder.py")
    try:
        began = time.perf_counter()
        await client.create(page, "first", None, level)
        first = time.perf_counter() - began
        ready: list[float] = []
        addresses: list[Address] = []
        for number in range(robots):
            began = time.perf_counter()
            addresses.append((await client.create(page, f"r{number}", None, level)).address)
            ready.append(time.perf_counter() - began)
        one, took = RobotClient(operator, addresses[0]), []
        for number in range(calls):
            began = time.perf_counter()
            await one.call("add", {"a": number, "b": 1})
            took.append(time.perf_counter() - began)
        processes = [apart.robots[address.name].pid for address in addresses if level != "none"]
        own = [*map(_own, processes)]
        return {
            "level": level,
            "cpu_ms_mean": round(statistics.mean(map(_cpu, processes)), 0) if processes else None,
            "first_ms": round(1000 * first, 1),
            "ready_ms_p50": round(1000 * statistics.median(ready), 1),
            "ready_ms_max": round(1000 * max(ready), 1),
            "call_ms_p50": round(1000 * statistics.median(took), 2),
            "own_mb_p50": round(statistics.median(own), 1) if own else None,
            "own_mb_max": round(max(own), 1) if own else None,
        }
    finally:
        await host.close()
        journal.close()
        await operator.close()
        await transport.close()


def _cpu(pid: int) -> float:
    """Return the processor time of a process so far [ms]: user and system (proc(5), stat 14 and 15)."""
    user, system = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return 1000 * (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


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
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=20)
    parser.add_argument("--calls", type=int, default=200)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    found: list[dict[str, Any]] = []
    for level in LEVELS:
        if level != "none" and (lack := lack_for(level)):
            found.append({"level": level, "lack": lack})
            continue
        with tempfile.TemporaryDirectory(prefix="rt-") as folder:
            found.append(asyncio.run(measure(level, given.robots, given.calls, Path(folder))))
    panels = asyncio.run(panel(5))
    found.append({"panel_ms_p50": round(statistics.median(panels)), "panel_ms_max": round(max(panels))})
    load = os.getloadavg()[0]
    for row in [*found, {"load": round(load, 1)}]:
        print(json.dumps(row) if given.json else "  ".join(f"{name} {value}" for name, value in row.items()))


if __name__ == "__main__":
    main()
