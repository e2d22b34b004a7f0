"""Random reaches of both arms: the body never touches itself, judged by the other engine than the planner's.

The planner asks Pinocchio's geometry; here MuJoCo measures what was really carried out, every 20 ms.
"""

from __future__ import annotations

import itertools
import random

import pytest

from robotree.protocol.messages import GoalState, Reason, Verb
from robotree.sim.companion.figure import SIDES
from robotree.sim.companion.flat import PREFIX
from robotree.sim.companion.guard import BODY, LIMB, NEIGHBOURS
from robotree.sim.companion.tuning import FORCE_LIMIT
from robotree.sim.physics.engine import mujoco
from robotree.sim.testing import NAN, CompanionBench, Operator

ALLOWED = {Reason.OUT_OF_REACH, Reason.SELF_COLLISION, Reason.PATH_BLOCKED, Reason.TIP_OVER}
"""Why a random reach may be refused."""


def pairs(bench: CompanionBench) -> list[tuple[int, int]]:
    """Geoms of the body that must not touch."""
    model = bench.world.cell.model
    limbs = [(side, limb) for side in SIDES for limb in LIMB]
    names = [
        (f"{side}_{limb}", body)
        for (side, limb), body in itertools.product(limbs, BODY)
        if (limb, body) not in NEIGHBOURS
    ]
    names += [(f"left_{mine}", f"right_{other}") for mine, other in itertools.product(LIMB, LIMB)]
    return [(model.geom(PREFIX + a).id, model.geom(PREFIX + b).id) for a, b in names]


def smallest_gap(bench: CompanionBench, among: list[tuple[int, int]]) -> float:
    """[m] between any two of them; 5 cm when all are further apart."""
    cell = bench.world.cell
    return min(mujoco.mj_geomDistance(cell.model, cell.data, a, b, 0.05, None) for a, b in among)


def ask(arm: Operator, side: int, chance: random.Random) -> int:
    """Ask for a random reach, often before the body, where the arms meet."""
    x, z = chance.uniform(-0.1, 0.65), chance.uniform(0.35, 1.45)
    y = chance.uniform(-0.25, 0.65) * (1 if side == 0 else -1)
    return arm.ask(Verb.REACH, x, y, z, NAN, NAN, chance.uniform(0.25, 0.8))


def reach_at_random(count: int, seed: int) -> tuple[int, float, float]:
    """Let both arms reach `count` times; returns how many did, the smallest gap [m], the peak [N]."""
    chance, bench = random.Random(seed), CompanionBench()
    among, arms = pairs(bench), (bench.left, bench.right)
    keys: list[int | None] = [None, None]
    reached = asked = 0
    gap = 1.0
    while asked < count or any(key is not None for key in keys):
        for side, arm in enumerate(arms):
            key = keys[side]
            if key is None and asked < count:
                keys[side] = ask(arm, side, chance)
                asked += 1
            elif key is not None and arm.knows(key) and GoalState(arm.status_of(key).state).final:
                status = arm.status_of(key)
                reached += status.state == GoalState.SUCCEEDED
                if status.state == GoalState.REFUSED:
                    assert Reason(status.reason) in ALLOWED, status.text
                    assert status.text
                keys[side] = None
        bench.base.step()
        bench.base.step()
        gap = min(gap, smallest_gap(bench, among))
    peak = max(limb.state().peak_force for limb in bench.world.body.limbs)
    return reached, gap, peak


def test_random_reaches_never_bring_the_body_to_touch_itself() -> None:
    reached, gap, peak = reach_at_random(24, seed=3)
    assert reached >= 5
    assert gap > 0.0
    assert peak < FORCE_LIMIT


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_five_hundred_random_reaches_never_bring_the_body_to_touch_itself() -> None:
    reached, gap, peak = reach_at_random(500, seed=1)
    assert reached > 100
    assert gap > 0.0
    assert peak < FORCE_LIMIT
