"""Random goals all over the workspace: each is reached or refused, none leaves the arm stuck."""

from __future__ import annotations

import collections
import math
import random

import numpy as np
import pytest

from robotree.protocol.messages import GoalState, Reason, Verb
from robotree.sim.testing import ArmBench

HONEST = {Reason.OUT_OF_REACH, Reason.PATH_BLOCKED}


def random_goal(chance: random.Random, azimuth: float) -> tuple[float, ...]:
    radius = chance.uniform(0.2, 0.6)
    x, y = radius * math.cos(azimuth), radius * math.sin(azimuth)
    return x, y, chance.uniform(0.05, 0.5), chance.uniform(-math.pi, math.pi), 0.25


def visit(seed: int, count: int, *, lever: bool) -> collections.Counter[tuple[GoalState, Reason]]:
    arm = ArmBench()
    if not lever:
        arm.world.cell.model.body("lever/stand").pos[:] = (3.0, 0.0, 0.0)
    chance = random.Random(seed)
    ends: collections.Counter[tuple[GoalState, Reason]] = collections.Counter()
    azimuth = 0.0
    for i in range(count):
        # Mostly near the last one, to spare simulated time; every tenth anywhere, across the base too.
        step = math.pi if i % 10 == 0 else 0.8
        azimuth = math.remainder(azimuth + chance.uniform(-step, step), math.tau)
        goal = random_goal(chance, azimuth)
        status = arm.operator.do(Verb.GO_TO, *goal, within=40.0)
        ends[GoalState(status.state), Reason(status.reason)] += 1
        if status.state == GoalState.SUCCEEDED and not status.text:
            assert np.linalg.norm(arm.world.arm.state().position - goal[:3]) < 0.004, goal
        arm.operator.heard.clear()
    return ends


@pytest.mark.timeout(300)
def test_of_ten_goals_on_a_bare_table_none_gets_stuck() -> None:
    """The soak test visits a thousand."""
    ends = visit(seed=5, count=10, lever=False)
    reached = ends.pop((GoalState.SUCCEEDED, Reason.NONE))
    assert reached >= 7
    assert {state for state, _ in ends} <= {GoalState.REFUSED}
    assert {reason for _, reason in ends} <= HONEST


@pytest.mark.timeout(300)
def test_with_a_lever_in_the_way_every_goal_still_ends_with_a_reason() -> None:
    ends = visit(seed=7, count=6, lever=True)
    assert sum(ends.values()) == 6
    assert set(ends) <= {
        (GoalState.SUCCEEDED, Reason.NONE),
        (GoalState.FAILED, Reason.BLOCKED),
        *((GoalState.REFUSED, reason) for reason in HONEST),
    }


@pytest.mark.soak
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("seed", range(5))
def test_of_many_hundred_goals_none_gets_stuck(seed: int) -> None:
    ends = visit(seed=100 + seed, count=200, lever=False)
    assert {state for state, _ in ends} <= {GoalState.SUCCEEDED, GoalState.REFUSED}
    assert ends[GoalState.SUCCEEDED, Reason.NONE] >= 150
