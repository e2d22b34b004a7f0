"""Newest telemetry wins, everything else waits in order."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.links.link import LinkStatistics
from robotree.protocol.links.outbox import Outbox

frames = st.lists(st.tuples(st.binary(min_size=1, max_size=9), st.sampled_from([None, "tool", "joints"])))


def _drain(box: Outbox) -> list[bytes]:
    drained = []
    while (frame := box.pop()) is not None:
        drained.append(frame)
    return drained


@given(frames)
def test_what_has_no_topic_is_never_dropped_and_keeps_its_order(sent: list[tuple[bytes, str | None]]) -> None:
    box = Outbox()
    for i, (frame, topic) in enumerate(sent):
        box.put(bytes((i % 256,)) + frame if topic is None else b"telemetry", topic)
    urgent = [bytes((i % 256,)) + frame for i, (frame, topic) in enumerate(sent) if topic is None]
    assert [frame for frame in _drain(box) if frame != b"telemetry"] == urgent


@given(frames)
def test_of_each_topic_only_the_newest_waits(sent: list[tuple[bytes, str | None]]) -> None:
    box = Outbox()
    for frame, topic in sent:
        box.put(frame, topic)
    newest = {topic: frame for frame, topic in sent if topic is not None}
    urgent = [frame for frame, topic in sent if topic is None]
    assert box.waiting == sum(map(len, [*newest.values(), *urgent]))
    assert box.superseded == len(sent) - len(urgent) - len(newest)
    assert sorted(_drain(box)) == sorted([*newest.values(), *urgent])
    assert box.waiting == 0


@given(frames, st.integers(0, 60))
def test_an_outbox_that_outgrows_its_bound_says_so_and_counts_what_left(
    sent: list[tuple[bytes, str | None]], bound: int
) -> None:
    box = Outbox(bound)
    for frame, topic in sent:
        box.put(frame, topic)
        overrun = box.overrun("tcp:far")
        assert (overrun is not None) == (box.waiting > bound)
        if overrun is not None:
            assert (overrun.address, overrun.waiting) == ("tcp:far", box.waiting)
    waited = box.waiting
    drained = _drain(box)
    assert box.statistics(7) == LinkStatistics(
        sent=sum(map(len, drained)), received=0, waiting=7, superseded=len(sent) - len(drained), dropped=0
    )
    assert box.statistics().sent == waited
    assert box.overrun("tcp:far") is None


def test_a_newer_frame_takes_the_place_of_the_older_one() -> None:
    box = Outbox()
    for frame, topic in [(b"t1", "t"), (b"ack", None), (b"t2", "t")]:
        box.put(frame, topic)
    assert _drain(box) == [b"t2", b"ack"]
