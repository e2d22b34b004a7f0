"""What a page costs its author: lines, and how long creating, reloading, reading and importing take.

    python bench/authoring.py [ROUNDS]

A real host, lookup service, simulated arm and proxy, each a process of its own. Promised: pick-and-place with
progress, clean-up and units in 31 lines; create 60 ms (median, from a program that is connected); `robotree
reload` 0.5 s as a whole; `get_info` through a page at 20 Hz 3 % of a core; import of `robotree.vr` 80 ms and
of the test kit 150 ms; a test of a page 100 ms; the simulated arm at 5 times real time.

Imports and rehearsals only compute, so they are given in processor time, which other programs of the machine
change little; what waits for other processes is given in real time, the median and the fastest.
"""

from __future__ import annotations

import ast
import asyncio
import logging
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # what counts lines lies beside the tests

from measuring import apart, clocked, count_given, imports, ran

from robotree.client.joining import joined
from robotree.tui.processes.crew import Crew, Member
from robotree.vr.supervision.realm_client import RealmClient
from tests.comparison.counting import code_lines

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "examples" / "pick_and_place.py"
ROBOTREE = str(Path(sys.executable).with_name("robotree"))
REALM = "bench"
RATE = 20.0
"""[Hz] at which `get_info` is asked for."""
WATCHED = 10.0
"""[s] for which the processor time is measured, with and without."""
KIT = "from robotree.testing import Fake, cell, rehearse, rehearse_seeds"


def page_lines(path: Path) -> int:
    """Return how many lines a page has below its first docstring, blank ones included."""
    first = ast.parse(path.read_text()).body[0]
    return len(path.read_text().splitlines()) - (first.end_lineno or 0) - 1


def tell(what: str, value: float, unit: str, promised: float, *, at_least: bool = False) -> None:
    """Print one figure, and whether it is what is promised."""
    kept = value >= promised if at_least else value <= promised
    word = "at least" if at_least else "at most"
    print(
        f"{what:<58}{value:8.4g} {unit:<4} {word} {promised:g}: {'kept' if kept else 'NOT kept'}", flush=True
    )


def used(members: list[Member]) -> float:
    """Return the processor time [s] that processes have used."""
    return sum(ran(member.pid) for member in members)


async def create(realm_client: RealmClient, rounds: int) -> list[float]:
    """Create robots of the page one after the other; each is deleted before the next."""
    took: list[float] = []
    for number in range(rounds):
        name = f"picker-{number}"
        took += await clocked(1, lambda _, name=name: realm_client.create(str(PAGE), name))
        await realm_client.delete(name)
    return took


async def share_of_a_core(realm_client: RealmClient, members: list[Member]) -> float:
    """Return the share of a core that `get_info` through a page costs at 20 Hz, host and proxy together."""
    await asyncio.sleep(1.0)
    before = used(members)
    await asyncio.sleep(WATCHED)
    idle = used(members) - before
    before, end = used(members), time.perf_counter() + WATCHED
    due = time.perf_counter()
    while due < end:
        await realm_client.call("reader", "get_info", {})
        due += 1.0 / RATE
        await asyncio.sleep(max(0.0, due - time.perf_counter()))
    return (used(members) - before - idle) / WATCHED


async def reload() -> None:
    """Carry out a whole command line."""
    words = (ROBOTREE, "reload", "reader")
    process = await asyncio.create_subprocess_exec(*words, stdout=asyncio.subprocess.DEVNULL)
    if await process.wait():
        raise SystemExit(f"{' '.join(words)} failed")


async def living(rounds: int) -> None:
    """Measure what needs processes."""
    async with Crew(REALM) as crew:
        arm = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--state", "none")
        await crew.start("lookup", "lookup-1")
        host = await crew.start("host", "host-1")
        proxy = await crew.start("proxy", "arm", "arm-1", "--connect", arm.address)
        async with joined(REALM) as realm_client:
            await create(realm_client, 3)
            took = await create(realm_client, rounds)
            tell("create, median", 1e3 * statistics.median(took), "ms", 60)
            tell("create, fastest", 1e3 * min(took), "ms", 60)
            await realm_client.create(str(ROOT / "examples" / "move_to.py"), "reader")
            await realm_client.enslave("reader", "arm", "arm-1")
            share = await share_of_a_core(realm_client, [host, proxy])
            tell("get_info through a page at 20 Hz, host and proxy", 100 * share, "%", 3)
            again = await clocked(rounds, lambda _: reload())
            tell("robotree reload, whole command, median", statistics.median(again), "s", 0.5)
            tell("robotree reload, whole command, fastest", min(again), "s", 0.5)


def rehearsals() -> None:
    """Measure the test kit."""
    logging.disable(logging.CRITICAL)
    sys.path.insert(0, str(ROOT / "examples"))
    from move_to import MoveTo

    from robotree.kinds import Arm
    from robotree.testing import Fake, cell, rehearse, rehearse_seeds

    goal = {"x": 0.4, "y": 0.2, "z": 0.3, "twist": 0.0}
    took: list[float] = []
    for _ in range(20):
        began = time.process_time()
        with rehearse(MoveTo, arm=Fake(Arm)) as team:
            team.call("move", **goal)
        took.append(time.process_time() - began)
    tell("a test of a page with a fake, median", 1e3 * statistics.median(took), "ms", 100)
    began = time.process_time()
    rehearse_seeds(MoveTo, "move", goal, arm=Fake(Arm))
    tell("the same under 100 seeds with faults", time.process_time() - began, "s", 10)
    with rehearse(MoveTo, arm=cell("arm")) as team:
        began, since = time.process_time(), team.now
        for y in (0.2, -0.2, 0.2, -0.2):
            team.call("move", **goal | {"y": y})
        factor = (team.now - since) / (time.process_time() - began)
    tell("virtual time of the simulated arm by processor time", factor, "", 5, at_least=True)


def main() -> None:
    """Measure everything."""
    rounds = count_given(1, 20)
    tell("pick-and-place with progress, clean-up and units, lines", page_lines(PAGE), "", 31)
    tell("the same without blank lines and docstrings", code_lines(PAGE.read_text()), "", 31)
    tell("import robotree.vr, median", 1e3 * imports("import robotree.vr", rounds), "ms", 80)
    tell("import of the test kit's four names, median", 1e3 * imports(KIT, rounds), "ms", 150)
    rehearsals()
    asyncio.run(living(rounds))


if __name__ == "__main__":
    with apart(REALM):
        main()
