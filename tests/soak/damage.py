"""Files that are damaged while robots use them: a controller's fence, the key of a link, a robot's page."""

from __future__ import annotations

import asyncio
import contextlib
import json
import random
import time
from collections.abc import Sequence
from pathlib import Path

from robotree.protocol.links.keyring import create
from robotree.tui.errors import MemberFailed
from robotree.vr.base.errors import VrError
from robotree.vr.network.realms import keys_of, sealed
from tests.soak.stage import Stage, holds, names, suspended
from tests.soak.table import Row, Trial

FENCE = Row(
    "damage",
    "a bit of one copy of a fence file is flipped, the controller restarted: it tells, and keeps the epoch",
    "from the restarted controller being ready until its proxy can command it",
    3.0,
)
FENCES = Row(
    "damage",
    "a bit of both copies is flipped: the controller names both and does not start without `--reset-epoch`",
    "",
)
KEY = Row(
    "damage",
    "the key file of a moving signed arm is garbage, then `stop`",
    "from the start of the command line until the arm stands",
    1.5,
)
KEYS = Row(
    "damage",
    "that arm's controller, restarted: it names the key file and does not start; with the old key it does",
    "from the restarted controller being ready until its proxy can command it",
    3.0,
)
PAGE = Row(
    "damage",
    "the page of a robot is garbage: `reload` is refused with file and line, the robot goes on",
    "from the start of `reload` with the mended page to its end",
    2.0,
)
LIST = Row(
    "damage",
    "the list of robots of a frozen host is garbage or cut, then `stop`: it does not claim they stopped",
    "from SIGCONT until the list is right again",
    1.0,
)
BACK = 5.0
"""[s] in which a proxy finds a restarted controller."""
NAME = "arm-damaged"
ARM = f"{NAME} controller"
CHECKED = 17
"""Characters of a fence file before its content: a checksum and a space."""
STEADY = '''"""Steady: says which edition it is."""
from robotree.vr import VirtualRobot, command

class Steady(VirtualRobot):
    """Says a number."""

    @command
    def edition(self) -> int:
        """Return the number of this edition."""
        return {}
'''


async def _online(stage: Stage) -> None:
    """Wait until that arm's proxy has found its controller."""
    until = time.monotonic() + BACK
    while time.monotonic() < until:
        with contextlib.suppress(VrError):
            if (await stage.realm_client.describe(NAME)).online:
                return
        await asyncio.sleep(0.02)


async def _moved(stage: Stage, y: float) -> str:
    """Move that arm; returns why it did not come there, empty if it did."""
    said = await stage.send(NAME, y)
    return "" if said.done else str(said)


async def _refuses(stage: Stage, *wanted: str) -> str:
    """Restart that arm's controller; returns what is wrong if it comes up, or does not say why not."""
    try:
        await stage.restart(ARM)
    except MemberFailed as error:
        missing = [word for word in wanted if word not in str(error)]
        return f"it does not say {missing}: {error}" if missing else ""
    return "it started as if nothing was wrong"


def flip(path: Path, chance: random.Random) -> None:
    """Change one bit of a file."""
    data = bytearray(path.read_bytes())
    data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


def _epochs(copies: Sequence[Path]) -> list[int]:
    return [json.loads(path.read_bytes()[CHECKED:])["epoch"] for path in copies]


async def fence(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Flip a bit of one copy of a fence file, then of both, each time while the controller is down."""
    file = stage.folder.parent.parent / "damaged.json"
    copies = (file, file.with_name(f"{file.name}.copy"))
    one, both = Trial(FENCE, False), Trial(FENCES, False)
    await stage.furnish()
    async with stage.another_arm(NAME, "--state", str(file)):
        one.note = await _moved(stage, 0.1)
        known = max(_epochs(copies))
        await stage.kill(ARM)
        hit = chance.choice(copies)
        flip(hit, chance)
        ready = await stage.restart(ARM)
        if str(hit) not in (told := stage.members[ARM].log):
            one.false.append(f"the controller says nothing of {hit.name}: {told!r}")
        if not known or min(_epochs(copies)) < known:
            one.false.append(f"its epochs were {known} and are {_epochs(copies)}")
        await _online(stage)
        one.seconds = time.monotonic() - ready
        one.note = one.note or await _moved(stage, -0.1)
        one.reached = not one.note
        await stage.kill(ARM)
        for path in copies:
            flip(path, chance)
        both.note = await _refuses(stage, *(str(path) for path in copies), "--reset-epoch")
        if not both.note:
            line = stage.line_of(ARM)
            await stage.start(ARM, *line[:2], "--reset-epoch", *line[2:])
            await _online(stage)
            both.note = await _moved(stage, 0.1)
        both.reached = not both.note
    for path in file.parent.glob("*damaged.json*"):
        path.unlink()
    return [one, both]


async def key(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Write garbage over the key of an arm that moves; stop it, restart its controller, mend the key."""
    file = stage.folder.parent.parent / "damaged.key"
    create(file)
    good = file.read_bytes()
    stopping, keeping = Trial(KEY, False), Trial(KEYS, False)
    await stage.furnish()
    async with stage.another_arm(NAME, key=("--key", str(file))) as arm:
        away = await stage.verb("call", f"{NAME}.go_to", "x=0.45", "y=0.2", "z=0.35", "twist=0", "speed=0.15")
        moved = await arm.moves()
        file.write_bytes(chance.randbytes(len(good)))
        verb = await stage.verb("stop", "--json")
        mark = arm.mark()
        said = await verb.end()
        stopping.reached = moved and said.done and NAME in names(said) and await arm.stands(5.0)
        stopping.seconds = arm.stood_at(mark) - verb.began
        stopping.note = "" if stopping.reached else f"moved: {moved}; {said}"
        await away.end()
        await stage.kill(ARM)
        keeping.note = await _refuses(stage, str(file))
        file.write_bytes(good)
        if not keeping.note:
            ready = await stage.restart(ARM)
            await _online(stage)
            keeping.seconds = time.monotonic() - ready
            await stage.realm_client.resume(None)
            keeping.note = await _moved(stage, -0.1)
        keeping.reached = not keeping.note
    for path in file.parent.glob("damaged.key*"):
        path.unlink()
    return [stopping, keeping]


async def page(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Write garbage over the page of a robot and reload it; then mend it, changed, and reload it again."""
    file = stage.folder.parent.parent / "steady.py"
    file.write_text(STEADY.format(1))
    await stage.furnish()
    await stage.realm_client.create(str(file), "steady")
    cut = STEADY.format(2).encode()[: -chance.randrange(25, 50)]  # in the middle of the last docstring
    garbage = (chance.randbytes(200), b"def broken(:\n", b"", cut)
    trial = Trial(PAGE, True)
    for data in garbage:
        file.write_bytes(data)
        said = await stage.say("reload", "steady")
        if said.done or file.name not in said.complaints:
            trial.false.append(f"of {data[-20:]!r}: {said}")
        if (answer := await stage.realm_client.call("steady", "edition", {})) != 1:
            trial.false.append(f"it goes on with {answer!r}")
    file.write_text(STEADY.format(3))
    said = await stage.say("reload", "steady")
    trial.seconds, trial.reached = said.seconds, said.done
    trial.note = "" if said.done else str(said)
    if said.done and await stage.realm_client.call("steady", "edition", {}) != 3:
        trial.false.append(f"{said}; but the old page goes on")
    await stage.realm_client.delete("steady")
    file.unlink()
    return [trial]


def _damaged(written: bytes, chance: random.Random) -> Sequence[bytes]:
    """Return what can become of a list of robots: garbage, wrong lines, and each way to be cut."""
    lines = written.splitlines(keepends=True)
    shorter = b"".join(lines[:-1])
    garbage = (chance.randbytes(40) + b"\n", sealed(b"-robot/x/1\n"), sealed(b"robot/\x01/1\n"))
    return (*garbage, b"", written[:12], written[:40], shorter, shorter + lines[-1][: len(lines[-1]) // 2])


async def robots(stage: Stage, chance: random.Random) -> Sequence[Trial]:
    """Freeze the host and damage or cut its list of robots; stop everything, and wake it."""
    await stage.furnish()
    pid = stage.pid("host")
    (path,) = stage.folder.glob(f"{pid}-*.held")
    good, trial = keys_of(stage.folder, path.stem), Trial(LIST, False)
    with suspended(pid):
        path.write_bytes(chance.choice(_damaged(path.read_bytes(), chance)))
        said = await stage.say("stop", "--json")
        if said.done or str(pid) not in said.out + said.complaints:
            trial.false.append(f"{said}; but process {pid} was frozen")
    woke = time.monotonic()
    trial.reached = await holds(lambda: keys_of(stage.folder, path.stem) == good, 5.0)
    trial.seconds = time.monotonic() - woke
    trial.note = "" if trial.reached else f"it is {path.read_bytes()!r} instead of {good}"
    await stage.expect_whole(trial)
    return [trial]
