"""The messages of a camera component: HEARTBEAT every second, and CAMERA_INFORMATION on request.

Only a command that names the camera's component is answered; the autopilot answers those for all components.
A camera obeys no other command. Pictures have messages of their own (`picture`), so `flags` is 0: the camera
knows none of MAVLink's capture commands (https://mavlink.io/en/services/camera.html).

Pure.
"""

from __future__ import annotations

from math import nan
from typing import TYPE_CHECKING

from robotree.protocol.messages import (
    AnyMessage,
    CommandInt,
    CommandLong,
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
