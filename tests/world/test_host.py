"""Parents and children on one host, two operators, threads that lose the processor: no seed breaks a law."""

from __future__ import annotations

import pytest

from tests.world.host import play


@pytest.mark.parametrize("seeds", [range(10), range(10, 20), range(20, 30)])
def test_no_seed_breaks_a_law(seeds: range) -> None:
    assert [(seed, story.broken) for seed in seeds if (story := play(seed)[1]).broken] == []


@pytest.mark.parametrize("seed", [1, 2])
def test_a_seed_gives_one_trace(seed: int) -> None:
    first, story = play(seed)
    assert play(seed)[0] == first
    assert story.deeds
    assert story.done > 5
