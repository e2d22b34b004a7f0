"""Scripts and robots in one process, in real time: a script waits in a thread of its own."""

from __future__ import annotations

from collections.abc import AsyncIterator

import pytest

from robotree.vr.agents import agent
from robotree.vr.exchange import claim
from tests.vr.scripts.stage import Listed, Stage


@pytest.fixture(autouse=True)
def names_are_sure_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A network in memory delivers at once what somebody else may say of a name."""
    for module in (claim, agent):
        monkeypatch.setattr(module, "SETTLE", 0.005)


@pytest.fixture
async def stage() -> AsyncIterator[Stage]:
    stage = Stage()
    yield stage
    await stage.close()


@pytest.fixture
async def listed() -> AsyncIterator[Listed]:
    stage = Listed()
    await stage.open()
    yield stage
    await stage.close()
