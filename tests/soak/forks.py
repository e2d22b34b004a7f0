"""Pages and proxies that fork: a child that lives on must not hide the death of its process."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager

from tests.soak.observer import Observer
from tests.soak.stage import ARM, LONGEST_CALL, REACH, Stage
from tests.soak.table import Row, Trial

WAYS = ("nothing", "fork", "multiprocessing", "preexec")
"""How a child is made that lives on when its process is killed."""
STANDING = "from the kill until the arm stands, on the controller's clock"
HOST = Row("fork", "host of a page that has forked and moves an arm at 0.2 m/s is killed", STANDING, 0.3)
PROXY = Row("fork", "an author's own proxy that has forked and moves an arm is killed", STANDING, 0.3)
WAY = 0.02
"""[m] that the arm may go on; measured without a child: 0.004."""
SPEED = 0.2
"""[m/s]"""
OWN = "own-arm"
CHILD = """
import multiprocessing, os, subprocess, time

LIVES = 15.0

def leave_a_child(way):
    if way == "fork":
        if os.fork() == 0:
            time.sleep(LIVES)
            os._exit(0)
    elif way == "multiprocessing":
        multiprocessing.get_context("fork").Process(target=time.sleep, args=(LIVES,)).start()
    elif way == "preexec":
        subprocess.Popen(["sleep", str(LIVES)], preexec_fn=int, close_fds=False)
"""
PAGE = f'''"""Carrier: leaves a child behind and moves its arm."""
{CHILD}
from robotree.vr import Child, VirtualRobot, command

class Carrier(VirtualRobot):
    """Moves an arm."""

    arm = Child("Arm")

    @command
    def carry(self, way: str, y: float) -> None:
        """Leave a child behind, then move the arm."""
        leave_a_child(way)
        self.arm.go_to(x=0.45, y=y, z=0.35, twist=0.0, speed={SPEED})
'''
KIND = f'''"""An arm whose proxy leaves a child behind."""
{CHILD}
from robotree.proxy.arm import Arm, GoTo
from robotree.vr import command

class ForkingArm(Arm):
    """An arm."""

    @command
    def carry(self, way: str, y: float) -> None:
        """Leave a child behind, then move."""
        leave_a_child(way)
        self.carry_out(GoTo(x=0.45, y=y, z=0.35, twist=0.0, speed={SPEED}))
'''


async def host_dies(stage: Stage, chance: random.Random, way: str) -> Sequence[Trial]:
    """Kill a host while a page of it, which has left a child behind, moves an arm."""
    await stage.furnish()
    page = stage.folder.parent.parent / "carrier.py"
    await asyncio.to_thread(page.write_text, PAGE)
    await stage.realm_client.create(str(page), "carrier")
    await stage.realm_client.enslave("carrier", "arm", ARM)
    trial = await _killed(stage, chance, HOST, ("carrier.carry", way), stage.arm, "host")
    await stage.restart("host")
    if not await stage.whole():
        trial.reached, trial.note = False, "the realm is not whole after the host was restarted"
    return [trial]


async def proxy_dies(stage: Stage, chance: random.Random, way: str) -> Sequence[Trial]:
    """Kill an arm's proxy, of a class of its author, which has left a child behind and moves."""
    kind = stage.folder.parent.parent / "forking_arm.py"
    await asyncio.to_thread(kind.write_text, KIND)
    async with another_arm(stage, str(kind)) as arm:
        return [await _killed(stage, chance, PROXY, (f"{OWN}.carry", way), arm, "own proxy")]


@asynccontextmanager
async def another_arm(stage: Stage, kind: str) -> AsyncIterator[Observer]:
    """One more arm, with a proxy of this kind."""
    controller = await stage.start("own arm", "sim", "arm", "--listen", "tcp:127.0.0.1:0")
    try:
        await stage.start("own proxy", "proxy", kind, OWN, "--connect", controller.address)
        async with Observer(controller.address) as arm:
            yield arm
    finally:
        for name in ("own proxy", "own arm"):
            if name in stage.members:
                await stage.kill(name)


async def _killed(
    stage: Stage, chance: random.Random, row: Row, line: tuple[str, str], arm: Observer, victim: str
) -> Trial:
    """Have an arm moved and kill who moves it; returns when it stood, and if it went too far."""
    command, way = line
    y = -REACH if arm.place[1] > 0 else REACH
    call = await stage.verb("call", command, f"way={way}", f"y={y}", "--within", f"{LONGEST_CALL:g} s")
    if not await arm.moves():
        return Trial(row, False, note=f"nothing moved: {await call.end(1.0)}")
    await asyncio.sleep(chance.uniform(0.3, 0.8))
    mark = arm.mark()
    await stage.kill(victim)
    trial = Trial(row, await arm.stands(5.0), arm.stood_after(mark))
    gone = arm.way_since(mark)
    if not trial.reached or gone > WAY:
        trial.reached, trial.note = False, f"after {way} it went on for {gone:.3f} m"
    await call.end()
    return trial
