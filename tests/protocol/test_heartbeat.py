"""Heartbeats: one a second, and oftener for who bears less silence."""

from __future__ import annotations

import math

import pytest

from robotree.protocol.messages import Heartbeat, MavState
from robotree.protocol.services.heartbeat import (
    PERIOD,
    HeartbeatSender,
)

BEAT = Heartbeat(0, 0, 0, 0, MavState.ACTIVE)


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
