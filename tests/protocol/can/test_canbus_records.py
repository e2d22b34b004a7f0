"""What members of a bus say to each other survives the way, and nonsense is recognised."""

from __future__ import annotations

from itertools import pairwise

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.canbus.records import (
    GREETING_BYTES,
    LARGEST_RECORD,
    Greeting,
    Records,
    encode,
    read_greeting,
)
from robotree.protocol.canbus.seats import SEATS, first_port


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    """Every kind of frame that python-can can describe."""
    extended = draw(st.booleans())
    kind = draw(st.sampled_from(["data", "remote", "error", "fd"]))
    fd = kind == "fd"
    return can.Message(
        arbitration_id=draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
        is_extended_id=extended,
        is_remote_frame=kind == "remote",
        is_error_frame=kind == "error",
        is_fd=fd,
        bitrate_switch=fd and draw(st.booleans()),
        error_state_indicator=fd and draw(st.booleans()),
        dlc=draw(st.integers(0, 8)) if kind == "remote" else None,
        data=None if kind == "remote" else draw(st.binary(max_size=64 if fd else 8)),
        check=True,
    )


@given(sent=st.lists(messages(), max_size=5), cuts=st.lists(st.integers(0, 400)))
def test_frames_survive_being_cut_anywhere(sent: list[can.Message], cuts: list[int]) -> None:
    stream = b"".join(encode(message, timestamp=1.5) for message in sent)
    records, arrived, position = Records("cell"), [], 0
    for cut in [*sorted(cuts), len(stream)]:
        arrived += records.feed(stream[position:cut])
        position = max(position, cut)
    assert records.intact
    assert len(arrived) == len(sent)
    for one, other in zip(arrived, sent, strict=True):
        assert one.equals(other, timestamp_delta=None, check_channel=False)
        assert (one.timestamp, one.channel, one.is_rx) == (1.5, "cell", True)


@given(message=messages())
def test_a_record_is_never_longer_than_it_may_be(message: can.Message) -> None:
    assert len(encode(message, 0.0)) <= LARGEST_RECORD


@given(chunks=st.lists(st.binary(max_size=200)))
def test_no_bytes_raise_and_nonsense_is_never_taken_up_again(chunks: list[bytes]) -> None:
    records = Records("cell")
    for chunk in chunks:
        was_intact = records.intact
        arrived = records.feed(chunk)
        assert was_intact or not arrived


def test_one_wrong_byte_ends_the_trust_in_a_stream() -> None:
    good = encode(can.Message(arbitration_id=1, data=b"ok"), 0.0)
    records = Records("cell")
    assert len(records.feed(good + b"GET / HTTP/1.1\r\n" + good)) == 1
    assert not records.intact
    assert records.feed(good) == []


@pytest.mark.parametrize(
    "message",
    [
        can.Message(arbitration_id=1 << 29),
        can.Message(arbitration_id=0x800, is_extended_id=False),
        can.Message(arbitration_id=-1),
        can.Message(data=bytes(9)),
        can.Message(data=bytes(65), is_fd=True),
        can.Message(data=b"abc", dlc=4),
        can.Message(is_fd=True, is_remote_frame=True),
    ],
    ids=repr,
)
def test_a_frame_that_contradicts_itself_is_the_callers_mistake(message: can.Message) -> None:
    with pytest.raises(ValueError, match="no CAN frame is like this"):
        encode(message, 0.0)


@given(answer=st.booleans(), channel=st.integers(0, 2**32 - 1), token=st.integers(0, 2**64 - 1))
def test_greetings_are_understood(answer: bool, channel: int, token: int) -> None:  # noqa: FBT001
    greeting = Greeting(answer=answer, channel=channel, token=token)
    data = greeting.encode()
    assert len(data) == GREETING_BYTES
    assert read_greeting(data) == greeting


@given(data=st.binary(max_size=20))
def test_nothing_else_is_a_greeting(data: bytes) -> None:
    assert read_greeting(data) is None


@given(name=st.text(min_size=1, max_size=12).filter(lambda name: not name.isdigit()))
def test_a_named_channel_lies_below_the_ports_that_systems_hand_out(name: str) -> None:
    assert 1024 < first_port(name) <= 32768 - SEATS


def test_named_channels_do_not_overlap() -> None:
    firsts = sorted({first_port(f"channel {index}") for index in range(200)})
    assert all(b - a >= SEATS for a, b in pairwise(firsts))


@pytest.mark.parametrize("port", [0, 80, 65536 - SEATS + 1, "70000"])
def test_a_channel_that_is_no_port_is_refused(port: int | str) -> None:
    with pytest.raises(ValueError, match="choose one, or a name"):
        first_port(port)
