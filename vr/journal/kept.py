"""What a host that is away keeps, as others read it, and the stop that is left for it.

Nothing is locked. A stop of everything concerns robots, too, whose host is away or hangs: it is left as a
file beside the log, and whoever goes on with the log begins with it. If the log was written later, its host
has been awake since and has obeyed the stop itself, so the file does not count any more.

A robot in a process of its own has a folder of its own, in which its page may write, and writes its log while
its host hangs. The stop for it lies beside that folder, and counts until the host has it or all is resumed.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from robotree.files import opened_own
from robotree.vr.base.errors import JournalError
from robotree.vr.journal.recovery import Recovered
from robotree.vr.journal.segments import OSDisk, frames_in, is_locked

STOP = "stop"
"""Name of the file of a stop, which holds its reason."""
APART = "apart"
"""Name of the folder of all robots in processes of their own, in the folder of their host's journal."""
PAGE = ".page"
"""Suffix of the file, beside the folder of such a robot, that says what it is made of."""


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
        with os.fdopen(opened_own(folder / "lock"), "rb") as lock:
            in_use = is_locked(lock.fileno())
        newest = max(folder.glob("*.log"), default=None)
        if in_use or newest is None:
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


def leave_stop(folder: Path, confirmed: Collection[str], reason: str) -> tuple[str, ...]:
    """Have the robots of a log begin stopped, if not all of them have confirmed a stop. Blocks.

    Args:
        folder: of the journal of a host, or of a robot in a process of its own.
        confirmed: names of the robots that have confirmed it.
        reason: of the stop, for people.

    Returns:
        The names of the robots that have not; empty: there are none.

    Raises:
        OSError: the stop cannot be left.
    """
    if folder.parent.name == APART:  # it may have come from another host, and have written nothing here
        if folder.name in confirmed or not folder.with_name(f"{folder.name}{PAGE}").exists():
            return ()
        _write_stop(folder, reason)
        return (folder.name,)
    newest = max(folder.glob("*.log"), default=None)
    if newest is None:
        return ()
    found = Recovered()
    with suppress(OSError, JournalError):  # also a log that cannot be read may be repaired, and go on
        found.read(frames_in(OSDisk().read(newest), str(newest)), str(newest))
        if not (missed := tuple(robot.name for robot in found.robots if robot.name not in confirmed)):
            return ()
        _write_stop(folder, reason)
        return missed
    _write_stop(folder, reason)
    return (f"the robots of {folder.name}",)


def _stop_file(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.{STOP}") if folder.parent.name == APART else folder / STOP


def _write_stop(folder: Path, reason: str) -> None:
    take_stop_back(folder)
    with os.fdopen(opened_own(_stop_file(folder), os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as file:
        file.write(reason.encode())


def stop_left(folder: Path) -> str:
    """Return the reason of a stop that was left and counts; empty: none was, or it does not. Blocks.

    To be asked before anything is written to the log.

    Raises:
        OSError: it cannot be read.
    """
    try:
        descriptor = opened_own(_stop_file(folder))
    except FileNotFoundError:
        return ""
    with os.fdopen(descriptor, "rb") as file:
        left, reason = os.fstat(descriptor).st_mtime_ns, file.read(1000).decode(errors="replace")
    if folder.parent.name == APART:
        return reason or "protective stop"
    written = max((path.stat().st_mtime_ns for path in folder.glob("*.log")), default=0)
    return (reason or "protective stop") if left >= written else ""


def take_stop_back(folder: Path) -> None:
    """Forget a stop that was left: it is in the log now, or everything was resumed. Blocks.

    Raises:
        OSError: it cannot be removed.
    """
    _stop_file(folder).unlink(missing_ok=True)
