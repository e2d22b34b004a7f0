"""ISO 15765-2 told as stories: what each half says to what, and when."""

from __future__ import annotations

from math import inf

import pytest

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
