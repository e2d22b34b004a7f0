"""Sites, gateways and cut lines in virtual time: no seed breaks a law, and each repeats exactly."""

from __future__ import annotations

from tests.world.sites import play

SEEDS = range(3)


def test_no_seed_breaks_a_law_and_each_gives_one_trace() -> None:
    played = [play(seed) for seed in SEEDS]
    assert [judge.broken for _, judge in played] == [[] for _ in SEEDS]
    assert sum(judge.begun for _, judge in played) > 10, "robots work between the faults"
    assert play(0)[0] == played[0][0]
