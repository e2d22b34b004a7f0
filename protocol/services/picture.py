"""Cameras over MAVLink: their component, and pictures by the image transmission protocol.

A camera component sends HEARTBEAT every second, and CAMERA_INFORMATION on request. Only a command that names
the camera's component is answered; the autopilot answers those for all components. A camera obeys no other
command. Pictures have messages of their own, so `flags` is 0: the camera knows none of MAVLink's capture
commands (https://mavlink.io/en/services/camera.html).

DATA_TRANSMISSION_HANDSHAKE announces size and number of packets, ENCAPSULATED_DATA carries 253 bytes each.
There is no repetition: a picture with a hole is dropped and counted, the next one comes anyway.

Pure.
"""

from __future__ import annotations

from copy import copy
from math import nan
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages import (
    AnyMessage,
    CommandInt,
    CommandLong,
    DataStreamType,
    DataTransmissionHandshake,
    EncapsulatedData,
    Heartbeat,
    MavAutopilot,
    MavState,
    MavType,
    make,
)
from robotree.protocol.services import interval
from robotree.protocol.services.command import CommandServer
from robotree.protocol.services.heartbeat import HeartbeatSender
from robotree.protocol.services.peer import Peer, Send

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


_HEARTBEAT = Heartbeat(MavType.CAMERA, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
_NAME = 32
"""[bytes] of the vendor's name and of the model's."""
_WORD = 0xFFFFFFFF


class Camera:
    """The camera component of one system.

    Args:
        system: its MAVLink system id.
        component: its MAVLink component id.
        name: of the camera, told as the model; at most 32 bytes of UTF-8 are sent.
    """

    def __init__(self, system: int, component: int, name: str) -> None:
        self.component = component
        self._system, self._name = system, name
        rates = interval.Intervals({})
        self._server = CommandServer({}, interval.handlers(lambda _: rates, self._produce))
        self._heartbeats = HeartbeatSender()

    def tick(self, now: float) -> list[Heartbeat]:
        """The heartbeat, if it is due; `now` is controller time [s]."""
        return self._heartbeats.tick(_HEARTBEAT, now)

    def receive(self, frame: Frame, via: Hashable, now: float) -> list[Send]:
        """Answer a command that names this component; `now` is controller time [s]."""
        message = frame.message
        if not isinstance(message, CommandLong | CommandInt):  # as most are
            return []
        if frame.target != (self._system, self.component):
            return []
        effects = self._server.receive(message, Peer(via, frame.system, frame.component), now)
        return [effect for effect in effects if isinstance(effect, Send)]

    def _produce(self, msgid: int, now: float) -> tuple[AnyMessage, ...]:
        if msgid == Heartbeat.codec.definition.id:
            return (_HEARTBEAT,)
        information = self._information(now)
        return (information,) if msgid == information.codec.definition.id else ()

    def _information(self, now: float) -> AnyMessage:
        return make(
            "CAMERA_INFORMATION",
            time_boot_ms=round(1000 * now) & _WORD,
            vendor_name=_padded("robotree"),
            model_name=_padded(self._name),
            focal_length=nan,
            sensor_size_h=nan,
            sensor_size_v=nan,
        )


def _padded(text: str) -> bytes:
    return text.encode()[:_NAME].ljust(_NAME, b"\0")
