"""A whole realm over the real network on one machine: proxies with their controllers, hosts and operators."""

from __future__ import annotations

from tests.world.whole import play


def test_a_seed_gives_one_trace_and_breaks_no_law() -> None:
    digest, story = play(4)
    assert story.judge.broken == []
    assert story.faults
    assert len(story.realm.begun) > 10
    assert play(4)[0] == digest
