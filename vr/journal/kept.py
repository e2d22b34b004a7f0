"""What a host that is away keeps, as others read it: nothing is locked, made or changed."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import NamedTuple

from robotree.files import opened_own
from robotree.vr.base.errors import JournalError
from robotree.vr.journal.recovery import Recovered
from robotree.vr.journal.segments import OSDisk, frames_in


class KeptAway(NamedTuple):
    """The robots of a host that is away."""

    since: float
    """[s since 1970] when it wrote last."""
    running: dict[str, tuple[str, ...]]
    """The commands that go on with it, by the names of its robots."""


def kept_away(folder: Path) -> KeptAway | None:
    """Read what a host keeps; None: it is not away, keeps nothing, or that cannot be read. Blocks.

    Args:
        folder: of its journal.
    """
    found = Recovered()
    try:
        if _in_use(folder):
            return None
        newest = max(folder.glob("*.log"), default=None)
        if newest is None:
            return None
        found.read(frames_in(OSDisk().read(newest), str(newest)), str(newest))
        since = newest.stat().st_mtime
    except (OSError, JournalError):
        return None
    running = {
        robot.name: tuple(call.command for call in robot.state.calls.live.values() if call.running)
        for robot in found.robots
    }
    return KeptAway(since, running)


def _in_use(folder: Path) -> bool:
    """Whether a host holds the lock of a folder."""
    lock = opened_own(folder / "lock")
    try:
        fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(lock)
    return False
