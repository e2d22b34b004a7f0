from __future__ import annotations

import gc
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from tests.durability.stage import Stage, staged


@pytest.fixture
async def stage(place: Path, tmp_path: Path) -> AsyncIterator[Stage]:
    """The leaf of a realm of this test alone."""
    del place  # the runtime folder
    async with staged(tmp_path) as stage:
        yield stage


@pytest.fixture(autouse=True)
def who_was_killed_is_collected() -> Iterator[None]:
    """Have what ran in a killed process of a rehearsal end here, and not in the middle of another test.

    Its greenlets end where they are collected; that is seldom, and may be anywhere. What was there before
    the test is not looked at: that takes 0.4 s.
    """
    gc.freeze()
    yield
    gc.collect()
