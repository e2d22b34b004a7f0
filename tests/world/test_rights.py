"""A policy in virtual time: no seed breaks a law, and each repeats exactly."""

from __future__ import annotations

from tests.world.rights import play

SEEDS = range(2)


def test_no_seed_breaks_a_law_and_each_gives_one_trace() -> None:
    played = [play(seed) for seed in SEEDS]
    assert [judge.broken for _, judge in played] == [[] for _ in SEEDS]
    assert all(len(judge.tickets) > 10 for _, judge in played), "who may is served"
    assert play(0)[0] == played[0][0]
