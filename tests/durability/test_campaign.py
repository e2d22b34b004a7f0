"""The campaign of kills, in its small form: nothing twice, nothing lost, none stuck, and an honest count."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from robotree.vr.agents.children import FAREWELL
from tests.durability.campaign import BOUNDARIES, PAIRS, Outcome, count_goals, kill_below, kill_hosts
from tests.durability.stage import Stage

DONE = {0: "done", 1: "done"}
LINES = [
    "1.0 begin 11 verb 1: 0.010000 0.000000 0.2",
    "1.1 end 11 SUCCEEDED",
    "1.2 begin 12 verb 1: -0.010100 0.000000 0.2",
    "1.3 end 12 SUCCEEDED",
]


def counted(lines: list[str], told: dict[int, str]) -> Outcome:
    outcome = Outcome()
    count_goals(outcome, [line.split() for line in lines], told)
    return outcome


def test_what_was_done_once_is_good_and_what_was_not_is_counted() -> None:
    assert counted(LINES, DONE).good
    again = "1.4 begin 13 verb 1: -0.010100 0.000000 0.2"
    assert counted([*LINES, again], DONE).twice == ["below: step 1 was begun 2 times"]
    assert counted(LINES[:3], DONE).lost == ["below: step 1 is said to be done, and is not"]
    in_doubt = counted(LINES[:3], {0: "done", 1: "CommandInDoubt"})
    assert (in_doubt.good, in_doubt.doubts) == (True, 1), "the page knows that it may have happened"


@pytest.mark.e2e
@pytest.mark.usefixtures("place")
async def test_hosts_are_killed_at_each_boundary(tmp_path: Path) -> None:
    outcome = Outcome()
    await kill_hosts(outcome, random.Random(1), len(BOUNDARIES), tmp_path)
    assert outcome.good, outcome
    assert outcome.kills.total() == len(BOUNDARIES)
    assert outcome.effects


@pytest.mark.e2e
@pytest.mark.usefixtures("place")
async def test_proxies_and_controllers_are_killed_alone_and_two_at_once(tmp_path: Path) -> None:
    outcome = Outcome()
    await kill_below(outcome, random.Random(1), len(set(PAIRS)), tmp_path)
    assert outcome.good, outcome
    assert len(outcome.kills) == len(set(PAIRS))


@pytest.mark.e2e
async def test_further_kills_while_it_comes_back_and_at_its_end_change_nothing(stage: Stage) -> None:
    """A single kill at each boundary is a matter of the others."""
    host = stage.host()
    await stage.furnish(host, "after send 4")
    kills = ["before segment 1", "replay 4", "after end 1"]
    assert await stage.play(host, "tour", kills, steps=8) == [8.0, 8.0]
    assert host.lives == 5
    stage.expect_once(*range(8))


@pytest.mark.e2e
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
