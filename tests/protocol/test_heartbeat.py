"""Heartbeats: seen once a second, missed after three."""

from __future__ import annotations

import math

import pytest

from robotree.protocol import Frame
from robotree.protocol.messages import Heartbeat, MavState, Timesync
from robotree.protocol.services.heartbeat import (
    MAX_PEERS,
    PERIOD,
    SILENCE,
    HeartbeatMonitor,
    HeartbeatSender,
    PeerFound,
    PeerLost,
)
from robotree.protocol.services.peer import Peer

BEAT = Heartbeat(0, 0, 0, 0, MavState.ACTIVE)
ARM = Peer("link 1", 1, 1)


def _frame(system: int = 1, component: int = 1, beat: Heartbeat = BEAT) -> Frame:
    return Frame.of(beat, system=system, component=component)


def test_the_first_heartbeat_goes_at_once_and_then_one_per_period() -> None:
    sender = HeartbeatSender()
    beats = [len(sender.tick(BEAT, i / 100)) for i in range(1001)]
    assert beats[0] == 1
    assert sum(beats) == 11


def test_a_late_tick_does_not_shift_the_beat_and_a_long_sleep_is_not_made_up_for() -> None:
    sender = HeartbeatSender()
    sender.tick(BEAT, 0.0)
    assert sender.tick(BEAT, 1.25) == [BEAT]
    assert sender.tick(BEAT, 1.9) == []
    assert sender.tick(BEAT, 2.0) == [BEAT]
    assert sender.tick(BEAT, 50.0) == [BEAT]
    assert sender.tick(BEAT, 50.0 + PERIOD / 4) == []


def test_a_change_of_state_does_not_wait_for_the_beat() -> None:
    sender = HeartbeatSender()
    sender.tick(BEAT, 0.0)
    sender.hurry()
    assert sender.tick(BEAT, 0.1) == [BEAT]
    assert sender.tick(BEAT, 0.2) == []


@pytest.mark.parametrize("patience", [0.6, 2.0, 3.0])
def test_who_must_hear_us_does_so_though_three_heartbeats_in_a_row_are_lost(patience: float) -> None:
    sender = HeartbeatSender()
    sender.tick(BEAT, 0.0)
    sender.keep(patience)
    beats = [0.0, *(i / 100 for i in range(1, 1001) if sender.tick(BEAT, i / 100))]
    assert max(later - earlier for earlier, later in zip(beats, beats[4:], strict=False)) < 0.9 * patience
    sender.keep(math.inf)
    assert len([i for i in range(1001, 2001) if sender.tick(BEAT, i / 100)]) in {10, 11}


def test_a_peer_is_found_by_its_heartbeat_and_kept_by_anything_it_says() -> None:
    monitor = HeartbeatMonitor()
    assert monitor.receive(Frame.of(Timesync(0, 1)), "link 1", 0.0) == []
    assert monitor.receive(_frame(), "link 1", 0.0) == [PeerFound(ARM, BEAT)]
    assert monitor.receive(_frame(), "link 1", 1.0) == []
    monitor.receive(Frame.of(Timesync(0, 1)), "link 1", 3.0)
    assert monitor.tick(1.0 + SILENCE) == []
    assert monitor.tick(3.0 + SILENCE) == [PeerLost(ARM, SILENCE)]
    assert monitor.tick(60.0) == []
    assert monitor.receive(_frame(), "link 1", 60.0) == [PeerFound(ARM, BEAT)]


def test_the_same_ids_on_two_links_are_two_peers() -> None:
    monitor = HeartbeatMonitor()
    monitor.receive(_frame(), "link 1", 0.0)
    found = monitor.receive(_frame(), "link 2", 0.0)
    assert found == [PeerFound(Peer("link 2", 1, 1), BEAT)]
    assert monitor.link_closed("link 1", 2.0) == [PeerLost(ARM, 2.0)]
    assert list(monitor.peers) == [Peer("link 2", 1, 1)]
    assert monitor.heard(ARM) is None
    assert monitor.heard(Peer("link 2", 1, 1)) == 0.0


def test_the_latest_heartbeat_is_what_is_known_of_a_peer() -> None:
    monitor = HeartbeatMonitor()
    worse = Heartbeat(0, 0, 0, 0, MavState.CRITICAL)
    monitor.receive(_frame(), "link 1", 0.0)
    monitor.receive(_frame(beat=worse), "link 1", 1.0)
    assert monitor.peers == {ARM: worse}


def test_forged_peers_do_not_fill_the_memory() -> None:
    monitor = HeartbeatMonitor()
    for i in range(MAX_PEERS + 100):
        monitor.receive(_frame(1 + i % 255, i // 255), "link 1", 0.0)
    assert len(monitor.peers) == MAX_PEERS
