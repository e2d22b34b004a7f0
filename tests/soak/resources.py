"""Resources that run out, an interpreter that is held, memory that grows, and a rule that asks for too much.

The rule of a script could be met in billions of ways: the script ends, a stop reaches all, memory is bounded.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import random
import re
import resource
import signal
import time
from collections.abc import AsyncIterator, Callable, Generator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from robotree.vr.base.errors import VrError
from robotree.vr.lookup.table import MOST_REMEMBERED
from tests.apart import fill
from tests.soak.stage import ROOT, ROVER, SQUARE, Said, Stage, Verb, holds, names
from tests.soak.stops import ALL, STAND, busy, false_reports, marks_of, still_moving, stood
from tests.soak.table import Row, Trial

HOARD = 20
"""Busy loops beside the realm."""
ROOM = 1 << 20
"""[bytes] of memory that a process may still map."""
HELD = Row(
    "held",
    "a page holds the interpreter of a host that keeps nothing; its robot commands a rover",
    "from the last sign of life of the host until the rover stands",
    3.0,
)
ENDED = Row("held", "`kill PID` of that host", "from the signal until the process has ended", 4.0)
RETURNED = Row("held", "a held interpreter is free again", "until its robot has the rover again", 10.0)
FORGETFUL, DRIVER = "forgetful host", "driver"
"""The member of the stage whose interpreter is held, and its robot that drives."""
PAGE = '''
"""Greedy: holds the interpreter."""
import re
from robotree.vr import VirtualRobot, command

class Greedy(VirtualRobot):
    """Computes in C."""

    @command
    def hold(self, letters: int) -> None:
        """Match for long: 2.5 to 5 s with 26 letters, twice as long for each more."""
        re.match(r"(a+)+$", "a" * letters + "b")
'''


async def exhaust(stage: Stage, _chance: random.Random, fault: str) -> Sequence[Trial]:
    """Take a resource away while both robots move, stop everything, and give it back."""
    words, bar, taken_away = FAULTS[fault]
    trial = Trial(Row("resource", f"{words}, then `stop`", STAND, bar), False)
    if fault == "space" and stage.shared:
        trial.skipped = stage.shared
        return [trial]
    await stage.furnish()
    calls = await stage.both_move()
    with taken_away(stage):
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
    await stage.expect_whole(trial)
    return [trial]


def _false(said: Said, stage: Stage) -> list[str]:
    if said.done and (missing := ALL - names(said)):
        return [*false_reports(said, stage), f"{said}; it claims success and leaves out {missing}"]
    return false_reports(said, stage)


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


FAULTS: dict[str, tuple[str, float, Callable[[Stage], contextlib.AbstractContextManager[None]]]] = {
    "disk": (
        "no process can write a file",
        2.0,
        lambda stage: _limited(_everybody(stage), resource.RLIMIT_FSIZE, lambda _: 0),
    ),
    "space": ("the file systems of realm and state are full", 2.0, _space),
    "descriptors": ("no process can open a descriptor", 2.0, _descriptors),
    "memory": ("host and proxies can map 1 MB more", 2.0, _memory),
    "files": ("garbage in the host's beat and list", 2.0, _files),
    "load": (f"{HOARD} busy loops beside the realm", 1.0, lambda _: busy(HOARD)),
}
"""What is taken away in words, the bar of a stop meanwhile [s], and how it is taken away inside a block."""


async def hold(stage: Stage, _chance: random.Random, letters: int, kill: bool) -> Sequence[Trial]:  # noqa: FBT001 # one of two
    """Hold the interpreter of a host while its robot drives a rover; let it go, or end the host.

    The host keeps nothing: a rover would wait for one that does, and end its step.
    """
    page = stage.folder / "greedy.py"
    page.write_text(PAGE)
    await stage.furnish()
    client = stage.realm_client
    await stage.start(FORGETFUL, "host", "host-2", "--forget")
    await client.create(str(page), "greedy", host="host-2")
    await client.create(str(ROOT / "examples" / "move_square.py"), DRIVER, host="host-2")
    await client.release(SQUARE, "rover")
    await client.enslave(DRIVER, "rover", ROVER)
    x = -1.2 if stage.rover.place[0] > 0 else 1.2
    drive = await stage.verb("call", f"{DRIVER}.move", f"x={x}", "y=0", "speed=0.15", "--within", "30 s")
    moved = await stage.rover.moves()
    pid = stage.pid(FORGETFUL)
    (beat,) = stage.folder.glob(f"{pid}-*.beat")
    greedy = await stage.verb("call", "greedy.hold", f"letters={letters}", "--within", "50 s")
    last, mark = beat.read_bytes(), stage.rover.mark()
    while time.monotonic() - mark[0] < 1.2:  # until two beats are missing
        if (sign := beat.read_bytes()) != last:
            last, mark = sign, stage.rover.mark()
        await asyncio.sleep(0.02)
    standing = Trial(HELD, moved and await stage.rover.stands(10.0), note="" if moved else "it did not move")
    standing.seconds = stage.rover.stood_after(mark)
    trials = [standing, await _end(pid) if kill else await _return(stage)]
    for call in (drive, greedy):
        said = await call.end()
        if call is drive and not moved:
            standing.note = f"it did not move: {said}"
        elif call is drive and said.done:
            standing.false.append(f"{said}; but its host was held in the middle")
    await stage.kill(FORGETFUL)
    await stage.expect_whole(trials[-1])
    return trials


async def _end(pid: int) -> Trial:
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
    return ended


async def _return(stage: Stage) -> Trial:
    began = time.monotonic()
    trial = Trial(RETURNED, False, note="the slot is empty")
    while not trial.reached and time.monotonic() - began < 25.0:
        found = {one.name: one for one in await stage.realm_client.tree()}
        trial.reached = DRIVER in found and any(slot.child for slot in found[DRIVER].slots)
        await asyncio.sleep(0.05)
    trial.seconds, trial.note = time.monotonic() - began, "" if trial.reached else trial.note
    return trial


BEFORE = 2 * MOST_REMEMBERED
"""Lives until all that is bounded has as much as it ever has: tables grow once more after they are full."""
LIVES = 4000
"""Lives that are measured."""
LONGEST_LIVES = 400.0
"""[s] for all of them, on a busy machine."""
AT_ONCE = 8
EACH = 200
"""[bytes] that a process may grow for each life that is measured: what the allocator needs varies by 100."""
MAYFLY = '''
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
    page.write_text(MAYFLY)
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


CROWD = "crowd"
MOST_MEMORY = 100
"""[MB] that the host may take for it: 64 for facts, 16 while the script is being ended, and its run."""
IDLE = 0.5
"""[s] of processor time that the host may take in the second after that."""
CROWD_SCRIPT = """\
script: crowd
facts: {place: {id: none}}
hears: {look: {}}
begin with:
BEGIN
rules:
  - rule: pairs
    when:
      - look
      - place: {id: $a}
      - place: {id: $b}
      - place: {id: $c}
      - place: {id: $d}
    then:
      - log: $a $b $c $d
"""
CROWD_ENDS = Row(
    "script",
    "a rule with four conditions over 200 facts: the script ends with a sentence",
    "from the happening until the command line reports it",
    3.0,
)
CROWD_STOPPED = Row("script", "`stop` while such a rule is compared, two robots moving", STAND, 1.5)


async def crowd_ends(stage: Stage, _chance: random.Random) -> Sequence[Trial]:
    """Report the happening that such a rule waits for."""
    await stage.furnish()
    async with _led(stage) as (running, host):
        began = asyncio.get_running_loop().time()
        await stage.realm_client.call(CROWD, "look", {})
        said = await running.end()
        seconds = asyncio.get_running_loop().time() - began
        trial = Trial(
            CROWD_ENDS, "rule pairs" in said.complaints and "too many ways" in said.complaints, seconds
        )
        trial.note = "" if trial.reached else str(said)
        trial.false = await host.excesses()
    return [trial]


async def crowd_stopped(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Stop everything while it compares, with a new command line."""
    await stage.furnish()
    async with _led(stage) as (running, host):
        calls = await stage.both_move()
        verb, marks = await stage.verb("stop", "--json"), marks_of(stage)
        await asyncio.sleep(chance.uniform(0.0, 0.3))
        with contextlib.suppress(VrError):  # the stop was quicker
            await stage.realm_client.call(CROWD, "look", {})
        said = await verb.end()
        trial = Trial(CROWD_STOPPED, said.done and names(said) >= ALL, stood(marks) - verb.began)
        trial.note = "" if trial.reached else str(said)
        trial.false = false_reports(said, stage) + await still_moving(stage, calls)
        trial.false += await host.excesses()
        if (await running.end(5.0)).code is None:
            trial.false.append("the script leads on")
    return [trial]


class _Host:
    """The process in which the script runs, as the kernel sees it."""

    def __init__(self, pid: int) -> None:
        self._folder = Path(f"/proc/{pid}")
        (self._folder / "clear_refs").write_text("5")  # from now on VmHWM is the most of this trial
        self._before = self._memory("VmRSS")

    async def excesses(self) -> list[str]:
        """Name what it has taken too much of, and whether it still computes."""
        grown = (self._memory("VmHWM") - self._before) / 1000
        found = [f"the host took {grown:.0f} MB"] if grown > MOST_MEMORY else []
        before = self._spent()
        await asyncio.sleep(1.0)
        spent = self._spent() - before
        return found + ([f"the host still computes: {spent:.2f} s in one second"] if spent > IDLE else [])

    def _memory(self, name: str) -> int:
        """Return a size of the process [kB]."""
        lines = (self._folder / "status").read_text().splitlines()
        return int(next(line for line in lines if line.startswith(name)).split()[1])

    def _spent(self) -> float:
        """Return its processor time [s]."""
        user, system = (self._folder / "stat").read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


@asynccontextmanager
async def _led(stage: Stage) -> AsyncIterator[tuple[Verb, _Host]]:
    """Have the script lead nobody. Yields: the command line that started it, and its host."""
    page = stage.folder.parent.parent / "crowd.yaml"
    page.write_text(CROWD_SCRIPT.replace("BEGIN", "\n".join(f"  - place: {{id: p{n}}}" for n in range(200))))
    await stage.realm_client.create(str(page), CROWD)
    try:
        running = await stage.verb("call", f"{CROWD}.start", "--within", "30 s")
        async with asyncio.timeout(10.0):
            while (await stage.realm_client.describe(CROWD)).attributes["condition"] != "active":  # noqa: ASYNC110 # another process
                await asyncio.sleep(0.05)
        yield running, _Host(stage.pid("host"))
    finally:
        await stage.realm_client.delete(CROWD)
