"""Pictures over MAVLink's image transmission protocol.

DATA_TRANSMISSION_HANDSHAKE announces size and number of packets, ENCAPSULATED_DATA carries 253 bytes each.
There is no repetition: a picture with a hole is dropped and counted, the next one comes anyway.
"""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages import DataStreamType, DataTransmissionHandshake, EncapsulatedData
from robotree.protocol.services.peer import Peer

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.frame import Frame
    from robotree.protocol.messages import Message

PACKET = 253
"""[bytes] of a picture in one message."""
LARGEST = 4 * 1024 * 1024
"""[bytes] of a picture."""
MAX_PEERS = 16
"""Unfinished pictures that are kept, one per peer."""


class Picture(msgspec.Struct, frozen=True):
    """A picture that arrived whole."""

    peer: Peer
    data: bytes
    """JPEG."""
    width: int
    height: int
    quality: int


class PictureStatistics(msgspec.Struct):
    """One reading of a receiver's gauges."""

    received: int = 0
    dropped: int = 0
    """Pictures with a hole, or that nobody can want."""
    pieces: int = 0
    """Packets that belong to a picture; while they grow, one is on its way."""


def split(jpeg: bytes, *, width: int, height: int, quality: int) -> list[Message]:
    """The messages that carry a picture.

    Raises:
        InvalidMessage: it is empty or larger than `LARGEST`.
    """
    if not 0 < len(jpeg) <= LARGEST:
        problem = f"carries pictures of 1 to {LARGEST} bytes, not {len(jpeg)}"
        raise InvalidMessage("ENCAPSULATED_DATA", "data", problem)
    pieces = [jpeg[i : i + PACKET] for i in range(0, len(jpeg), PACKET)]
    announcement = DataTransmissionHandshake(
        type=DataStreamType.IMG_JPEG,
        size=len(jpeg),
        width=width,
        height=height,
        packets=len(pieces),
        payload=PACKET,
        jpg_quality=quality,
    )
    return [announcement, *(EncapsulatedData(i, piece) for i, piece in enumerate(pieces))]


class PictureReceiver:
    """Puts pictures together, one at a time from each peer."""

    def __init__(self) -> None:
        self._unfinished: dict[Peer, tuple[DataTransmissionHandshake, list[bytes]]] = {}
        self._gauges = PictureStatistics()

    @property
    def statistics(self) -> PictureStatistics:
        """The gauges now."""
        return copy(self._gauges)

    def receive(self, frame: Frame, via: Hashable) -> list[Picture]:
        """Take a frame; the picture that it completes."""
        message = frame.message
        if isinstance(message, DataTransmissionHandshake):
            self._begin(Peer(via, frame.system, frame.component), message)
        elif isinstance(message, EncapsulatedData):
            return self._add(Peer(via, frame.system, frame.component), message)
        return []

    def link_closed(self, via: Hashable) -> None:
        """A link ended, and with it the pictures that were coming on it."""
        for peer in [peer for peer in self._unfinished if peer.via == via]:
            self._drop(peer)

    def _begin(self, peer: Peer, announcement: DataTransmissionHandshake) -> None:
        if peer in self._unfinished:
            self._drop(peer)
        size, payload = announcement.size, announcement.payload
        if (
            not 0 < size <= LARGEST
            or not 0 < payload <= PACKET
            or -(-size // payload) != announcement.packets
        ):
            self._gauges.dropped += 1
            return
        if len(self._unfinished) >= MAX_PEERS:
            self._drop(next(iter(self._unfinished)))
        self._unfinished[peer] = (announcement, [])

    def _add(self, peer: Peer, piece: EncapsulatedData) -> list[Picture]:
        if peer not in self._unfinished:
            return []
        announcement, pieces = self._unfinished[peer]
        if piece.seqnr != len(pieces) & 0xFFFF:
            self._drop(peer)
            return []
        self._gauges.pieces += 1
        pieces.append(piece.data[: announcement.payload])
        if len(pieces) < announcement.packets:
            return []
        del self._unfinished[peer]
        self._gauges.received += 1
        data = b"".join(pieces)[: announcement.size]
        return [Picture(peer, data, announcement.width, announcement.height, announcement.jpg_quality)]

    def _drop(self, peer: Peer) -> None:
        del self._unfinished[peer]
        self._gauges.dropped += 1
