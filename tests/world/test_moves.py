"""Robots move between hosts that end at any moment of that: no seed breaks a law, and each repeats."""

from __future__ import annotations

import pytest

from tests.world.moves import play


@pytest.mark.parametrize("first", [0, 10, 20])
def test_whatever_ends_one_has_the_robot_or_its_children_are_free(first: int) -> None:
    assert [
        (seed, story.judge.broken)
        for seed in range(first, first + 10)
        if (story := play(seed)[1]).judge.broken
    ] == []


def test_a_lease_that_the_source_still_grants_is_none_that_its_next_process_ends() -> None:
    """In 61 a parent renews its lease with the process that its child is just leaving."""
    assert play(61)[1].judge.broken == []


@pytest.mark.parametrize("seed", [3, 8])
def test_a_seed_gives_one_trace(seed: int) -> None:
    first, story = play(seed)
    assert play(seed)[0] == first
    assert story.moved
