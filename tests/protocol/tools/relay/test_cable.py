"""A joint does to whole frames what it was told, and the same again with the same seed."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Parser, encode
from robotree.protocol.errors import LinkBroken
from robotree.protocol.links.loopback import Faults, Loopback
from robotree.protocol.messages import NamedValueFloat
from robotree.protocol.testing import RecordingHandler
from robotree.protocol.tools.relay import FaultyCable


class Far:
    """A link of which only the far side matters: what was sent on it, at once."""

    def __init__(self) -> None:
        self.network = Loopback(RecordingHandler, self._accept)

    def _accept(self, link: object) -> RecordingHandler:
        self.heard = RecordingHandler(link)  # type: ignore[arg-type]  # any end will do
        return self.heard

    @property
    def sequences(self) -> list[int]:
        self.network.advance()
        return [frame.sequence for frame in Parser().feed(self.heard.data)]


def frame(number: int) -> bytes:
    message = NamedValueFloat(time_boot_ms=number, name="x", value=1.0)
    return encode(message, sequence=number, system=1, component=1)


def joined(faults: Faults) -> tuple[FaultyCable, Far, Far]:
    cable, near, far = FaultyCable(faults, 0.0), Far(), Far()
    cable.open("near", near.network.near)
    cable.open("far", far.network.near)
    return cable, near, far


@given(cut=st.integers(1, 60))
def test_without_faults_everything_passes_both_ways(cut: int) -> None:
    cable, near, far = joined(Faults())
    stream = b"".join(map(frame, range(20))) + b"noise"
    for i in range(0, len(stream), cut):
        cable.take("near", stream[i : i + cut], i)
        cable.take("far", stream[i : i + cut], i)
    assert far.sequences == near.sequences == list(range(20))
    assert far.heard.data == stream
    assert cable.traffic["near"].passed == cable.traffic["near"].taken


def test_a_lost_frame_is_lost_whole_and_the_others_are_not_touched() -> None:
    cable, _, far = joined(Faults(loss=0.3, seed=1))
    for number in range(200):
        cable.take("near", frame(number)[:7], number)
        cable.take("near", frame(number)[7:], number)
    found = far.sequences
    assert 110 <= len(found) <= 170
    assert Parser().feed(far.heard.data)[-1].sequence == found[-1]
    assert len(far.heard.data) == len(found) * len(frame(1))
    traffic = cable.traffic["near"]
    assert (traffic.taken, traffic.passed) == (200, len(found))


def test_the_same_seed_loses_the_same_frames() -> None:
    outcomes: list[list[int]] = []
    for _ in range(2):
        cable, _, far = joined(Faults(loss=0.5, seed=7))
        for number in range(50):
            cable.take("near", frame(number), number)
        outcomes.append(far.sequences)
    assert outcomes[0] == outcomes[1]


def test_a_delayed_frame_comes_when_it_is_due() -> None:
    cable, _, far = joined(Faults(delay=0.5))
    cable.take("near", frame(0), 1.0)
    assert cable.due == 1.5
    cable.advance(1.49)
    assert far.sequences == []
    cable.advance(1.5)
    assert far.sequences == [0]
    assert cable.due is None


def test_nothing_passes_while_the_cable_is_cut_and_everything_after() -> None:
    cable, near, far = joined(Faults())
    for number in range(20):
        if number == 10:
            cable.cut(13.0)
        cable.take("near", frame(number), number)
        cable.take("far", frame(number), number)
    assert near.sequences == far.sequences == [*range(10), *range(13, 20)]


def test_faults_change_while_it_runs() -> None:
    cable, _, far = joined(Faults(loss=1.0))
    cable.take("near", frame(0), 0.0)
    cable.faults = Faults()
    cable.take("near", frame(1), 1.0)
    cable.faults = Faults(duplication=1.0)
    cable.take("near", frame(2), 2.0)
    assert far.sequences == [1, 2, 2]


def test_what_comes_before_the_far_link_is_open_waits_for_it() -> None:
    cable, far = FaultyCable(Faults(), 0.0), Far()
    cable.take("near", frame(0) + frame(1), 0.0)
    cable.open("far", far.network.near)
    cable.take("near", frame(2), 0.1)
    assert far.sequences == [0, 1, 2]


@given(st.lists(st.tuples(st.sampled_from(["near", "far"]), st.binary(max_size=300)), max_size=20))
def test_no_bytes_raise_and_none_are_added(pieces: list[tuple[str, bytes]]) -> None:
    cable, near, far = joined(Faults())
    for now, (side, data) in enumerate(pieces):
        cable.take(side, data, now)
    near.network.advance()
    far.network.advance()
    for side, other in (("near", far), ("far", near)):
        sent = b"".join(data for name, data in pieces if name == side)
        assert sent.startswith(other.heard.data)


def test_an_end_that_has_gone_is_nothing_that_raises() -> None:
    cable, _, far = joined(Faults())
    far.network.cut()
    far.network.advance()
    cable.take("near", frame(0), 0.0)
    assert [type(reason) for reason in far.heard.reasons] == [LinkBroken]
