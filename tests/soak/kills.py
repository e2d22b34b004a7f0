"""`kill -9` in the middle of commands: of proxies, hosts, controllers, lookup services and callers.

Also deaths that are noticed late: a process that is frozen while others end reads their ends with the rest;
and those of pages and proxies that have forked: a child that lives on must not hide the death of its process.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import random
import signal
import time
from collections.abc import Sequence
from pathlib import Path

from tests.soak.stage import ARM, LONGEST_CALL, REACH, Observer, Said, Stage, holds, suspended
from tests.soak.table import Row, Trial

THERE = 0.03
"""[m] A robot that is closer than this to its goal has reached it."""
SETTLED = 3.0
"""[s] within which a robot must stand after its call has failed."""
STANDING = "from the kill until the robot stands, on the controller's clock"
HEALED = "from the restarted process being ready until all see each other"
VICTIMS = {
    "arm proxy": Row("kill", "proxy of a moving arm", STANDING, 0.15),
    "rover proxy": Row("kill", "proxy of a moving rover", STANDING, 0.3),
    "host": Row("kill", "host of the robot that commands a rover", STANDING, 1.0),
    "arm caller": Row("kill", "command line that moves an arm", STANDING, 1.0),
    "square caller": Row("kill", "command line that calls a virtual robot", STANDING, 1.0),
    "arm controller": Row("kill", "controller of a moving arm", HEALED, 3.0),
    "rover controller": Row("kill", "controller of a moving rover", HEALED, 3.0),
    "lookup-1": Row("kill", "lookup service", HEALED, 3.0),
}
BACK = Row("kill", "restart of any process above", HEALED, 3.0)
INVOLVED = {
    "arm": {"arm proxy", "arm caller", "arm controller"},
    "rover": {"rover proxy", "host", "square caller", "rover controller"},
}
"""Processes whose death may end a call of each robot; the death of any other one must not."""


async def kill(stage: Stage, chance: random.Random, victim: str) -> Sequence[Trial]:
    """Kill one process while an arm moves and a virtual robot drives a rover."""
    await stage.furnish()
    arm_mark, rover_mark = stage.arm.mark(), stage.rover.mark()
    (arm_call, arm_goal), (square_call, home) = await asyncio.gather(stage.move_arm(), stage.move_square())
    if not (await stage.arm.moves() and await stage.rover.moves()):
        said = await asyncio.gather(arm_call.end(), square_call.end())
        return [Trial(VICTIMS[victim], False, note=f"nothing moved: {'; '.join(map(str, said))}")]
    await asyncio.sleep(chance.uniform(0.0, 1.5))

    watched = stage.rover if victim in INVOLVED["rover"] else stage.arm
    mark = watched.mark()
    if victim.endswith("caller"):
        os.kill((arm_call if victim.startswith("arm") else square_call).pid, signal.SIGKILL)
    else:
        await stage.kill(victim)
    trial = Trial(VICTIMS[victim], True)
    if trial.row.measured == STANDING:
        trial.reached = await watched.stands(5.0)
        trial.seconds = watched.stood_after(mark)
        trial.note = "" if trial.reached else "it still moves after 5 s"
    arm_said, square_said = await asyncio.gather(arm_call.end(), square_call.end())
    if victim not in {"arm controller", "arm caller"}:
        trial.false += await lies(
            arm_said, stage, "arm", arm_goal, arm_mark, must=victim not in INVOLVED["arm"]
        )
    if victim not in {"rover controller", "square caller"}:
        trial.false += await lies(
            square_said, stage, "rover", home, rover_mark, must=victim not in INVOLVED["rover"]
        )
    trials = [trial]
    if not victim.endswith("caller"):
        ready = await stage.restart(victim)
        back = Trial(BACK, await stage.whole())
        back.seconds = asyncio.get_running_loop().time() - ready
        back.note = "" if back.reached else f"the realm is not whole after the {victim} was restarted"
        if trial.row.measured == HEALED:
            trial.seconds, trial.reached, trial.note = back.seconds, back.reached, back.note
        else:
            trials.append(back)
    return trials


async def lies(
    said: Said,
    stage: Stage,
    robot: str,
    goal: tuple[float, float, float],
    mark: tuple[float, float],
    *,
    must: bool,
) -> list[str]:
    """Compare what a call reported with what its robot did.

    Args:
        said: by the command line in the end.
        stage: on which the robot is watched.
        robot: `arm` or `rover`.
        goal: (3,) [m] where it should be after a success.
        mark: when the call began.
        must: no process that the call needs was killed, so it has to succeed.

    Returns:
        What was not true, or was not kept.
    """
    watched = stage.arm if robot == "arm" else stage.rover
    if said.code is None:
        return [f"`{' '.join(said.words)}` never ended"]
    off = math.dist(watched.place[:2], goal[:2])
    if said.done:
        if off > THERE:
            return [f"{said}; but the {robot} is {off:.3f} m from where that ends"]
        if robot == "rover" and watched.way_since(mark) < 0.8:
            return [f"{said}; but the rover has gone {watched.way_since(mark):.2f} m only"]
        return []
    found = [f"{said}; though no process that it needs was killed"] if must else []
    if not await holds(lambda: watched.fresh and watched.speed() < 0.01, SETTLED):
        found.append(f"{said}; but the {robot} still moves {SETTLED:g} s later")
    return found


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
    with suspended(witnessing):
        call, _ = await stage.move_arm()
        moved = await stage.arm.moves()
        await stage.kill("arm proxy")
        await call.end()
    woke, left = time.monotonic(), before - OF_ANOTHER
    forgot = await holds(lambda: descriptors(witnessing) <= left, 5.0)
    trial = Trial(MISSED, known and moved and forgot, time.monotonic() - woke)
    if not forgot:
        trial.note = f"the {witness} has {descriptors(witnessing)} descriptors instead of {left}"
    await stage.restart("arm proxy")
    await stage.expect_whole(trial)
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


WAYS = ("nothing", "fork", "multiprocessing", "preexec")
"""How a child is made that lives on when its process is killed."""
HOST = Row("fork", "host that keeps nothing, of a forked page that moves an arm, is killed", STANDING, 0.3)
PROXY = Row("fork", "an author's own proxy that has forked and moves an arm is killed", STANDING, 0.3)
WAY = 0.02
"""[m] that the arm may go on; measured without a child: 0.004."""
SPEED = 0.2
"""[m/s]"""
OWN = "own-arm"
FORGETFUL = "forgetful host"
"""Name of the member of the stage."""
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
    """Kill a host while a page of it, which has left a child behind, moves an arm.

    The host keeps nothing, so nobody waits for its robots. Of one that does, the arm would end its step.
    """
    await stage.furnish()
    await stage.start(FORGETFUL, "host", "host-2", "--forget")
    page = stage.folder.parent.parent / "carrier.py"
    await asyncio.to_thread(page.write_text, PAGE)
    await stage.realm_client.create(str(page), "carrier", host="host-2")
    await stage.realm_client.enslave("carrier", "arm", ARM)
    trial = await _killed(stage, chance, HOST, ("carrier.carry", way), stage.arm, FORGETFUL)
    await stage.expect_whole(trial)
    return [trial]


async def proxy_dies(stage: Stage, chance: random.Random, way: str) -> Sequence[Trial]:
    """Kill an arm's proxy, of a class of its author, which has left a child behind and moves."""
    kind = stage.folder.parent.parent / "forking_arm.py"
    await asyncio.to_thread(kind.write_text, KIND)
    async with stage.another_arm(OWN, kind=str(kind)) as arm:
        return [await _killed(stage, chance, PROXY, (f"{OWN}.carry", way), arm, f"{OWN} proxy")]


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
