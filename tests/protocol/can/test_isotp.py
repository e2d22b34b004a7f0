"""ISO 15765-2: its stories, its laws whatever happens to frames, and side by side with can-isotp."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import groupby
from math import inf
from typing import TYPE_CHECKING

import isotp
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Parser, encode
from robotree.protocol.isotp import (
    CLASSIC,
    FD,
    Channel,
    Failure,
    FlowControl,
    FlowStatus,
    PayloadSize,
    Receiver,
    Sender,
    TransferUnderWay,
    frames,
)
from robotree.protocol.messages import Statustext

if TYPE_CHECKING:
    from collections.abc import Sequence

GO_ON = FlowControl(FlowStatus.CONTINUE)
TWENTY = bytes(range(20))


def hexed(fields: list[bytes]) -> list[str]:
    return [field.hex() for field in fields]


def test_a_classic_transfer_looks_as_the_standard_draws_it() -> None:
    sender = Sender(CLASSIC)
    assert hexed(sender.send(TWENTY, 0.0)) == ["1014000102030405"]
    assert hexed(sender.control(GO_ON, 0.1)) == ["21060708090a0b0c", "220d0e0f10111213"]
    assert not sender.busy
    assert sender.due == inf


def test_a_single_frame_of_can_fd_uses_the_longer_header_only_when_it_must() -> None:
    assert frames.single(bytes(7), FD) == b"\x07" + bytes(7)
    assert frames.single(bytes(8), FD) == b"\x00\x08" + bytes(8) + b"\xcc\xcc"
    assert len(frames.single(bytes(62), FD)) == FD


@pytest.mark.parametrize("width", frames.SIZES[8:])
def test_every_data_field_has_a_size_that_can_can_carry(width: int) -> None:
    for size in range(1, 300):
        sender = Sender(width)
        fields = sender.send(bytes(size), 0.0)
        if sender.busy:
            fields += sender.control(GO_ON, 0.0)
        assert {len(field) for field in fields} <= set(frames.SIZES)
        assert max(map(len, fields)) <= width


def test_sequence_numbers_begin_at_one_and_go_round() -> None:
    sender = Sender(CLASSIC)
    sender.send(bytes(6 + 7 * 20), 0.0)
    numbers = [field[0] & 0xF for field in sender.control(GO_ON, 0.0)]
    assert numbers == [*range(1, 16), *range(5)]


def test_a_block_ends_with_a_wait_for_the_next_flow_control() -> None:
    sender = Sender(CLASSIC)
    sender.send(bytes(6 + 7 * 5), 0.0)
    three = FlowControl(FlowStatus.CONTINUE, block_size=3)
    assert len(sender.control(three, 0.0)) == 3
    assert sender.busy
    assert sender.due == pytest.approx(1.0)
    assert len(sender.control(three, 0.5)) == 2
    assert not sender.busy


def test_the_separation_time_is_kept() -> None:
    sender = Sender(CLASSIC)
    sender.send(bytes(6 + 7 * 3), 0.0)
    assert len(sender.control(FlowControl(FlowStatus.CONTINUE, separation=0.01), 1.0)) == 1
    assert sender.due == pytest.approx(1.01)
    assert sender.tick(1.005) == []
    assert len(sender.tick(1.01)) == 1
    assert len(sender.tick(1.02)) == 1
    assert not sender.busy


def test_a_silent_receiver_ends_the_transfer() -> None:
    sender = Sender(CLASSIC, n_bs=0.3)
    sender.send(TWENTY, 0.0)
    assert sender.tick(0.29) == []
    assert sender.busy
    assert sender.tick(0.3) == []
    assert not sender.busy
    assert sender.failed is Failure.SILENCE
    assert sender.send(b"next", 0.4)
    assert sender.failed is None


@pytest.mark.parametrize(
    ("status", "why"),
    [(FlowStatus.OVERFLOW, Failure.OVERFLOW), (7, Failure.INVALID)],
)
def test_a_receiver_can_end_the_transfer(status: int, why: Failure) -> None:
    sender = Sender(CLASSIC)
    sender.send(TWENTY, 0.0)
    assert sender.control(FlowControl(status), 0.1) == []
    assert sender.failed is why
    assert sender.statistics.failed == 1


def test_a_receiver_may_ask_to_wait_but_not_for_ever() -> None:
    sender = Sender(CLASSIC, most_waits=3)
    sender.send(TWENTY, 0.0)
    for count in range(3):
        sender.control(FlowControl(FlowStatus.WAIT), 0.9 * (count + 1))
        assert sender.busy
    sender.control(FlowControl(FlowStatus.WAIT), 3.6)
    assert sender.failed is Failure.WAITS


def test_flow_controls_that_nobody_waits_for_are_counted() -> None:
    sender = Sender(CLASSIC)
    assert sender.control(GO_ON, 0.0) == []
    assert sender.statistics.unexpected == 1


def test_a_second_payload_must_wait_for_the_first() -> None:
    sender = Sender(CLASSIC)
    sender.send(TWENTY, 0.0)
    with pytest.raises(TransferUnderWay, match="6 of 20 bytes"):
        sender.send(b"x", 0.0)
    sender.control(GO_ON, 0.1)
    assert sender.send(b"x", 0.1) == [b"\x01x"]


@pytest.mark.parametrize("size", [0, 4096])
def test_what_iso_tp_cannot_carry_is_our_mistake(size: int) -> None:
    with pytest.raises(PayloadSize, match=f"{size} bytes"):
        Sender().send(bytes(size), 0.0)


def test_there_is_no_can_frame_of_nine_bytes() -> None:
    with pytest.raises(ValueError, match="9 bytes"):
        Sender(9)


@pytest.mark.parametrize("width", [CLASSIC, FD])
def test_the_longest_payload_arrives(width: int) -> None:
    near, far = Channel(width), Channel(width)
    payload = bytes(index % 251 for index in range(4095))
    (first,) = near.send(payload, 0.0)
    (go_on,) = far.feed(first, 0.0).reply
    arrived = [far.feed(field, 0.0).payload for field in near.feed(go_on, 0.0).reply]
    assert arrived.pop() == payload
    assert not any(arrived)


def test_a_receiver_that_wants_blocks_gets_blocks() -> None:
    near, far = Channel(CLASSIC), Channel(CLASSIC, block_size=2, separation=0.001)
    fields, payload, flows, now = list(near.send(bytes(100), 0.0)), None, 0, 0.0
    while payload is None:
        for field in fields:
            heard = far.feed(field, now)
            payload = heard.payload or payload
            flows += len(heard.reply)
            fields = [each for reply in heard.reply for each in near.feed(reply, now).reply]
        now += 0.001
        fields = fields or list(near.tick(now))
    assert payload == bytes(100)
    assert flows == 7  # 14 consecutive frames


def test_a_missing_frame_ends_the_reassembly() -> None:
    channel = Channel(CLASSIC)
    channel.feed(frames.first(TWENTY, CLASSIC), 0.0)
    assert channel.feed(frames.consecutive(2, TWENTY[13:]), 0.0).payload is None
    assert channel.feed(frames.consecutive(1, TWENTY[6:13]), 0.0).payload is None
    statistics = channel.statistics.receiver
    assert (statistics.out_of_sequence, statistics.unexpected) == (1, 1)


def test_a_frame_that_comes_twice_in_a_row_is_taken_once() -> None:
    channel = Channel(CLASSIC)
    first, second = frames.consecutive(1, TWENTY[6:13]), frames.consecutive(2, TWENTY[13:])
    assert channel.feed(frames.first(TWENTY, CLASSIC), 0.0).reply
    assert not channel.feed(frames.first(TWENTY, CLASSIC), 0.001).reply
    assert channel.feed(first, 0.0).payload is None
    assert channel.feed(first, 0.0).payload is None
    assert channel.feed(second, 0.0).payload == TWENTY
    assert channel.statistics.receiver.repeated == 2


def test_a_sender_that_begins_again_gets_leave_again() -> None:
    receiver = Receiver(n_cr=1.0)
    first = frames.FirstFrame(20, TWENTY[:6])
    assert receiver.first(first, 0.0)
    assert receiver.first(first, 0.5)
    assert receiver.statistics.interrupted == 1


def test_a_silent_sender_is_forgotten() -> None:
    channel = Channel(CLASSIC, timeout=0.5)
    channel.feed(frames.first(TWENTY, CLASSIC), 0.0)
    assert channel.due == pytest.approx(0.5)
    channel.tick(0.5)
    assert channel.due == inf
    assert channel.feed(frames.consecutive(1, TWENTY[6:13]), 0.6).payload is None
    assert channel.statistics.receiver.silent == 1


def test_another_payload_ends_the_one_that_was_under_way() -> None:
    channel = Channel(CLASSIC)
    channel.feed(frames.first(TWENTY, CLASSIC), 0.0)
    assert channel.feed(frames.single(b"stop", CLASSIC), 0.0).payload == b"stop"
    assert channel.statistics.receiver.interrupted == 1


@pytest.mark.parametrize("field", [b"\x10\xc8" + bytes(6), b"\x10\x00\x00\x00\x10\x00\x00\x00"])
def test_a_payload_that_is_too_long_is_refused_before_it_is_sent(field: bytes) -> None:
    channel = Channel(CLASSIC, largest=100)
    (reply,) = channel.feed(field, 0.0).reply
    flow = frames.decode(reply)
    assert isinstance(flow, FlowControl)
    assert flow.status == FlowStatus.OVERFLOW
    assert channel.statistics.receiver.refused == 1


@pytest.mark.parametrize(
    "field",
    [
        b"",
        b"\x00",  # a single frame of nothing
        b"\x05abc",  # of more than there is
        b"\x00\x3f" + bytes(62),  # the same with CAN FD
        b"\x03" + bytes(11),  # the short header in a long field
        b"\x00\x05" + bytes(10),  # the long header for a short payload
        b"\x10\x14abc",  # a first frame that is not full
        b"\x10\x07" + bytes(6),  # a first frame of what fits one frame
        b"\x10\x00\x00\x00\x00\x20ab",  # 32 bits of length for 32 bytes
        b"\x21",
        b"\x30\x00",
        b"\x40\x00\x00",
        b"\xff" * 8,
    ],
)
def test_what_the_standard_does_not_allow_is_counted(field: bytes) -> None:
    channel = Channel()
    heard = channel.feed(field, 0.0)
    assert (heard.payload, list(heard.reply)) == (None, [])
    assert channel.statistics.malformed == 1


@pytest.mark.parametrize(
    ("seconds", "code"),
    [
        (0.0, 0),
        (0.0001, 0xF1),
        (0.00025, 0xF3),
        (0.0009, 0xF9),
        (0.001, 1),
        (0.0015, 2),
        (0.127, 127),
        (9, 127),
    ],
)
def test_separation_times_are_rounded_to_the_slower_side(seconds: float, code: int) -> None:
    assert frames.encode_separation(seconds) == code


def test_reserved_separation_times_mean_the_longest() -> None:
    assert frames.decode_separation(0x80) == frames.decode_separation(0xFA) == pytest.approx(0.127)


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


Way = Callable[[Channel, "Theirs", bytes], bytes | None]
"""Sends a payload one way; hands back what arrived."""
TO_THEM, TO_US = 0x18DA8001, 0x18DA0180


class Theirs:
    """Their stack, driven by hand: what it sends waits in `out`."""

    def __init__(self, width: int, **params: object) -> None:
        self.out: deque[bytes] = deque()
        self._inbox: deque[isotp.CanMessage] = deque()
        self._fd = width > CLASSIC
        self.errors: list[Exception] = []
        self._layer = isotp.TransportLayerLogic(
            rxfn=lambda _timeout: self._inbox.popleft() if self._inbox else None,
            txfn=lambda message: self.out.append(bytes(message.data)),
            address=isotp.Address(isotp.AddressingMode.Normal_29bits, txid=TO_US, rxid=TO_THEM),
            error_handler=self.errors.append,
            params={"tx_data_length": width, "can_fd": self._fd, "blocking_send": False, **params},
        )

    def feed(self, field: bytes) -> None:
        self._inbox.append(
            isotp.CanMessage(arbitration_id=TO_THEM, data=field, extended_id=True, is_fd=self._fd)
        )
        self._layer.process()

    def send(self, payload: bytes) -> None:
        self._layer.send(payload)
        self._layer.process()

    def received(self) -> bytes | None:
        payload = self._layer.recv()
        return None if payload is None else bytes(payload)


def from_us(channel: Channel, theirs: Theirs, payload: bytes) -> bytes | None:
    """Send from our stack to theirs."""
    under_way = deque(channel.send(payload, 0.0))
    while under_way:
        theirs.feed(under_way.popleft())
        while theirs.out:
            under_way += channel.feed(theirs.out.popleft(), 0.0).reply
    return theirs.received()


def from_them(channel: Channel, theirs: Theirs, payload: bytes) -> bytes | None:
    """Send from their stack to ours."""
    theirs.send(payload)
    arrived = None
    while theirs.out:
        heard = channel.feed(theirs.out.popleft(), 0.0)
        arrived = arrived or heard.payload
        for reply in heard.reply:
            theirs.feed(reply)
    return arrived


@pytest.mark.parametrize("width", [CLASSIC, 16, FD])
@pytest.mark.parametrize("way", [from_us, from_them])
def test_every_size_passes_between_the_two_stacks(width: int, way: Way) -> None:
    channel, theirs = Channel(width), Theirs(width)
    for size in range(1, 300):
        payload = bytes((size + index) % 256 for index in range(size))
        assert way(channel, theirs, payload) == payload
    assert not theirs.errors
    statistics = channel.statistics
    assert (statistics.malformed, statistics.sender.failed, statistics.sender.unexpected) == (0, 0, 0)
    assert statistics.sender.sent + statistics.receiver.received == 299


@pytest.mark.parametrize("way", [from_us, from_them])
def test_the_longest_payload_passes_in_blocks(way: Way) -> None:
    channel, theirs = Channel(CLASSIC, block_size=4), Theirs(CLASSIC, blocksize=4)
    payload = bytes(index % 253 for index in range(4095))
    assert way(channel, theirs, payload) == payload
    assert not theirs.errors


@pytest.mark.parametrize("padding", [0x00, 0xAA])
def test_padding_of_any_kind_is_understood(padding: int) -> None:
    channel, theirs = Channel(FD), Theirs(FD, tx_padding=padding, tx_data_min_length=64)
    for size in (8, 62, 63, 125, 126, 200):
        assert from_them(channel, theirs, bytes(size)) == bytes(size)
