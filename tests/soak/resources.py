"""Resources that run out, files that are damaged, and an interpreter that is held, while both robots move."""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

from robotree.vr.base.errors import NoSuchRobot
from tests.apart import fill
from tests.soak.observer import holds
from tests.soak.stage import ARM, ROVER, SQUARE, Said, Stage, names
from tests.soak.table import Row, Trial

HOARD = 20
"""Busy loops beside the realm."""
LONGEST = 40
"""[s] after which a busy loop ends by itself."""
ROOM = 1 << 20
"""[bytes] of memory that a process may still map."""
STOPPED = "from the start of the command line until both stand"
FAULTS = {
    "disk": Row("resource", "no process can write a file, then `stop`", STOPPED, 2.0),
    "space": Row("resource", "the file systems of realm and state are full, then `stop`", STOPPED, 2.0),
    "descriptors": Row("resource", "no process can open a descriptor, then `stop`", STOPPED, 2.0),
    "memory": Row("resource", "host and proxies can map 1 MB more, then `stop`", STOPPED, 2.0),
    "files": Row("resource", "garbage in the host's beat and list, then `stop`", STOPPED, 2.0),
    "load": Row("resource", f"{HOARD} busy loops beside the realm, then `stop`", STOPPED, 1.0),
}
HELD = Row(
    "held",
    "a page holds the interpreter of the host of the robot that commands a rover",
    "from the last sign of life of the host until the rover stands",
    3.0,
)
ENDED = Row("held", "`kill PID` of that host", "from the signal until the process has ended", 4.0)
RETURNED = Row("held", "a held interpreter is free again", "until its robot has the rover again", 10.0)
PAGE = '''
"""Greedy: holds the interpreter."""
import re
from robotree.vr import VirtualRobot, command

class Greedy(VirtualRobot):
    """Computes in C."""

    @command
    def hold(self, letters: int) -> None:
        """Match for long: 5 s with 26 letters, twice as long for each more."""
        re.match(r"(a+)+$", "a" * letters + "b")
'''
ALL = {ARM, ROVER, SQUARE}


async def exhaust(stage: Stage, _chance: random.Random, fault: str) -> Sequence[Trial]:
    """Take a resource away while both robots move, stop everything, and give it back."""
    if fault == "space" and stage.shared:
        return [Trial(FAULTS[fault], False, skipped=stage.shared)]
    await stage.furnish()
    calls = await stage.both_move()
    trial = Trial(FAULTS[fault], False)
    with _FAULTS[fault](stage):
        await asyncio.sleep(1.0)
        began = time.monotonic()
        verb = await stage.verb("stop", "--json")
        trial.reached = await holds(lambda: stage.arm.stopped and stage.rover.stopped, 10.0)
        trial.seconds = time.monotonic() - began
        said = await verb.end()
        trial.note = "" if trial.reached else str(said)
        trial.false = _false(said, stage)
        if fault == "space":
            trial.false += await _joined_elsewhere(stage)
    for call in calls:
        if (ended := await call.end()).code is None:
            trial.false.append(f"`{ended.words[1]}` did not end with the stop")
    if not await stage.whole():
        trial.reached, trial.note = False, "the realm is not whole 10 s later"
    return [trial]


def _false(said: Said, stage: Stage) -> list[str]:
    if said.done and not (stage.arm.stopped and stage.rover.stopped):
        return [f"{said}; but one of them is not stopped"]
    if said.done and not names(said) >= ALL:
        return [f"{said}; it claims success and leaves out {ALL - names(said)}"]
    return []


async def _joined_elsewhere(stage: Stage) -> list[str]:
    """Check that a newcomer that cannot enter the realm says why, and enters no other one."""
    fill(stage.folder.parent.parent)  # a process that gave up a list has freed a page
    newcomer = await stage.verb("lookup", "lookup-3")
    said = await newcomer.end(5.0)
    if said.code is None or said.done or "No space left on device" not in said.complaints:
        return [f"{said}; though its realm's folder is full"]
    left = [path.name for path in stage.folder.iterdir() if f"{newcomer.pid}-" in path.name]
    return [f"{said}; it left {left}"] if left else []


@contextlib.contextmanager
def _limited(pids: Sequence[int], what: int, limit: Callable[[int], int]) -> Generator[None]:
    """Limit a resource of processes, and give it back."""
    before = {pid: resource.prlimit(pid, what) for pid in pids}
    for pid, (_, hard) in before.items():
        resource.prlimit(pid, what, (limit(pid), hard))
    try:
        yield
    finally:
        for pid, limits in before.items():
            resource.prlimit(pid, what, limits)


def _everybody(stage: Stage) -> list[int]:
    return [stage.pid(name) for name in stage.members]


def _disk(stage: Stage) -> contextlib.AbstractContextManager[None]:
    return _limited(_everybody(stage), resource.RLIMIT_FSIZE, lambda _: 0)


@contextlib.contextmanager
def _space(_: Stage) -> Generator[None]:
    files = [fill(Path(os.environ[name])) for name in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME")]
    try:
        yield
    finally:
        for file in files:
            file.unlink()


def _descriptors(stage: Stage) -> contextlib.AbstractContextManager[None]:
    def highest(pid: int) -> int:
        return 1 + max(int(one.name) for one in Path(f"/proc/{pid}/fd").iterdir())

    return _limited(_everybody(stage), resource.RLIMIT_NOFILE, highest)


def _memory(stage: Stage) -> contextlib.AbstractContextManager[None]:
    def mapped(pid: int) -> int:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[0])
        return pages * resource.getpagesize() + ROOM

    agents = [stage.pid(name) for name in ("host", "arm proxy", "rover proxy")]
    return _limited(agents, resource.RLIMIT_AS, mapped)


@contextlib.contextmanager
def _files(stage: Stage) -> Generator[None]:
    for path in stage.folder.glob(f"{stage.pid('host')}-*"):
        if path.suffix in {".beat", ".held"}:
            path.write_bytes(b"\xff\x00\n-\n" * 7)
    yield


@contextlib.contextmanager
def _load(_: Stage) -> Generator[None]:
    line = f"import time; end = time.monotonic() + {LONGEST}\nwhile time.monotonic() < end: pass"
    busy = [subprocess.Popen([sys.executable, "-S", "-c", line]) for _ in range(HOARD)]
    try:
        yield
    finally:
        for one in busy:
            one.kill()
        for one in busy:
            one.wait()


_FAULTS: dict[str, Callable[[Stage], contextlib.AbstractContextManager[None]]] = {
    "disk": _disk,
    "space": _space,
    "descriptors": _descriptors,
    "memory": _memory,
    "files": _files,
    "load": _load,
}


async def hold(stage: Stage, _chance: random.Random, letters: int, kill: bool) -> Sequence[Trial]:  # noqa: FBT001 # one of two
    """Hold the interpreter of the host while its robot drives a rover; let it go, or end the host."""
    page = stage.folder / "greedy.py"
    page.write_text(PAGE)
    await stage.furnish()
    with contextlib.suppress(NoSuchRobot):  # of a trial that was broken off
        await stage.realm_client.delete("greedy")
    await stage.realm_client.create(str(page), "greedy")
    square = await stage.verb("call", f"{SQUARE}.move", "x=1.2", "y=0", "--within", "20 s")
    moved = await stage.rover.moves()
    pid = stage.pid("host")
    (beat,) = stage.folder.glob(f"{pid}-*.beat")
    greedy = await stage.verb("call", "greedy.hold", f"letters={letters}", "--within", "50 s")
    last, mark = beat.read_bytes(), stage.rover.mark()
    while time.monotonic() - mark[0] < 1.2:  # until two beats are missing
        if (sign := beat.read_bytes()) != last:
            last, mark = sign, stage.rover.mark()
        await asyncio.sleep(0.02)
    standing = Trial(HELD, moved and await stage.rover.stands(10.0), note="" if moved else "it did not move")
    standing.seconds = stage.rover.stood_after(mark)
    trials = [standing, await _end(stage, pid) if kill else await _return(stage)]
    for call in (square, greedy):
        said = await call.end()
        if call is square and not moved:
            standing.note = f"it did not move: {said}"
        elif call is square and said.done:
            standing.false.append(f"{said}; but its host was held in the middle")
    if not kill:
        await stage.realm_client.delete("greedy")
    if not await stage.whole():
        trials[-1].reached, trials[-1].note = False, "the realm is not whole 10 s later"
    return trials


async def _end(stage: Stage, pid: int) -> Trial:
    began = time.monotonic()
    handle = os.pidfd_open(pid)
    try:
        os.kill(pid, signal.SIGTERM)
        over = asyncio.Event()
        asyncio.get_running_loop().add_reader(handle, over.set)
        ended = Trial(ENDED, await holds(over.is_set, 15.0), time.monotonic() - began)
        asyncio.get_running_loop().remove_reader(handle)
    finally:
        os.close(handle)
    ended.note = "" if ended.reached else "it runs 15 s after SIGTERM"
    await stage.kill("host")
    await stage.restart("host")
    return ended


async def _return(stage: Stage) -> Trial:
    began = time.monotonic()
    trial = Trial(RETURNED, False, note="the slot is empty")
    while not trial.reached and time.monotonic() - began < 25.0:
        found = {one.name: one for one in await stage.realm_client.tree()}
        trial.reached = SQUARE in found and any(slot.child for slot in found[SQUARE].slots)
        await asyncio.sleep(0.05)
    trial.seconds, trial.note = time.monotonic() - began, "" if trial.reached else trial.note
    return trial
