"""A small mesh over the real network: no seed breaks a law, and each repeats exactly."""

from __future__ import annotations

import pytest

from tests.world.mesh import play


@pytest.mark.parametrize("first", range(0, 40, 10))
def test_everybody_hears_everybody_after_the_calm(first: int) -> None:
    """In 5 the realm's folder is lost while the disk is full."""
    assert [
        (seed, story.broken) for seed in range(first, first + 10) if (story := play(seed)[1]).broken
    ] == []


@pytest.mark.parametrize("seed", [1, 6])
def test_a_seed_gives_one_trace(seed: int) -> None:
    first, story = play(seed)
    assert play(seed)[0] == first
    assert story.faults
    assert story.answered > 25
