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
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the realm at load lies beside the tests

from measuring import Process, apart, be_robot, count_given, end, start, stay

from robotree.vr.author.robot import Robot
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.supervision.realm_client import RealmClient
from tests.command_line import ROBOTREE
from tests.soak.stage import staged
from tests.soak.stops import loaded

CROWD = 25
NAMES = ["left", "right"]


async def be_lookup(name: str) -> None:
    """A process with one lookup service."""
    await LookupService(await join(), name).start()
    await asyncio.to_thread(stay)


def nothing(_: Path, __: list[Process], ___: list[Process]) -> None:
    """A realm without trouble."""


def both_lookups_dead(_: Path, lookups: list[Process], __: list[Process]) -> None:
    """`kill -9` for both at the moment of the stop."""
    for lookup in lookups:
        lookup.kill()


def newcomers(root: Path, _: list[Process], others: list[Process]) -> None:
    """25 processes that join meanwhile."""
    others += [start(__file__, "robot", f"new-{count}", wait=False) for count in range(CROWD)]
    while len(list((root / "bench").glob("*.sock"))) < len(NAMES) + 3:  # the first of them has come
        time.sleep(0.005)  # a file of another process: nothing wakes us


def a_paused_newcomer(root: Path, _: list[Process], others: list[Process]) -> None:
    """SIGSTOP for one that is just visible."""
    before = len(list((root / "bench").glob("*.sock")))
    others.append(start(__file__, "robot", "paused", wait=False))
    while len(list((root / "bench").glob("*.sock"))) == before:
        time.sleep(0.001)  # as above, and quickly: it must not have joined
    os.kill(others[-1].pid, signal.SIGSTOP)


def folder_removed(root: Path, _: list[Process], __: list[Process]) -> None:
    """The realm's folder is removed."""
    shutil.rmtree(root / "bench")


Trouble = Callable[[Path, list[Process], list[Process]], None]
TROUBLES: list[Trouble] = [nothing, both_lookups_dead, newcomers, a_paused_newcomer, folder_removed]


async def stop() -> tuple[float, str]:
    """Join and stop all; returns the seconds that it took and what was reported."""
    began = time.perf_counter()
    transport = await join()
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
    with apart() as folder:
        async with staged("bench", folder) as stage:
            for is_apart, sessions in ((False, "one session"), (True, "20 sessions")):
                found: dict[str, list[float]] = {"arm": [], "rover": [], "confirmed": []}
                for _ in range(rounds):
                    await stage.furnish()
                    async with loaded(apart=is_apart):
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
            with apart() as folder:
                lookups = [start(__file__, "lookup", f"lookup-{count}") for count in range(2)]
                others = [start(__file__, "robot", name) for name in NAMES]
                trouble(folder / "robotree", lookups, others)
                took, said = asyncio.run(stop())
                times.append(took)
                reports.add(said[:100])
                end([*lookups, *others])
        print(
            f"{trouble.__name__:20} median {statistics.median(times):.3f} s, max {max(times):.3f}  "
            f"{'; '.join(sorted(reports))}"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["load"]:
        asyncio.run(at_load(int((sys.argv[2:3] or ["8"])[0]), sys.argv[3:] or ROBOTREE))
    elif sys.argv[1:2] == ["robot"]:
        asyncio.run(be_robot(Robot(sys.argv[2]), listed=True))
    elif sys.argv[1:2] == ["lookup"]:
        asyncio.run(be_lookup(sys.argv[2]))
    else:
        main(count_given(1, 5))
