"""Scripts and robots in one process, in real time: a script waits in a thread of its own."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from tests.vr.scripts.stage import Stage


@pytest.fixture
async def stage() -> AsyncIterator[Stage]:
    stage = Stage()
    yield stage
    await stage.close()
