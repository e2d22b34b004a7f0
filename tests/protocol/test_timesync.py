"""Two clocks: the estimate is right to within half of the shortest round trip."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.messages import Timesync
from robotree.protocol.services.timesync import KEPT, PERIOD, Synchroniser, answer

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
