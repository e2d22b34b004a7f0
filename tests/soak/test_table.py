"""The table of the campaign's results."""

from __future__ import annotations

from tests.soak.__main__ import plan
from tests.soak.table import Row, Trial, is_good, table

ROW = Row("kill", "proxy", "kill to standing", 0.15)


def test_the_table_counts_what_was_reached_when_and_what_was_false() -> None:
    trials = [
        Trial(ROW, True, 0.1),
        Trial(ROW, True, 0.12),
        Trial(ROW, False, None, note="it drives on", number="kill-3"),
    ]
    told = table(trials)
    assert "| kill: proxy | 3 | 2 | 0.11 | 0.12 | 0.15 | 0 | kill to standing |" in told
    assert "* kill-3 (kill: proxy): it drives on" in told
    assert not is_good(trials)
    assert is_good(trials[:2])


def test_late_and_false_are_told_though_it_was_reached() -> None:
    late, false = (
        Trial(ROW, True, 0.2, number="kill-1"),
        Trial(ROW, True, 0.1, ["it is done"], number="kill-2"),
    )
    assert not is_good([late])
    assert not is_good([false])
    assert "* kill-1 (kill: proxy): 0.20 s instead of 0.15" in table([late, false])
    assert "* kill-2 (kill: proxy): false: it is done" in table([late, false])


def test_what_could_not_be_tried_is_named_and_counts_nowhere() -> None:
    trials = [Trial(ROW, True, 0.1), Trial(ROW, False, skipped="no namespaces", number="kill-2")]
    told = table(trials)
    assert "| kill: proxy | 1 | 1 |" in told
    assert "* kill-2 (kill: proxy): not tried: no namespaces" in told
    assert is_good(trials)


def test_the_quick_campaign_tries_every_kind_that_the_long_one_tries() -> None:
    """But for the two that alone would take longer than it: a deep tree, and ten thousand robots."""
    quick, whole = ({name.partition("-")[0] for name, _ in plan(quick=quick)} for quick in (True, False))
    assert whole - quick == {"deep", "lives"}
