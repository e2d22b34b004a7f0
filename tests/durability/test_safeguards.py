"""Without a safeguard the trials of this folder fail: what they hold is held by what is taken away here."""

from __future__ import annotations

import contextlib

import pytest

from robotree.vr.base.errors import VrError
from tests.durability.stage import Stage

pytestmark = pytest.mark.e2e


async def played(stage: Stage, without: str) -> None:
    """Have a host killed in the middle of a tour of eight steps, and started again."""
    host = stage.host()
    host.environment["WITHOUT"] = without
    await stage.furnish(host, "after send 5")
    with contextlib.suppress(VrError, AssertionError):
        await stage.play(host, "tour", [], steps=8)
    assert host.lives == 2


@pytest.mark.parametrize("without", ["commit", "keys"])
async def test_a_tour_without_a_safeguard_does_a_step_twice_or_loses_it(stage: Stage, without: str) -> None:
    await played(stage, without)
    assert stage.twice() or stage.ended != list(range(8)), "the safeguard is not what this folder tests"
