"""Pictures arrive whole or not at all."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages import DataTransmissionHandshake, EncapsulatedData, Message
from robotree.protocol.services.peer import Peer
from robotree.protocol.services.picture import (
    LARGEST,
    MAX_PEERS,
    PACKET,
    Picture,
    PictureReceiver,
    split,
)

CAMERA = Peer("link", 1, 100)


def _receive(receiver: PictureReceiver, messages: list[Message], component: int = 100) -> list[Picture]:
    frames = [Frame.of(message, component=component) for message in messages]
    return [picture for frame in frames for picture in receiver.receive(frame, "link")]


@settings(deadline=None)
@given(data=st.binary(min_size=1, max_size=5 * PACKET))
def test_a_picture_arrives_as_it_was_zeros_at_its_end_included(data: bytes) -> None:
    receiver = PictureReceiver()
    messages = split(data, width=320, height=240, quality=80)
    assert _receive(receiver, messages) == [Picture(CAMERA, data, 320, 240, 80)]
    assert receiver.statistics.received == 1
    assert receiver.statistics.dropped == 0


@given(missing=st.integers(0, 5))
def test_a_picture_with_a_hole_is_dropped_and_the_next_one_arrives(missing: int) -> None:
    receiver, data = PictureReceiver(), bytes(range(256)) * 4
    messages = split(data, width=1, height=1, quality=1)
    assert len(messages) == 6
    assert _receive(receiver, [*messages[:missing], *messages[missing + 1 :]]) == []
    (picture,) = _receive(receiver, messages)
    assert picture.data == data
    assert receiver.statistics.received == 1
    assert receiver.statistics.dropped == (missing > 0)


def test_pictures_of_two_cameras_may_be_mixed() -> None:
    receiver = PictureReceiver()
    cell = split(b"c" * 600, width=1, height=1, quality=1)
    wrist = split(b"w" * 600, width=1, height=1, quality=1)
    arrived = [
        picture
        for pair in zip(cell, wrist, strict=True)
        for component, message in zip((100, 101), pair, strict=True)
        for picture in _receive(receiver, [message], component)
    ]
    assert [(each.peer.component, each.data[:1]) for each in arrived] == [(100, b"c"), (101, b"w")]


@pytest.mark.parametrize(
    ("size", "packets", "payload"), [(0, 0, 253), (10**9, 4, 253), (500, 3, 253), (5, 1, 0)]
)
def test_an_announcement_that_makes_no_sense_is_counted(size: int, packets: int, payload: int) -> None:
    receiver = PictureReceiver()
    nonsense = DataTransmissionHandshake(0, size, 1, 1, packets, payload, 1)
    assert _receive(receiver, [nonsense, EncapsulatedData(0, b"x")]) == []
    assert receiver.statistics.dropped == 1


def test_announcements_without_pictures_do_not_pile_up() -> None:
    receiver = PictureReceiver()
    for component in range(100):
        _receive(receiver, split(b"x" * 600, width=1, height=1, quality=1)[:1], component)
    assert len(receiver._unfinished) == MAX_PEERS
    receiver.link_closed("link")
    assert receiver.statistics.dropped == 100


@pytest.mark.parametrize("data", [b"", bytes(LARGEST + 1)])
def test_what_is_no_picture_is_not_sent(data: bytes) -> None:
    with pytest.raises(InvalidMessage, match="carries pictures of 1 to"):
        split(data, width=1, height=1, quality=1)
