"""Hosts in processes of their own, the robots that they run, and the counter that these call: for benches.

python bench/hosts.py NAME FOLDER LOG URL PAST     what `HostProcess` starts
"""

from __future__ import annotations

import asyncio
import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import AsyncGenerator
from pathlib import Path

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.run import Keeping, place_of, run_host
from robotree.vr.agents.standby import SHORTEST_AFTER
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient

REPEATS = 200
"""Calls in one measurement."""


class Counter(Robot):
    """The end of a chain, in the process of the bench: notes when it acts."""

    moments: list[float] = []  # noqa: RUF012 # one list for the only process that has it

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> float:
        """Note the moment, and return the argument."""
        Counter.moments.append(time.monotonic())
        return x


class Bottom(VirtualRobot):
    """The end of a nested chain, in the host."""

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> float:
        """Return the argument."""
        return x


class Top(VirtualRobot):
    """Calls its child."""

    below = Child("Robot")

    @command
    def measure(self, repeats: int) -> list[float]:
        """Call the child many times; the times of all calls [us]."""
        times: list[float] = []
        for _ in range(repeats):
            began = time.perf_counter()
            self.below.step(x=1.0)
            times.append((time.perf_counter() - began) * 1e6)
        return times

    @command
    def count(self, steps: int) -> None:
        """Call the child many times."""
        for _ in range(steps):
            self.below.step(x=1.0)

    @command
    def patrol(self, steps: int = 0) -> None:
        """Take many steps, then act every now and then."""
        for _ in range(steps):
            self.random()
        while True:
            self.below.step(x=1.0)
            self.sleep(0.02)

    @command
    def walk(self, seconds: float) -> int:
        """Act every 5 ms."""
        until, acts = self.now() + seconds, 0
        while self.now() < until:
            self.below.step(x=float(acts))
            self.sleep(0.005)
            acts += 1
            if acts % 100 == 0:
                self.checkpoint()
        return acts


async def bind(realm_client: RealmClient, host: HostProcess, top: str, bottom: str) -> None:
    """Make a robot on a host, on top of another one that is there or is made there, too."""
    await realm_client.arrival("host", host.name, within=60.0)
    if not realm_client.directory.present("robot", bottom):
        await realm_client.create(__file__, bottom, host.name, "Bottom")
    await realm_client.create(__file__, top, host.name, "Top")
    await realm_client.enslave(top, "below", bottom)


async def next_effect(after: float, within: float = 60.0) -> float:
    """Return when the counter acts for the first time after a moment [s]."""
    async with asyncio.timeout(within):
        while not Counter.moments or Counter.moments[-1] <= after:  # noqa: ASYNC110 # of another thread
            await asyncio.sleep(0.002)
    return next(moment for moment in Counter.moments if moment > after)


@contextlib.asynccontextmanager
async def counters(*names: str) -> AsyncGenerator[None]:
    """Have counters in this process."""
    transport = await join()
    agents = [RobotAgent(Counter(name), transport) for name in names]
    try:
        for agent in agents:
            await agent.start()
        yield
    finally:
        for agent in agents:
            await agent.close()
        await transport.close()


class HostProcess:
    """A host in a process of its own."""

    def __init__(  # what `run_host` is told
        self,
        name: str,
        folder: Path | None,
        *,
        of: str = "",
        url: str = "",
        past: bool = False,
    ) -> None:
        """Prepare it.

        Args:
            name: of the host.
            folder: of its journal; None: it keeps nothing.
            of: name of the host for which it stands by.
            url: of the database of its journal, instead of the folder.
            past: whether it keeps what its robots did, too.
        """
        self.name, self.folder = name, folder
        self._words = [name, str(folder or ""), of, url, "past" * past]

    def start(self) -> float:
        """Start it; returns after how long it was ready, or stood by [s]."""
        began = time.monotonic()
        self.process = subprocess.Popen([sys.executable, __file__, *self._words], stdout=subprocess.PIPE)
        assert self.process.stdout is not None  # noqa: S101 # started with a pipe
        self.process.stdout.readline()
        return time.monotonic() - began

    def kill(self) -> None:
        """End it at once. Twice is once."""
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    @property
    def size(self) -> int:
        """[bytes] of its log."""
        return 0 if self.folder is None else sum(file.stat().st_size for file in self.folder.glob("*.log"))


def main() -> None:
    """Be a host."""
    name, folder, of, url, past = sys.argv[1:]
    kept = Path(folder) if folder else None
    place = place_of(kept, url, of or name)
    keep = None if place is None else Keeping(place, of, SHORTEST_AFTER)

    def ready(_: object) -> None:
        print("ready", flush=True)

    asyncio.run(run_host(name, keep=keep, past=kept if past else None, ready=ready))


if __name__ == "__main__":
    main()
