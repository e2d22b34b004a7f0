"""The fault campaign: faults in real processes, and whether what robotree reports about them is true.

    python -m tests.soak --seed 1            15 to 30 minutes
    python -m tests.soak --seed 1 --quick    three to six
    python -m tests.soak --seed 1 --only kill-17

It uses folders and ports of its own. The table goes to standard output, progress to standard error; the exit
code is 0 if every trial passed.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Generator, Iterator, Sequence
from functools import partial
from pathlib import Path

from robotree.tui.errors import MemberFailed
from robotree.vr.base.errors import VrError
from tests import apart
from tests.soak import (
    crowds,
    damage,
    ends,
    forks,
    freezes,
    kills,
    lives,
    resources,
    rules,
    screens,
    stops,
    wire,
)
from tests.soak.stage import Stage, staged
from tests.soak.table import Row, Trial, is_good, table

Try = Callable[[Stage, random.Random], Awaitable[Sequence[Trial]]]
LONGEST_TRIAL = 60.0
"""[s] A trial that takes longer hangs."""
ROOM = "8m"
"""Size of the file systems on which the folders of realm and state lie."""
BROKEN = Row("campaign", "the trial itself", "")


def plan(quick: bool) -> Iterator[tuple[str, Try]]:  # noqa: FBT001 # the one option that there is
    """Name all trials, in their order."""
    for number in range(1 if quick else 4):
        yield f"epoch-{number}", rules.great_epochs
        yield f"second-{number}", rules.second_proxy
        yield f"once-{number}", rules.lost_result
        yield f"foreign-{number}", rules.foreign_heartbeat
        yield f"replay-{number}", rules.replay
        yield f"crossed-{number}", wire.crossed
        yield f"plain-{number}", wire.plain
    for number in range(3 if quick else 15):
        yield f"split-{number}", partial(stops.split, how=("removed", "renamed", "paused")[number % 3])
    for number in range(1 if quick else 10):
        yield f"stop-{number}", stops.stop_anew
        yield f"order-{number}", stops.stop_resident
        yield f"loaded-{number}", stops.stop_loaded
        yield f"few-{number}", partial(stops.stop_without, limits="-n 12")
        yield f"full-{number}", partial(stops.stop_without, limits="-f 0")
    for number in range(0 if quick else 10):
        yield f"deep-{number}", stops.stop_deep
    if not quick:
        yield "deep-end", stops.take_down
    victims = list(kills.VICTIMS)
    for number in range(8 if quick else 64):
        yield f"kill-{number}", partial(kills.kill, victim=victims[number % len(victims)])
    for number in range(len(forks.WAYS) * (1 if quick else 3)):
        way = forks.WAYS[number % len(forks.WAYS)]
        yield f"fork-{number}", partial(forks.host_dies, way=way)
        yield f"fork-proxy-{number}", partial(forks.proxy_dies, way=way)
    for number in range(1 if quick else 9):
        witness = ends.WITNESSES[number % len(ends.WITNESSES)]
        yield f"end-{number}", partial(ends.death_beside_data, witness=witness)
    yield from _screens(1 if quick else 8)
    yield from _scripts(1 if quick else 5)
    yield from _resources(1 if quick else 4)
    for number in range(3 if quick else 54):
        victim = freezes.VICTIMS[number % len(freezes.VICTIMS)]
        yield f"freeze-{number}", partial(freezes.freeze, victim=victim)


def _screens(rounds: int) -> Iterator[tuple[str, Try]]:
    for number in range(rounds):
        yield f"panel-{number}", screens.hang_and_wake
        yield f"deleted-{number}", screens.delete_loaded


def _scripts(rounds: int) -> Iterator[tuple[str, Try]]:
    for number in range(rounds):
        yield f"crowd-{number}", crowds.ends
        yield f"crowd-stop-{number}", crowds.stopped


def _resources(rounds: int) -> Iterator[tuple[str, Try]]:
    for number in range(rounds):
        for fault in resources.FAULTS:
            yield f"{fault}-{number}", partial(resources.exhaust, fault=fault)
        yield f"fence-{number}", damage.fence
        yield f"key-{number}", damage.key
        yield f"page-{number}", damage.page
        yield f"list-{number}", damage.robots
        yield f"held-{2 * number}", partial(resources.hold, letters=26, kill=False)
        yield f"held-{2 * number + 1}", partial(resources.hold, letters=29, kill=True)
    if rounds > 1:
        yield "lives", lives.come_and_go


async def run(seed: int, *, quick: bool, only: str, limit: float) -> list[Trial]:
    """Run the trials, each with its own chance drawn from the seed and its name."""
    trials, began = list[Trial](), time.monotonic()
    with _folders() as (logs, shared):
        async with staged(f"soak-{seed}", logs) as stage:
            stage.shared = shared
            for name, attempt in plan(quick):
                if (only and not name.startswith(only)) or time.monotonic() - began > limit:
                    continue
                results = await _one(stage, name, attempt, random.Random(f"{seed}/{name}"))
                trials += results
                for result in results:
                    seconds = "" if result.seconds is None else f" {result.seconds:.2f} s"
                    good = "reached" if result.reached else "NOT REACHED"
                    told = f"{name}: {result.row.what}: {good}{seconds} {result.note} {result.false or ''}"
                    _tell(f"{time.monotonic() - began:6.1f} {told}")
    return trials


@contextlib.contextmanager
def _folders() -> Generator[tuple[Path, str]]:
    """Set the folders of realm and state, each with a small file system of its own where that can be.

    Yields:
        The folder of the logs, and why those file systems cannot be.
    """
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        logs, mounted = Path(folder), list[Path]()
        for variable, name in (("XDG_RUNTIME_DIR", "run"), ("XDG_STATE_HOME", "state")):
            (logs / name).mkdir(mode=0o700)
            os.environ[variable] = str(logs / name)
        for variable in ("ROBOTREE_REALM", "ROBOTREE_KEY"):
            os.environ.pop(variable, None)
        shared = ""
        try:
            apart.enter(network=False)
            for variable in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME"):
                apart.mount(Path(os.environ[variable]), ROOM)
                mounted.append(Path(os.environ[variable]))
        except OSError as error:
            shared = f"no file system of its own can be mounted here: {error.strerror}"
        try:
            yield logs, shared
        finally:
            for path in mounted:
                apart.unmount(path)


async def _one(stage: Stage, name: str, attempt: Try, chance: random.Random) -> list[Trial]:
    try:
        async with asyncio.timeout(lives.LONGEST if name == "lives" else LONGEST_TRIAL):
            results = list(await attempt(stage, chance) or ())
    except (TimeoutError, VrError, MemberFailed, OSError, AssertionError) as error:
        results = [Trial(BROKEN, False, note=f"{type(error).__name__}: {error}")]
        await _mend(stage)
    for result in results:
        result.number = name
    return results


async def _mend(stage: Stage) -> None:
    """Restart the processes that a broken trial left dead."""
    for name in stage.dead():
        await stage.restart(name)
    await stage.whole()


def _tell(text: str) -> None:
    sys.stderr.write(f"{text.rstrip()}\n")
    sys.stderr.flush()


def main() -> int:
    """Read the line, run the campaign, write the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="fewer trials, three to six minutes")
    parser.add_argument("--only", default="", help="trials whose names begin so")
    parser.add_argument("--limit", type=float, default=1200.0, help="[s] after which no further trial begins")
    given = parser.parse_args()
    for one in (signal.SIGINT, signal.SIGTERM):  # also where a shell has it ignored
        signal.signal(one, signal.default_int_handler)
    began = time.monotonic()
    trials = asyncio.run(run(given.seed, quick=given.quick, only=given.only, limit=given.limit))
    words = " ".join(sys.argv[1:])
    sys.stdout.write(f"`python -m tests.soak {words}`, {time.monotonic() - began:.0f} s\n\n{table(trials)}\n")
    return 0 if is_good(trials) else 1


if __name__ == "__main__":
    raise SystemExit(main())
