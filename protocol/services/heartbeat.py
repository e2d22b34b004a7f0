"""Heartbeats: send one each second, and notice peers that are silent."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Heartbeat
from robotree.protocol.services.peer import Peer

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.frame import Frame

PERIOD = 1.0
"""[s]"""
SILENCE = 3.0
"""[s]: three heartbeats."""
BEATS = 5
"""Heartbeats in the silence that the far end bears while it must hear us: three in a row may be lost."""
MAX_PEERS = 1024
"""Peers that are remembered; a forged stream must not fill the memory."""


class HeartbeatSender:
    """Says when the next heartbeat is due; the first one at once."""

    def __init__(self) -> None:
        self.period = PERIOD
        """Between two heartbeats, [s]."""
        self.due = float("-inf")
        """When to call `tick` again, [s]."""

    def tick(self, heartbeat: Heartbeat, now: float) -> list[Heartbeat]:
        """The heartbeat to send now, if it is time."""
        if now < self.due:
            return []
        late = now - self.due
        self.due = now + self.period - (late if late < self.period / 2 else 0.0)
        return [heartbeat]

    def keep(self, patience: float) -> None:
        """From the last heartbeat on, beat often enough for who bears a silence of `patience` [s] at most."""
        period = min(PERIOD, patience / BEATS)
        self.due += period - self.period
        self.period = period

    def due_for(self, patience: float) -> float:
        """When to call `tick` again [s], after `keep` with the same patience [s]."""
        return self.due + min(PERIOD, patience / BEATS) - self.period

    def hurry(self) -> None:
        """The state changed: the next `tick` sends."""
        self.due = float("-inf")


class PeerFound(msgspec.Struct, frozen=True):
    """A peer was heard for the first time, or again after silence."""

    peer: Peer
    heartbeat: Heartbeat


class PeerLost(msgspec.Struct, frozen=True):
    """Nothing was heard from a peer for too long, or its link ended."""

    peer: Peer
    silence: float
    """[s]"""


class HeartbeatMonitor:
    """The peers that are present. Any frame is a sign of life, but only a heartbeat introduces a peer.

    A peer counts as lost after SILENCE seconds without a sign of life.
    """

    def __init__(self) -> None:
        self._heard: dict[Peer, float] = {}
        self._heartbeats: dict[Peer, Heartbeat] = {}

    @property
    def peers(self) -> dict[Peer, Heartbeat]:
        """Everyone who is there, with their latest heartbeat."""
        return dict(self._heartbeats)

    def heard(self, peer: Peer) -> float | None:
        """When a peer gave its last sign of life, [s]; None: it is not there."""
        return self._heard.get(peer)

    def receive(self, frame: Frame, via: Hashable, now: float) -> list[PeerFound]:
        """Note a sign of life."""
        peer = Peer(via, frame.system, frame.component)
        known = peer in self._heard
        if isinstance(frame.message, Heartbeat) and (known or len(self._heard) < MAX_PEERS):
            self._heartbeats[peer] = frame.message
            self._heard[peer] = now
            return [] if known else [PeerFound(peer, frame.message)]
        if known:
            self._heard[peer] = now
        return []

    def tick(self, now: float) -> list[PeerLost]:
        """Return the peers that have fallen silent."""
        return self._lose([peer for peer, heard in self._heard.items() if now - heard >= SILENCE], now)

    def link_closed(self, via: Hashable, now: float) -> list[PeerLost]:
        """A link ended, and with it everyone who was heard on it."""
        return self._lose([peer for peer in self._heard if peer.via == via], now)

    def _lose(self, peers: list[Peer], now: float) -> list[PeerLost]:
        for peer in peers:
            del self._heartbeats[peer]
        return [PeerLost(peer, now - self._heard.pop(peer)) for peer in peers]
