"""Whatever happens to frames on their way: nothing raises, nothing grows, and no wrong payload comes out."""

from __future__ import annotations

from collections import deque
from itertools import groupby
from typing import TYPE_CHECKING

from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Parser, encode
from robotree.protocol.isotp import CLASSIC, FD, Channel, frames
from robotree.protocol.messages import Statustext

if TYPE_CHECKING:
    from collections.abc import Sequence

WIDTHS = st.sampled_from([CLASSIC, 12, 32, FD])
PAYLOADS = st.lists(st.binary(min_size=1, max_size=300), min_size=1, max_size=4)
FATES = st.lists(st.sampled_from(["arrives"] * 6 + ["is lost", "comes twice"]), max_size=60)
TURMOIL = st.lists(
    st.tuples(st.sampled_from(["arrives"] * 4 + ["is lost", "comes twice"]), st.integers(0, 5))
)


class Line:
    """Two channels, the frames between them, and a clock that moves when nothing else does.

    Args:
        width: of both ends.
        fates: what happens to each frame, and how many it overtakes.
        flow_fates: the same for flow controls; None: what happens to all.
    """

    def __init__(
        self, width: int, fates: Sequence[tuple[str, int]], flow_fates: Sequence[str] | None = None
    ) -> None:
        self.near, self.far = Channel(width, timeout=1.0), Channel(width, timeout=1.0)
        self.fates, self.now = deque(fates), 0.0
        self.flow_fates = None if flow_fates is None else deque(flow_fates)
        self.under_way: deque[tuple[Channel, bytes]] = deque()
        self.arrived: list[bytes] = []

    def carry(self, payloads: Sequence[bytes]) -> list[bytes]:
        """Send each as soon as the one before is out; hand back what arrived."""
        waiting = deque(payloads)
        while waiting or self.under_way or self.near.busy:
            if waiting and not self.near.busy:
                self._put(self.far, self.near.send(waiting.popleft(), self.now))
            elif self.under_way:
                self._deliver()
            else:
                self.now = self.near.due
                self._put(self.far, self.near.tick(self.now))
                self.far.tick(self.now)
        return self.arrived

    def _put(self, to: Channel, fields: Sequence[bytes]) -> None:
        for field in fields:
            fate, ahead = self.fates.popleft() if self.fates else ("arrives", 0)
            if to is self.near and self.flow_fates is not None:
                fate = self.flow_fates.popleft() if self.flow_fates else "arrives"
            copies = {"is lost": 0, "comes twice": 2}.get(fate, 1)
            for _ in range(copies):
                self.under_way.insert(
                    len(self.under_way) - ahead if ahead else len(self.under_way), (to, field)
                )

    def _deliver(self) -> None:
        to, field = self.under_way.popleft()
        heard = to.feed(field, self.now)
        if heard.payload is not None:
            assert to is self.far
            self.arrived.append(heard.payload)
        self._put(self.near if to is self.far else self.far, heard.reply)


def is_within(some: Sequence[bytes], all_of: Sequence[bytes]) -> bool:
    """Whether the first sequence is the second with gaps, in the same order."""
    rest = iter(all_of)
    return all(any(each == other for other in rest) for each in some)


@given(width=WIDTHS, payloads=PAYLOADS)
def test_without_accidents_everything_arrives_in_order(width: int, payloads: list[bytes]) -> None:
    line = Line(width, [])
    assert line.carry(payloads) == payloads
    assert line.now == 0.0


@given(width=WIDTHS, payloads=PAYLOADS, fates=FATES, flows=st.lists(st.sampled_from(["arrives", "is lost"])))
def test_loss_and_repetition_lose_payloads_but_change_none(
    width: int, payloads: list[bytes], fates: list[str], flows: list[str]
) -> None:
    line = Line(width, [(fate, 0) for fate in fates], flows)
    arrived = [payload for payload, _ in groupby(line.carry(payloads))]  # a single frame can arrive twice
    assert is_within(arrived, payloads)


@given(
    width=WIDTHS,
    payload=st.binary(min_size=80, max_size=300),
    swaps=st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=8),
    lost=st.sets(st.integers(0, 50), max_size=3),
)
def test_the_frames_of_one_payload_in_any_nearby_order_yield_it_or_nothing(
    width: int, payload: bytes, swaps: list[tuple[int, int]], lost: set[int]
) -> None:
    """Sequence numbers repeat after 16 frames, so frames may change places within 15."""
    near, far = Channel(width), Channel(width)
    (first,) = near.send(payload, 0.0)
    (go_on,) = far.feed(first, 0.0).reply
    rest = list(near.feed(go_on, 0.0).reply)
    block = range(min(len(rest), 15))
    for one, other in swaps:
        if one in block and other in block:
            rest[one], rest[other] = rest[other], rest[one]
    arrived = [far.feed(each, 0.0).payload for index, each in enumerate(rest) if index not in lost]
    assert set(arrived) <= {payload, None}


@given(width=WIDTHS, texts=st.lists(st.text("abc ", max_size=50), min_size=2, max_size=5), turmoil=TURMOIL)
def test_through_any_turmoil_no_message_comes_out_that_was_not_sent(
    width: int, texts: list[str], turmoil: list[tuple[str, int]]
) -> None:
    """ISO-TP alone cannot promise it: MAVLink's checksum stands behind it."""
    messages = [Statustext(severity=6, text=text, id=index) for index, text in enumerate(texts)]
    sent = [encode(each, sequence=index, system=1, component=1) for index, each in enumerate(messages)]
    parser = Parser()
    for payload in Line(width, turmoil).carry(sent):
        assert {frame.raw for frame in parser.feed(payload) + parser.flush()} <= set(sent)


@given(fields=st.lists(st.tuples(st.binary(max_size=64), st.floats(0, 3)), max_size=50), width=WIDTHS)
def test_no_bytes_raise_and_what_is_held_is_bounded(fields: list[tuple[bytes, float]], width: int) -> None:
    channel, now = Channel(width, largest=200), 0.0
    channel.send(bytes(150), now)
    for field, later in fields:
        now += later
        heard = channel.feed(field, now)
        assert heard.payload is None or 0 < len(heard.payload) <= 200
        assert all(0 < len(reply) <= width for reply in heard.reply)
        channel.tick(now)


@given(payload=st.binary(min_size=1, max_size=4095), width=WIDTHS)
def test_every_frame_says_what_it_was_made_to_say(payload: bytes, width: int) -> None:
    if len(payload) <= frames.largest_single(width):
        decoded = frames.decode(frames.single(payload, width))
        assert isinstance(decoded, frames.SingleFrame)
        assert decoded.data == payload
    else:
        first = frames.decode(frames.first(payload, width))
        assert isinstance(first, frames.FirstFrame)
        assert (first.length, first.data) == (len(payload), payload[: width - 2])
