"""Two clocks: the estimate is right to within half of the shortest round trip."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import Timesync
from robotree.protocol.services.timesync import DRIFT, KEPT, PERIOD, Synchroniser, answer

delays = st.lists(st.tuples(st.floats(0, 0.3), st.floats(0, 0.3)), min_size=1, max_size=2 * KEPT)


@given(offset=st.floats(-1e6, 1e6), ways=delays)
def test_the_offset_is_right_to_within_the_best_delay(offset: float, ways: list[tuple[float, float]]) -> None:
    ours, now = Synchroniser(), max(0.0, -offset) + 1.0
    for there, back in ways:
        now += PERIOD
        (question,) = ours.tick(now)
        (reply,) = answer(question, now + there + offset)
        estimate = ours.receive(reply, now + there + back)
        assert estimate is not None
        assert abs(estimate.offset - offset) <= estimate.delay + 1e-6
    shortest = min(sum(way) for way in ways[-KEPT:])
    assert ours.estimate is not None
    assert abs(ours.estimate.delay - shortest / 2) < 1e-6


def test_only_questions_are_answered_and_only_ours_are_believed() -> None:
    ours = Synchroniser()
    assert ours.estimate is None
    (question,) = ours.tick(5.0)
    assert ours.tick(5.5) == []
    assert answer(Timesync(tc1=3, ts1=4), 1.0) == []
    assert ours.receive(question, 5.1) is None
    assert ours.receive(Timesync(tc1=1, ts1=4), 5.1) is None
    (reply,) = answer(question, 0.0)
    assert reply.tc1, "an answer is never a question, not even at the beginning of time"
    assert ours.receive(reply, 5.1) is not None
    assert ours.receive(reply, 5.1) is None, "once"


def test_an_answer_from_long_ago_is_not_believed() -> None:
    ours = Synchroniser()
    (question,) = ours.tick(0.0)
    (reply,) = answer(question, 1.0)
    assert ours.receive(reply, 11.0) is None


@given(
    before=st.floats(-1e6, 1e6),
    step=st.floats(1.0, 1e6),
    sign=st.sampled_from([-1, 1]),
    ways=delays,
    new_ways=delays,
)
def test_a_far_clock_that_was_set_anew_is_believed_at_once(
    before: float,
    step: float,
    sign: int,
    ways: list[tuple[float, float]],
    new_ways: list[tuple[float, float]],
) -> None:
    ours, after = Synchroniser(), before + sign * (step + 1.0)  # no delay here explains more than 0.6 s
    now = max(0.0, -before, -after) + 1.0
    for offset, each in ((before, ways), (after, new_ways)):
        for there, back in each:
            now += PERIOD
            (question,) = ours.tick(now)
            (reply,) = answer(question, now + there + offset)
            estimate = ours.receive(reply, now + there + back)
            assert estimate is not None
            assert abs(estimate.offset - offset) <= estimate.delay + 1e-6


def test_clocks_that_drift_are_no_reason_to_begin_anew() -> None:
    ours, drift = Synchroniser(), DRIFT * 0.9
    for i in range(1, 3 * KEPT):
        (question,) = ours.tick(now := i * PERIOD)
        delay = 1e-6 if i == 2 * KEPT else 1e-5
        (reply,) = answer(question, (now + delay) * (1 + drift) + 100.0)
        ours.receive(reply, now + 2 * delay)
    assert ours.estimate is not None
    assert ours.estimate.delay < 2e-6, "the best of the last few counts"
