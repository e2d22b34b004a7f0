"""A command goes on after `kill -9` of its host, anywhere: nothing twice, nothing lost, none stuck."""

from __future__ import annotations

import pytest

from robotree.vr.agents.children import FAREWELL
from tests.durability.stage import Stage

pytestmark = pytest.mark.e2e


async def test_further_kills_while_it_comes_back_and_at_its_end_change_nothing(stage: Stage) -> None:
    """A single kill at each boundary is a matter of test_campaign.py."""
    host = stage.host()
    await stage.furnish(host, "after send 4")
    kills = ["before segment 1", "replay 4", "after end 1"]
    assert await stage.play(host, "tour", kills, steps=8) == [8.0, 8.0]
    assert host.lives == 5
    stage.expect_once(*range(8))


@pytest.mark.speed
async def test_a_parent_goes_on_at_once_when_the_host_of_its_child_has_a_journal_too(stage: Stage) -> None:
    """Such a child may be away itself: its parent waits for it only as long as it does not answer."""
    host, second = stage.host("h1"), stage.host("h2")
    await second.start()
    await stage.presence("host", "h2")
    await stage.furnish(host, "after send 5", other="h2")
    assert await stage.play(host, "tour", [], steps=8) == [8.0, 8.0]
    stage.expect_once(*range(8))
    restarted = host.started[-1]
    waited = next(at for word, *_, at in stage.effects if word == "begin" and at > restarted) - restarted
    assert waited < FAREWELL, f"the next effect came {waited:.1f} s after the start"
