"""The search for a posture of the companion's arm ends soon, and finds what a longer one would find."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from robotree.sim.companion import figure as figures
from robotree.sim.companion.figure import ARMS, Figure, Pose, tool
from robotree.sim.companion.planner import REST, SEEDS


@pytest.fixture(scope="module")
def figure() -> Figure:
    return Figure()


@pytest.mark.speed
def test_a_search_that_comes_no_nearer_is_given_up(figure: Figure) -> None:
    q = np.zeros(15)
    beyond = Pose(np.array((2.0, 0.3, 1.0)), tool(0.0, math.pi / 2))
    began = time.thread_time()
    found = figure.solve(0, beyond, q, np.array(REST), iterations=1_000_000)
    assert not found.reached
    assert time.thread_time() - began < 0.5


def test_giving_up_early_loses_no_posture_that_a_long_search_finds(
    figure: Figure, monkeypatch: pytest.MonkeyPatch
) -> None:
    chance = np.random.default_rng(3)
    lower, upper = figure.lower[ARMS[0]], figure.upper[ARMS[0]]
    goals: list[Pose] = []
    for _ in range(60):
        q = np.zeros(15)
        q[ARMS[0]] = chance.uniform(lower, upper)
        pose = figure.pose(0, q)
        moved = chance.choice((0.0, 0.3), p=(0.7, 0.3))  # some a little out of reach
        goals.append(Pose(pose.position + np.array((moved, 0.0, 0.0)), pose.rotation))

    def reached() -> list[bool]:
        seeds = [np.array(seed) for seed in SEEDS]
        return [any(figure.solve(0, goal, q, seed, 40).reached for seed in seeds) for goal in goals]

    q = np.zeros(15)
    soon = reached()
    monkeypatch.setattr(figures, "NEARER", math.inf)
    assert soon == reached()
    assert 20 < sum(soon) < 58, "both kinds were among them"
