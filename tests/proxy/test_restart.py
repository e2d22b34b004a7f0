"""Laws of telling a controller's restart by its clock."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robotree.proxy.restart import MAX_JITTER, Report, has_restarted, is_older

SECONDS = st.floats(0.0, 1e6)
DELAY = st.floats(0.0, 0.99 * MAX_JITTER)
BEGIN = 1000.0
"""[s] on our clock when the first life began."""


def report(began: float, said: float, delay: float, rate: float = 1.0) -> Report:
    """What a controller says at a moment [s] of our clock, which its own follows at a rate."""
    return Report(int(1000 * rate * (said - began)), said + delay)


@given(uptime=st.floats(MAX_JITTER, 1e6), down=SECONDS, age=SECONDS, delays=st.tuples(DELAY, DELAY))
@example(uptime=3.0, down=5.5, age=4.5, delays=(0.0, 0.0))
@example(uptime=60.0, down=30.0, age=90.0, delays=(0.0, 0.0))
def test_a_new_life_is_told_however_old_it_is_when_it_is_heard(
    uptime: float, down: float, age: float, delays: tuple[float, float]
) -> None:
    died = BEGIN + uptime
    before, after = report(BEGIN, died, delays[0]), report(died + down, died + down + age, delays[1])
    assume(
        uptime + down + delays[1] - delays[0] > MAX_JITTER + 0.01
    )  # else it could be the old one, heard late
    assert has_restarted(before, after)


@given(uptime=SECONDS, gap=SECONDS, delays=st.tuples(DELAY, DELAY))
def test_a_life_that_goes_on_is_not_taken_for_a_new_one_whatever_the_delays(
    uptime: float, gap: float, delays: tuple[float, float]
) -> None:
    said = BEGIN + uptime
    assert not has_restarted(report(BEGIN, said, delays[0]), report(BEGIN, said + gap, delays[1]))


@given(uptime=SECONDS, gap=SECONDS, rate=st.floats(0.05, 20.0), delays=st.tuples(DELAY, DELAY))
def test_nor_is_one_whose_clock_goes_wrong_if_it_is_older_than_it_was_not_heard(
    uptime: float, gap: float, rate: float, delays: tuple[float, float]
) -> None:
    assume(rate * (uptime + gap) > gap + 2 * MAX_JITTER)
    said = BEGIN + uptime
    assert not has_restarted(report(BEGIN, said, delays[0], rate), report(BEGIN, said + gap, delays[1], rate))


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9, 10.0])
def test_a_drift_that_grows_slowly_is_no_restart(rate: float) -> None:
    words = [report(BEGIN, BEGIN + 0.5 * count, 0.0, rate) for count in range(10_000)]
    assert not any(has_restarted(*pair) for pair in pairwise(words))


def test_a_clock_that_has_fallen_tells_a_restart_though_ours_stood_still() -> None:
    """Ours does while the computer sleeps."""
    assert has_restarted(Report(2_000_000, 50.0), Report(1_000_000, 55.0))
    assert not has_restarted(Report(2_000_000, 50.0), Report(5_600_000, 55.0))


@given(
    uptime=st.floats(MAX_JITTER, 1e6), gap=st.floats(0.01, 0.9 * MAX_JITTER), delays=st.tuples(DELAY, DELAY)
)
def test_of_one_life_the_word_that_was_said_first_is_overtaken_whichever_is_heard_first(
    uptime: float, gap: float, delays: tuple[float, float]
) -> None:
    first, second = report(BEGIN, BEGIN + uptime, delays[0]), report(BEGIN, BEGIN + uptime + gap, delays[1])
    assert not is_older(first, second)
    if first.heard_at >= second.heard_at:
        assert is_older(second, first)


@given(uptime=st.floats(0.0, 1e6), down=SECONDS, delays=st.tuples(DELAY, DELAY))
def test_a_new_life_is_heard_once_it_is_older_than_any_delay(
    uptime: float, down: float, delays: tuple[float, float]
) -> None:
    died = BEGIN + uptime
    before = report(BEGIN, died, delays[0])
    after = report(
        died + down, died + down + MAX_JITTER + max(0.0, delays[0] - delays[1]) + 0.002, delays[1]
    )  # the wire tells whole milliseconds
    assume(after.heard_at > before.heard_at)
    assert not is_older(before, after)
