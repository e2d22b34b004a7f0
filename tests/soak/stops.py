"""Stops: on a new command line, in a running supervisor, of a deep tree, and while the realm is damaged."""

from __future__ import annotations

import asyncio
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Generator, Sequence
from contextlib import asynccontextmanager, contextmanager

from robotree.vr.base.errors import VrError
from tests.command_line import ROBOTREE
from tests.soak.stage import ARM, ROVER, SQUARE, Observer, Said, Stage, Verb, holds, names
from tests.soak.table import Row, Trial

ALL = {ARM, ROVER, SQUARE}
DEPTH = 30
LOAD = 20
"""Busy loops."""
STAND = "from the start of the command line until both stand"
WHOLE_LINE = "from the start of the command line to its end"
BUSY = "import time; until = time.monotonic() + 60\nwhile time.monotonic() < until: pass"
"""A busy loop, which ends by itself."""
NEW = Row("stop", "`stop` on a new command line, two robots moving", STAND, 1.5)
ENDED = Row("stop", "the same, until the command line ends", "from its start to its end", 2.0)
RESIDENT = Row("stop", "`stop` in a supervisor that already runs", "from the order until both stand", 0.2)
DEEP = Row("stop", f"`stop` of a tree with {DEPTH} levels", "from the order until all have confirmed", 1.0)
SPLITS = {
    "removed": Row("split", "the realm's folder is removed, then `stop`", WHOLE_LINE, 2.0),
    "renamed": Row("split", "the realm's folder is renamed, then `stop`", WHOLE_LINE, 2.0),
    "paused": Row("split", "a newcomer is frozen while it joins, then `stop`", WHOLE_LINE, 2.0),
}
LOADED = Row("stop", f"`stop` on a new command line, two robots moving, beside {LOAD} busy loops", STAND, 0.5)
FEW = Row("resources", "`stop` that may open 12 files", STAND, 1.5)
FULL = Row("resources", "`stop` that can write no byte, as on a full disk", STAND, 1.5)
LAYERS = '''
"""Layer: passes each command to its child."""
from robotree.vr import Child, VirtualRobot, command

class Layer(VirtualRobot):
    """One of many."""

    below = Child("Robot")

    @command
    def nothing(self) -> None:
        """Do nothing."""
'''


async def stop_anew(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Stop both robots with a new command line while they move."""
    await stage.furnish()
    calls = await stage.both_move()
    verb = await stage.verb("stop", "--json")
    standing = Trial(NEW, await _both_stopped(stage), time.monotonic() - verb.began)
    said = await verb.end()
    ended = Trial(ENDED, said.done and names(said) >= ALL, said.seconds)
    ended.note = "" if ended.reached else str(said)
    ended.false = false_reports(said, stage)
    if standing.reached and not said.done:
        ended.false.append(f"{said}; though all are stopped, and nobody was frozen")
    ended.false += await still_moving(stage, calls)
    return [standing, ended]


@contextmanager
def busy(loops: int, *, apart: bool = False) -> Generator[None]:
    """Have processes compute.

    Args:
        loops: how many.
        apart: whether each has a session of its own. Where the kernel divides the processors between sessions
            (autogroup, sched(7)) each of them then gets as much as a whole session of ours.
    """
    line = (sys.executable, "-I", "-S", "-c", BUSY)
    processes = [subprocess.Popen(line, start_new_session=apart) for _ in range(loops)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


@asynccontextmanager
async def loaded(loops: int = LOAD, *, apart: bool = False) -> AsyncIterator[None]:
    """Keep the machine busy: see `busy`."""
    with busy(loops, apart=apart):
        await asyncio.sleep(1.0)  # until all of them run
        yield


async def stop_loaded(
    stage: Stage, _chance: random.Random, program: Sequence[str] = ROBOTREE
) -> Sequence[Trial]:
    """Stop both robots with a new command line while they move and the machine is busy."""
    await stage.furnish()
    async with loaded():
        return [await _stop_by_line(stage, LOADED, program=program)]


async def stop_without(stage: Stage, _chance: random.Random, limits: str) -> Sequence[Trial]:
    """Stop both robots with a new command line that lacks descriptors, or room on the disk."""
    await stage.furnish()
    return [await _stop_by_line(stage, FEW if limits.startswith("-n") else FULL, limits=limits)]


async def _stop_by_line(
    stage: Stage, row: Row, *, limits: str = "", program: Sequence[str] = ROBOTREE
) -> Trial:
    calls = await stage.both_move()
    verb = await stage.verb("stop", "--json", limits=limits, program=program)
    marks = marks_of(stage)
    said = await verb.end()
    stands = await _both_stopped(stage)
    trial = Trial(row, stands and said.done and names(said) >= ALL, stood(marks) - verb.began)
    trial.note = f"confirmed after {said.seconds:.2f} s" if trial.reached else str(said)
    trial.false = false_reports(said, stage) + await still_moving(stage, calls)
    return trial


def marks_of(stage: Stage) -> list[tuple[Observer, tuple[float, float]]]:
    return [(one, one.mark()) for one in (stage.arm, stage.rover)]


def stood(marks: Sequence[tuple[Observer, tuple[float, float]]]) -> float:
    """[s] on our clock: when the last one of them was heard to move for the last time."""
    return max(one.stood_at(mark) for one, mark in marks)


async def stop_resident(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Stop both robots with a supervisor that already runs while they move."""
    await stage.furnish()
    calls = await stage.both_move()
    await asyncio.sleep(chance.uniform(0.0, 0.5))
    began = time.monotonic()
    order = asyncio.ensure_future(stage.realm_client.stop(None))
    trial = Trial(RESIDENT, await _both_stopped(stage), time.monotonic() - began)
    try:
        if not set(await order) >= ALL:
            trial.false.append(f"it confirms {sorted(await order)} only")
    except VrError as error:
        trial.false.append(f"{error}; though nobody was frozen")
    trial.false += await still_moving(stage, calls)
    return [trial]


async def stop_deep(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Stop a deep tree from its top; the first trial builds it for all others."""
    await stage.furnish()
    tree = {one.name for one in await stage.realm_client.tree()}
    if f"layer-{DEPTH}" not in tree:
        page = stage.folder.parent.parent / "layer.py"
        page.write_text(LAYERS)
        for level in range(1, DEPTH + 1):
            await stage.realm_client.create(str(page), f"layer-{level}")
            child = SQUARE if level == 1 else f"layer-{level - 1}"
            await stage.realm_client.enslave(f"layer-{level}", "below", child)
    wanted = {f"layer-{level}" for level in range(1, DEPTH + 1)} | {SQUARE, ROVER}
    verb, _ = await stage.move_square()
    await stage.rover.moves(3.0)
    await asyncio.sleep(chance.uniform(0.0, 0.5))
    began = time.monotonic()
    try:
        told = set(await stage.realm_client.stop(f"layer-{DEPTH}"))
    except VrError as error:
        trial = Trial(
            DEEP, stage.rover.stopped, time.monotonic() - began, [f"{error}; though nobody was frozen"]
        )
    else:
        trial = Trial(DEEP, wanted <= told and stage.rover.stopped, time.monotonic() - began)
        trial.note = "" if trial.reached else f"without {sorted(wanted - told)}"
    await verb.end()
    return [trial]


async def take_down(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Delete the deep tree."""
    await stage.furnish()
    for level in range(DEPTH, 0, -1):
        await stage.realm_client.delete(f"layer-{level}")
    return []


async def split(stage: Stage, chance: random.Random, how: str) -> Sequence[Trial]:
    """Remove or rename the folder of the realm, or freeze a process that enters it, and stop everything."""
    await stage.furnish()
    calls = await stage.both_move()
    newcomer = None
    if how == "removed":
        shutil.rmtree(stage.folder)
    elif how == "renamed":
        stage.folder.rename(stage.folder.with_name(f"{stage.realm}-{chance.randrange(10**9)}"))
    else:
        newcomer = await stage.verb("ls")
        await asyncio.sleep(chance.uniform(0.05, 0.5))
        if not newcomer.over:
            os.kill(newcomer.pid, signal.SIGSTOP)
    try:
        said = await stage.say("stop", "--json")
        trial = Trial(
            SPLITS[how], said.done and names(said) >= ALL and await _both_stopped(stage), said.seconds
        )
        trial.note = "" if trial.reached else str(said)
        trial.false = false_reports(said, stage)
    finally:
        if newcomer is not None:
            newcomer.kill()
    await stage.expect_whole(trial)
    for call in calls:
        await call.end()
    return [trial]


def false_reports(said: Said, stage: Stage) -> list[str]:
    if said.done and not (stage.arm.stopped and stage.rover.stopped):
        return [f"{said}; but one of them is not stopped"]
    return []


async def _both_stopped(stage: Stage) -> bool:
    return await holds(lambda: stage.arm.stopped and stage.rover.stopped, 5.0)


async def still_moving(stage: Stage, calls: Sequence[Verb]) -> list[str]:
    """Check that both robots stand and that no call reports success."""
    found = list[str]()
    for one in (stage.arm, stage.rover):
        if not await one.stands(1.0):
            found.append("a robot that says it is stopped still moves a second later")
    for call in calls:
        said = await call.end()
        if said.done:
            found.append(f"{said}; though it was stopped in the middle")
    return found
