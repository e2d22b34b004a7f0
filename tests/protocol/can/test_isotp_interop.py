"""Side by side with can-isotp: every size, both directions, classic CAN and CAN FD."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import isotp
import pytest

from robotree.protocol.isotp import CLASSIC, FD, Channel

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
