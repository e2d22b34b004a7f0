"""Robots that are created and deleted all the time: what remembers them must not grow with each."""

from __future__ import annotations

import asyncio
import random
import re
import time
from collections.abc import Sequence
from pathlib import Path

from robotree.vr.lookup.table import MOST_REMEMBERED
from tests.soak.stage import Stage
from tests.soak.table import Row, Trial

BEFORE = 2 * MOST_REMEMBERED
"""Lives until all that is bounded has as much as it ever has: tables grow once more after they are full."""
LIVES = 4000
"""Lives that are measured."""
LONGEST = 400.0
"""[s] for all of them, on a busy machine."""
AT_ONCE = 8
EACH = 200
"""[bytes] that a process may grow for each life that is measured: what the allocator needs varies by 100."""
PAGE = '''
"""Mayfly: is there, and does nothing."""
from robotree.vr import VirtualRobot

class Mayfly(VirtualRobot):
    """Is there."""
'''
GROWTH = Row(
    "memory",
    f"host and lookup services grow by at most {EACH} bytes for each robot that is created and deleted",
    f"for {LIVES} robots, after {BEFORE} others",
)


async def come_and_go(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Create and delete robots, and look how much memory the processes that know of them have taken."""
    page = stage.folder.parent / "mayfly.py"
    page.write_text(PAGE)
    pids = {name: stage.pid(name) for name in ("host", "lookup-1", "lookup-2")}
    await _live(stage, page, BEFORE)
    before = {name: memory(pid) for name, pid in pids.items()}
    began = time.monotonic()
    await _live(stage, page, LIVES)
    seconds = time.monotonic() - began
    grown = {name: (memory(pid) - before[name]) / LIVES for name, pid in pids.items()}
    told = ", ".join(f"{name} {each:.0f}" for name, each in grown.items())
    reached = max(grown.values()) <= EACH
    return [Trial(GROWTH, reached, seconds, note=f"bytes for each: {told}")]


async def _live(stage: Stage, page: Path, lives: int) -> None:
    async def live(name: str) -> None:
        await stage.realm_client.create(str(page), name)
        await stage.realm_client.delete(name)

    for first in range(0, lives, AT_ONCE):
        await asyncio.gather(*(live(f"mayfly-{first + number}") for number in range(AT_ONCE)))


def memory(pid: int) -> int:
    """Return how much memory a process has for itself [bytes] (smaps_rollup, proc_pid_smaps(5))."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return 1024 * sum(map(int, re.findall(r"^Private_(?:Clean|Dirty):\s+(\d+)", text, re.MULTILINE)))
