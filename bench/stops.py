"""How long `stop` of all robots takes on a new member of a realm in trouble, and whether all have confirmed.

    python bench/stops.py [ROUNDS]
    python bench/stops.py load [ROUNDS] [PROGRAM]

Each round has a realm of its own with two lookup services and two robots in processes of their own. Measured
is from joining the realm until all have confirmed [s]; the start of Python is not in it.

`load`: how long `robotree stop` takes as a new command line beside 20 busy loops while an arm and a
rover move. Measured is from its start until each stands, as an observer on a link of its own hears it, and
until the line ends. First the loops share one session, then each has its own. PROGRAM: another command line
than that of this environment, such as an installed one.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the realm at load lies beside the tests

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.author.robot import Robot
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient
from tests.command_line import ROBOTREE
from tests.soak.stage import staged
from tests.soak.stops import loaded

CROWD = 25
_Process = subprocess.Popen[str]
NAMES = ["left", "right"]


async def be_robot(root: Path, name: str) -> None:
    """A process with one robot."""
    transport = await join("bench", root=root)
    agent = RobotAgent(Robot(name), transport, registrar=Registrar(transport))
    await agent.start()
    print("ready", flush=True)
    await asyncio.to_thread(sys.stdin.read)


async def be_lookup(root: Path, name: str) -> None:
    """A process with one lookup service."""
    transport = await join("bench", root=root)
    await LookupService(transport, name).start()
    print("ready", flush=True)
    await asyncio.to_thread(sys.stdin.read)


def start(word: str, root: Path, name: str, *, wait: bool = True) -> _Process:
    """Start this program as something else."""
    process = subprocess.Popen(
        [sys.executable, __file__, word, str(root), name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    if wait and process.stdout is not None:
        process.stdout.readline()
    return process


def nothing(_: Path, __: list[_Process], ___: list[_Process]) -> None:
    """A realm without trouble."""


def both_lookups_dead(_: Path, lookups: list[_Process], __: list[_Process]) -> None:
    """`kill -9` for both at the moment of the stop."""
    for lookup in lookups:
        lookup.kill()


def newcomers(root: Path, _: list[_Process], others: list[_Process]) -> None:
    """25 processes that join meanwhile."""
    others += [start("robot", root, f"new-{number}", wait=False) for number in range(CROWD)]
    while len(list((root / "bench").glob("*.sock"))) < len(NAMES) + 3:  # the first of them has come
        time.sleep(0.005)  # a file of another process: nothing wakes us


def a_paused_newcomer(root: Path, _: list[_Process], others: list[_Process]) -> None:
    """SIGSTOP for one that is just visible."""
    before = len(list((root / "bench").glob("*.sock")))
    others.append(start("robot", root, "paused", wait=False))
    while len(list((root / "bench").glob("*.sock"))) == before:
        time.sleep(0.001)  # as above, and quickly: it must not have joined
    os.kill(others[-1].pid, signal.SIGSTOP)


def folder_removed(root: Path, _: list[_Process], __: list[_Process]) -> None:
    """The realm's folder is removed."""
    shutil.rmtree(root / "bench")


Trouble = Callable[[Path, list[_Process], list[_Process]], None]
TROUBLES: list[Trouble] = [nothing, both_lookups_dead, newcomers, a_paused_newcomer, folder_removed]


async def stop(root: Path) -> tuple[float, str]:
    """Join and stop all; returns the seconds that it took and what was reported."""
    began = time.perf_counter()
    transport = await join("bench", root=root)
    try:
        confirmed = await RealmClient(transport).stop(None)
        said = "all confirmed" if {*NAMES} <= {*confirmed} else f"only {', '.join(confirmed)}"
    except Exception as error:  # noqa: BLE001 # it is what is shown
        said = str(error)
    took = time.perf_counter() - began
    await transport.close()
    return took, said


async def at_load(rounds: int, program: Sequence[str]) -> None:
    """Print the table of stops beside busy loops."""
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        os.environ.update(XDG_RUNTIME_DIR=folder, XDG_STATE_HOME=folder)
        async with staged("bench", Path(folder)) as stage:
            for apart, sessions in ((False, "one session"), (True, "20 sessions")):
                found: dict[str, list[float]] = {"arm": [], "rover": [], "confirmed": []}
                for _ in range(rounds):
                    await stage.furnish()
                    async with loaded(apart=apart):
                        calls = await stage.both_move()
                        verb = await stage.verb("stop", program=program)
                        marks = {"arm": stage.arm.mark(), "rover": stage.rover.mark()}
                        said = await verb.end()
                        await asyncio.gather(stage.arm.stands(), stage.rover.stands())
                    for name, mark in marks.items():
                        found[name].append(getattr(stage, name).stood_at(mark) - verb.began)
                    found["confirmed"].append(said.seconds if said.done else float("inf"))
                    await asyncio.gather(*(call.end() for call in calls))
                for name, seconds in found.items():
                    middle, most = statistics.median(seconds), max(seconds)
                    print(f"20 loops in {sessions:12} {name:10} median {middle:.2f} s, max {most:.2f}")


def main(rounds: int) -> None:
    """Print the table."""
    for trouble in TROUBLES:
        times: list[float] = []
        reports: set[str] = set()
        for _ in range(rounds):
            with tempfile.TemporaryDirectory(prefix="rt-") as folder:
                root = Path(folder)
                lookups = [start("lookup", root, f"lookup-{number}") for number in range(2)]
                others = [start("robot", root, name) for name in NAMES]
                trouble(root, lookups, others)
                took, said = asyncio.run(stop(root))
                times.append(took)
                reports.add(said[:100])
                for process in [*lookups, *others]:
                    process.kill()
                    process.communicate()
        print(
            f"{trouble.__name__:20} median {statistics.median(times):.3f} s, max {max(times):.3f}  "
            f"{'; '.join(sorted(reports))}"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["load"]:
        asyncio.run(at_load(int((sys.argv[2:3] or ["8"])[0]), sys.argv[3:] or ROBOTREE))
    elif len(sys.argv) > 3:
        asyncio.run({"robot": be_robot, "lookup": be_lookup}[sys.argv[1]](Path(sys.argv[2]), sys.argv[3]))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
