"""What docs/comparison.md says of each peer, and of robotree's own page."""

from __future__ import annotations

import pytest

from tests.comparison.counting import code_lines
from tests.comparison.table import (
    HERE,
    MOTION,
    PAGE,
    PEERS,
    PYTHON,
    ROOT,
    lines_row,
    page_of,
    play,
    play_here,
)


@pytest.mark.comparison
@pytest.mark.skipif(not PYTHON.exists(), reason="`make comparison` builds the environment of the peers")
@pytest.mark.parametrize("peer", PEERS)
class TestAPeer:
    def test_it_picks_and_places(self, peer: str) -> None:
        outcome = play(peer, "success")
        assert outcome.said == "success"
        assert sum(what == "reached" for _, what, _ in outcome.goals) == 8

    def test_a_cancel_ends_the_motion_and_cleans_up(self, peer: str) -> None:
        outcome = play(peer, "cancel")
        assert outcome.said == "cancelled"
        assert outcome.went_on < MOTION / 2
        assert outcome.let_go

    def test_a_motion_goes_on_to_its_end_when_the_program_is_killed(self, peer: str) -> None:
        outcome = play(peer, "kill")
        assert outcome.went_on > MOTION / 2
        assert not outcome.let_go

    def test_a_lost_arm_fails_the_work(self, peer: str) -> None:
        assert play(peer, "lost").said.startswith("failure")


def test_our_page_is_no_longer_than_the_peers() -> None:
    theirs = [code_lines(page_of(HERE / f"with_{peer}.py")) for peer in PEERS]
    assert code_lines(page_of(PAGE)) < min(theirs)
    assert lines_row() in (ROOT / "docs" / "comparison.md").read_text()


def test_our_motion_ends_at_once_and_after_a_kill_with_its_step() -> None:
    assert play_here("success").said == "success"
    for scene in ("cancel", "lost"):
        assert play_here(scene).went_on < 0.3
    assert play_here("kill").went_on < 1.0, "the child waits for its host: the step ends, and none begins"
    assert play_here("cancel").let_go
