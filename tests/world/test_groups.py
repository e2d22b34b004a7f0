"""Orders for groups and questions to people while processes die and networks part: no seed breaks a law."""

from __future__ import annotations

from tests.world.groups import play

SEEDS = range(6)


def test_no_seed_breaks_a_law_and_each_gives_one_trace() -> None:
    played = [play(seed) for seed in SEEDS]
    assert [story.broken for _, story in played] == [[] for _ in SEEDS]
    stories = [story for _, story in played]
    assert all(story.reached >= 4 and story.failures >= 10 and story.counted >= 5 for story in stories)
    assert any(story.ends["nobody"] for story in stories), "some questions end by their limit"
    assert sum(story.crossed for story in stories) >= 5, "questions outlive the process that has asked them"
    assert play(0)[0] == played[0][0]
