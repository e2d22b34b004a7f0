"""Who is there on a link, and who was, as its table tells it. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.services.heartbeat import LARGEST_CROWD, HeartbeatMonitor

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame
    from robotree.protocol.messages import Heartbeat
    from robotree.protocol.services.peer import Peer


class PeerReading(msgspec.Struct, frozen=True):
    """Somebody whose heartbeat was heard."""

    sysid: int
    compid: int
    type: int
    """MAV_TYPE of the latest heartbeat."""
    state: int
    """MAV_STATE of the latest heartbeat."""
    age: float
    """[s] since the last sign of life."""
    there: bool
    """Whether there was one within three heartbeats."""


class Attendance:
    """Keeps the list of one link."""

    def __init__(self) -> None:
        self._monitor = HeartbeatMonitor()
        self._gone: dict[Peer, tuple[Heartbeat, float]] = {}
        """Who was there: the last heartbeat, and when there was the last sign of life, [s]."""

    def receive(self, frame: Frame, now: float) -> None:
        """Note a sign of life."""
        for found in self._monitor.receive(frame, None, now):
            self._gone.pop(found.peer, None)

    def reading(self, now: float) -> list[PeerReading]:
        """Everyone who was ever there, by their ids; of those who left the last `LARGEST_CROWD`."""
        before = self._monitor.peers
        for lost in self._monitor.tick(now):
            if len(self._gone) >= LARGEST_CROWD:
                del self._gone[next(iter(self._gone))]
            self._gone[lost.peer] = before[lost.peer], now - lost.silence
        here = {peer: (beat, self._monitor.heard(peer) or now) for peer, beat in self._monitor.peers.items()}
        told = sorted((self._gone | here).items(), key=lambda each: (each[0].system, each[0].component))
        return [
            PeerReading(
                sysid=peer.system,
                compid=peer.component,
                type=beat.type,
                state=beat.system_status,
                age=now - heard,
                there=peer in here,
            )
            for peer, (beat, heard) in told
        ]
