from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.durability.stage import Stage, staged


@pytest.fixture
async def stage(place: Path, tmp_path: Path) -> AsyncIterator[Stage]:
    """The leaf of a realm of this test alone."""
    del place  # the runtime folder
    async with staged(tmp_path) as stage:
        yield stage
