"""Deaths that are noticed late: a process that is frozen while others end reads their ends with the rest."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import time
from collections.abc import Sequence
from pathlib import Path

from tests.soak.observer import holds
from tests.soak.stage import Stage
from tests.soak.table import Row, Trial

WITNESSES = ("lookup-1", "host", "rover proxy")
MISSED = Row(
    "kill",
    "a process is frozen while the proxy of a moving arm is killed and a command line ends: it forgets both",
    "from SIGCONT until it has closed all that it had open of them",
    1.0,
)
OF_ANOTHER = 3
"""Descriptors that a process has open of another one: two connections and its beat."""


async def death_beside_data(stage: Stage, _chance: random.Random, witness: str) -> Sequence[Trial]:
    """Freeze one process while a command line comes and goes and the proxy of an arm is killed; wake it."""
    await stage.furnish()
    dying, witnessing = stage.pid("arm proxy"), stage.pid(witness)
    known = await holds(lambda: has_open(witnessing, dying), 5.0)
    before = descriptors(witnessing)
    os.kill(witnessing, signal.SIGSTOP)
    try:
        call, _ = await stage.move_arm()
        moved = await stage.arm.moves()
        await stage.kill("arm proxy")
        await call.end()
    finally:
        os.kill(witnessing, signal.SIGCONT)
    woke, left = time.monotonic(), before - OF_ANOTHER
    forgot = await holds(lambda: descriptors(witnessing) <= left, 5.0)
    trial = Trial(MISSED, known and moved and forgot, time.monotonic() - woke)
    if not forgot:
        trial.note = f"the {witness} has {descriptors(witnessing)} descriptors instead of {left}"
    await stage.restart("arm proxy")
    if not await stage.whole():
        trial.reached, trial.note = False, "the realm is not whole after the proxy was restarted"
    return [trial]


def descriptors(pid: int) -> int:
    """Return how many descriptors a process has open."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def has_open(witness: int, other: int) -> bool:
    """Whether a process has the beat of another one open."""
    for link in Path(f"/proc/{witness}/fd").iterdir():
        with contextlib.suppress(OSError):
            if f"/{other}-" in str(link.readlink()):
                return True
    return False
