"""Freezes: processes stopped with SIGSTOP for a while, often for about as long as a time-out."""

from __future__ import annotations

import asyncio
import random
import re
import time
from collections.abc import Sequence

from robotree.vr.supervision.stop import CONFIRM
from tests.soak.stage import ARM, ROVER, SQUARE, Said, Stage, holds, missed, names
from tests.soak.stops import WHOLE_LINE
from tests.soak.table import Row, Trial

SHORTEST, LONGEST = 0.5, 6.0
"""[s]"""
TIMEOUTS = (1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0)
"""[s] Time-outs of the system: watchdogs, heartbeats, leases, confirmations, and their sums."""
AROUND = 0.06
"""[s]"""
VICTIMS = ("arm proxy", "rover proxy", "host", "lookup-1", "arm controller", "rover controller")
CONCERNED = {
    "arm proxy": {ARM},
    "rover proxy": {ROVER, SQUARE},
    "host": {SQUARE, ROVER},
    "lookup-1": set[str](),
    "arm controller": {ARM},
    "rover controller": {ROVER, SQUARE},
}
"""Robots that cannot confirm a stop while this process is frozen."""
HEALED = "from SIGCONT until all see each other, a new process too"
HEALS = {victim: Row("freeze", victim, HEALED, 3.0) for victim in VICTIMS}
STOPPED = Row(
    "freeze",
    "`stop` while one process is frozen: all other robots stand",
    "from the start of the command line until all others stand",
    1.5,
)
SPOKE = Row(
    "freeze", "`stop` while one process is frozen: names the robots it did not reach", WHOLE_LINE, 1.5
)
SPOKE_OF_A_CONTROLLER = Row(
    "freeze", "`stop` while one controller is frozen: names the robots it did not reach", WHOLE_LINE, CONFIRM
)
"""It is no process of the realm: on the wire a frozen one looks like one that needs its time to stop."""


def how_long(chance: random.Random) -> float:
    """Draw a duration [s]; two of three are near a time-out."""
    if chance.random() < 1 / 3:
        return chance.uniform(SHORTEST, LONGEST)
    return chance.choice(TIMEOUTS) + chance.uniform(-AROUND, AROUND)


async def freeze(stage: Stage, chance: random.Random, victim: str) -> Sequence[Trial]:
    """Freeze one process while both robots move; stop everything afterwards, often also meanwhile."""
    await stage.furnish()
    seconds, stopping = how_long(chance), chance.random() < 0.5
    calls = await stage.both_move()
    freezing = asyncio.create_task(stage.frozen(victim, seconds))
    trials: list[Trial] = []
    if stopping and seconds > 1.5:
        await asyncio.sleep(chance.uniform(0.0, seconds - 1.2))
        trials = await _stop(stage, victim)
    await freezing
    woke = time.monotonic()
    healed = Trial(HEALS[victim], await stage.whole())
    healed.seconds = time.monotonic() - woke
    healed.note = "" if healed.reached else f"not whole 10 s after a freeze of {seconds:.3f} s"
    again = await stage.say("stop", "--json")
    for call in calls:
        if (said := await call.end(10.0)).code is None:
            healed.false.append(
                f"`{said.words[1]}` did not end with a stop after a freeze of {seconds:.3f} s"
            )
    if healed.reached and not (
        {ARM, ROVER, SQUARE} <= names(again) and stage.arm.stopped and stage.rover.stopped
    ):
        healed.reached, healed.note = False, f"a stop after a freeze of {seconds:.3f} s: {again}"
    return [healed, *trials]


async def _stop(stage: Stage, victim: str) -> list[Trial]:
    """Stop everything while one process is frozen, and compare the report with the truth."""
    began = time.monotonic()
    verb = await stage.verb("stop", "--json")
    concerned = CONCERNED[victim]
    watched = [one for name, one in ((ARM, stage.arm), (ROVER, stage.rover)) if name not in concerned]
    reached = await holds(lambda: all(one.stopped for one in watched), 10.0)
    standing = Trial(STOPPED, reached, time.monotonic() - began)
    said = await verb.end()
    row = SPOKE_OF_A_CONTROLLER if victim.endswith("controller") else SPOKE
    spoke = Trial(row, said.code is not None, said.seconds)
    spoke.false = lies(stage, said, victim)
    if not standing.reached:
        standing.note = f"{victim} was frozen: {said}"
    return [standing, spoke] if watched else [spoke]


def lies(stage: Stage, said: Said, victim: str) -> list[str]:
    """Compare what a stop reported with the truth."""
    found = list[str]()
    claimed = names(said) if said.done else set[str]()
    for name, watched in ((ARM, stage.arm), (ROVER, stage.rover)):
        if name in claimed and watched.fresh and not watched.stopped:
            found.append(f"{said}; but {name} is not stopped")
    for name in missed(said) - CONCERNED[victim]:
        found.append(f"{said}; but {name} has nothing to do with the {victim} that was frozen")
    pid = stage.pid(victim)
    for one in re.findall(r"kill -9 (\d+)", said.complaints):
        if int(one) != pid:
            found.append(f"{said}; but process {one} was not frozen")
    if said.done and CONCERNED[victim] - names(said):
        found.append(f"{said}; it claims success and leaves out {CONCERNED[victim] - names(said)}")
    return found
