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
    damage,
    freezes,
    kills,
    resources,
    rules,
    screens,
    stops,
)
from tests.soak.stage import Stage, staged
from tests.soak.table import Row, Trial, is_good, table

Try = Callable[[Stage, random.Random], Awaitable[Sequence[Trial]]]
LONGEST_TRIAL = 60.0
"""[s] A trial that takes longer hangs."""
ROOM = "8m"
"""Size of the file systems on which the folders of realm and state lie."""
BROKEN = Row("campaign", "the trial itself", "")


PLAN: tuple[tuple[int, int, str, *tuple[Try, ...]], ...] = (
    (1, 4, "epoch", rules.great_epochs),
    (1, 4, "second", rules.second_proxy),
    (1, 4, "once", rules.lost_result),
    (1, 4, "foreign", rules.foreign_heartbeat),
    (1, 4, "replay", rules.replay),
    (1, 4, "crossed", rules.crossed),
    (1, 4, "plain", rules.plain),
    (3, 15, "split", *(partial(stops.split, how=how) for how in stops.SPLITS)),
    (1, 10, "stop", stops.stop_anew),
    (1, 10, "order", stops.stop_resident),
    (1, 10, "loaded", stops.stop_loaded),
    (1, 10, "few", partial(stops.stop_without, limits="-n 12")),
    (1, 10, "full", partial(stops.stop_without, limits="-f 0")),
    (0, 10, "deep", stops.stop_deep),
    (0, 1, "deep-end", stops.take_down),
    (8, 64, "kill", *(partial(kills.kill, victim=victim) for victim in kills.VICTIMS)),
    (4, 12, "fork", *(partial(kills.host_dies, way=way) for way in kills.WAYS)),
    (4, 12, "fork-proxy", *(partial(kills.proxy_dies, way=way) for way in kills.WAYS)),
    (1, 9, "end", *(partial(kills.death_beside_data, witness=witness) for witness in kills.WITNESSES)),
    (1, 8, "panel", screens.hang_and_wake),
    (1, 8, "deleted", screens.delete_loaded),
    (1, 5, "crowd", resources.crowd_ends),
    (1, 5, "crowd-stop", resources.crowd_stopped),
    *((1, 4, fault, partial(resources.exhaust, fault=fault)) for fault in resources.FAULTS),
    (1, 4, "fence", damage.fence),
    (1, 4, "key", damage.key),
    (1, 4, "page", damage.page),
    (1, 4, "list", damage.robots),
    (1, 4, "held", partial(resources.hold, letters=27, kill=False)),
    (1, 4, "held-end", partial(resources.hold, letters=29, kill=True)),
    (0, 1, "lives", resources.come_and_go),
    (3, 54, "freeze", *(partial(freezes.freeze, victim=victim) for victim in freezes.VICTIMS)),
)
"""How often each trial is played by a quick and by a whole campaign; of several ways each in its turn."""


def plan(quick: bool) -> Iterator[tuple[str, Try]]:  # noqa: FBT001 # the one option that there is
    """Name all trials, in their order."""
    for few, many, name, *ways in PLAN:
        for number in range(few if quick else many):
            yield f"{name}-{number}", ways[number % len(ways)]


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
        async with asyncio.timeout(resources.LONGEST_LIVES if name.startswith("lives") else LONGEST_TRIAL):
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
