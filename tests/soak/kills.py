"""`kill -9` in the middle of commands: of proxies, hosts, controllers, lookup services and callers."""

from __future__ import annotations

import asyncio
import math
import os
import random
import signal
from collections.abc import Sequence

from tests.soak.observer import holds
from tests.soak.stage import Said, Stage
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
