"""Set-points: a stream that dries up ends, and what comes late does not move anything."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robotree.protocol import Frame
from robotree.protocol.messages import Setpoint, SetpointKind
from robotree.protocol.services.goal_server import GoalServer
from robotree.protocol.services.setpoint import LONGEST_TTL, MAX_PEERS, PAUSE, SetpointReceiver

TURN = 2**32
"""[ms] after which the time on the wire begins anew."""
POSE = (0.5, 0.0, 0.3, 0.0, math.nan, math.nan, math.nan)


def _setpoint(
    number: int = 1,
    *,
    made: float = 0.0,
    ttl: float = 0.2,
    epoch: int = 1,
    kind: int = SetpointKind.TOOL_POSE,
    args: tuple[float, ...] = POSE,
) -> Setpoint:
    return Setpoint(round(made * 1000) % TURN, epoch, number, args, round(ttl * 1000), 1, 1, kind)


@pytest.fixture
def receiver() -> SetpointReceiver:
    return SetpointReceiver([SetpointKind.TOOL_POSE], GoalServer([], lambda _: None).fence)


def test_a_set_point_is_followed_for_its_time_to_live(receiver: SetpointReceiver) -> None:
    assert receiver.active(0.0) is None
    setpoint = _setpoint(ttl=0.2)
    assert receiver.receive(setpoint, 10.0)
    assert receiver.active(10.19) == setpoint
    assert receiver.active(10.2) is None
    assert receiver.active(10.1) is None, "what has ended does not come back"


def test_a_sender_that_dies_moves_nothing_for_longer_than_it_said(receiver: SetpointReceiver) -> None:
    for i in range(10):
        receiver.receive(_setpoint(i, ttl=0.1), i * 0.05)
    assert receiver.active(0.54) is not None
    assert receiver.active(0.56) is None


@given(delay=st.floats(0.0, 5.0), ttl=st.floats(0.01, 1.5))
def test_a_delay_in_a_queue_counts_against_the_time_to_live(delay: float, ttl: float) -> None:
    receiver = SetpointReceiver([SetpointKind.TOOL_POSE], lambda _: True)
    made = 100.0
    setpoint = _setpoint(made=made, ttl=ttl)
    lives_until = made + setpoint.ttl_ms / 1000
    assert receiver.receive(setpoint, made + delay) == (made + delay < lives_until)
    assert receiver.active(max(lives_until, made + delay)) is None
    assert receiver.statistics.late == (made + delay >= lives_until)


@given(up=st.integers(0, 5 * TURN), age=st.integers(-3000, 3000), ttl=st.integers(1, 2500))
@example(up=TURN + 100, age=199, ttl=200)
@example(up=TURN + 100, age=201, ttl=200)
@example(up=TURN - 100, age=-101, ttl=200)
def test_a_set_point_is_as_old_as_the_wire_says_however_often_its_time_began_anew(
    up: int, age: int, ttl: int
) -> None:
    receiver = SetpointReceiver([SetpointKind.TOOL_POSE], lambda _: True)
    lives = min(ttl, round(1000 * LONGEST_TTL))
    assume((up - age) % TURN and age not in {lives, -1000 * LONGEST_TTL})
    obeyed = receiver.receive(_setpoint(made=(up - age) / 1000, ttl=ttl / 1000), up / 1000)
    assert obeyed == (-1000 * LONGEST_TTL < age < lives)
    left = lives - max(age, 0)
    assert (receiver.active((up + left - 1) / 1000) is not None) == obeyed
    assert receiver.active((up + left + 1) / 1000) is None


def test_who_does_not_say_when_it_made_a_set_point_made_it_when_it_arrived(
    receiver: SetpointReceiver,
) -> None:
    assert not receiver.receive(_setpoint(1, ttl=0.2), 10.3, arrived=10.1)
    assert receiver.statistics.late == 1
    assert receiver.receive(_setpoint(2, ttl=0.2), 10.25, arrived=10.1)
    assert receiver.active(10.29) is not None
    assert receiver.active(10.3) is None


def test_a_time_from_the_far_future_is_not_believed(receiver: SetpointReceiver) -> None:
    assert not receiver.receive(_setpoint(made=50.0), 10.0)
    assert receiver.statistics.late == 1


def test_no_set_point_lives_longer_than_the_longest(receiver: SetpointReceiver) -> None:
    assert receiver.receive(_setpoint(ttl=60.0), 10.0)
    assert receiver.active(10.0 + LONGEST_TTL) is None


def test_one_that_was_overtaken_is_dropped(receiver: SetpointReceiver) -> None:
    assert receiver.receive(_setpoint(5), 0.0)
    assert not receiver.receive(_setpoint(4), 0.0)
    assert not receiver.receive(_setpoint(5), 0.0)
    assert receiver.receive(_setpoint(6), 0.0)
    assert receiver.statistics.overtaken == 2


def test_a_sender_that_counts_anew_without_a_pause_is_obeyed_when_none_could_be_for_a_pause(
    receiver: SetpointReceiver,
) -> None:
    for i in range(1, 51):
        assert receiver.receive(_setpoint(1000 + i), i * 0.1, "pilot")
    again = [receiver.receive(_setpoint(i), 5.0 + i * 0.1, "pilot") for i in range(1, 51)]
    assert again == [i * 0.1 >= PAUSE for i in range(1, 51)]
    assert receiver.statistics.overtaken == again.count(False)


def test_what_was_overtaken_does_not_disturb_a_stream_however_long_it_keeps_coming(
    receiver: SetpointReceiver,
) -> None:
    for i in range(1, 200):
        assert receiver.receive(_setpoint(1000 + i), i * 0.1, "pilot")
        assert not receiver.receive(_setpoint(i), i * 0.1 + 0.05, "pilot")


@pytest.mark.parametrize("ttl", [0.2, LONGEST_TTL])
def test_a_late_flood_of_old_set_points_moves_nothing(receiver: SetpointReceiver, ttl: float) -> None:
    for i in range(1, 51):
        assert receiver.receive(_setpoint(i, made=i * 0.1, ttl=ttl), i * 0.1, "pilot")
    for i in range(1, 51):
        assert not receiver.receive(_setpoint(i, made=i * 0.1, ttl=ttl), 5.0 + i * 0.1, "pilot")
    assert receiver.active(5.0 + ttl) is None


def test_a_stream_that_was_ended_while_it_was_overtaken_stays_ended(receiver: SetpointReceiver) -> None:
    assert receiver.receive(_setpoint(1000), 0.0, "pilot")
    for i in range(1, 20):
        assert not receiver.receive(_setpoint(i), i * 0.1, "pilot")
    receiver.drop()
    assert not receiver.receive(_setpoint(20), 2.05, "pilot")
    assert receiver.statistics.ended == 1


def test_numbers_may_wrap(receiver: SetpointReceiver) -> None:
    assert receiver.receive(_setpoint(2**32 - 1), 0.0)
    assert receiver.receive(_setpoint(0), 0.0)


def test_a_new_lease_counts_anew_and_the_old_one_is_over(receiver: SetpointReceiver) -> None:
    assert receiver.receive(_setpoint(500, epoch=1), 0.0)
    assert receiver.receive(_setpoint(1, epoch=2), 0.0)
    assert not receiver.receive(_setpoint(501, epoch=1), 0.0)
    assert receiver.statistics.stale == 1


@pytest.mark.parametrize(
    "setpoint",
    [
        _setpoint(kind=SetpointKind.JOINTS),
        _setpoint(kind=99),
        _setpoint(ttl=0.0),
        _setpoint(args=(math.inf,) * 7),
    ],
)
def test_what_makes_no_sense_is_refused_and_obeys_no_epoch(setpoint: Setpoint) -> None:
    epochs: list[int] = []
    receiver = SetpointReceiver([SetpointKind.TOOL_POSE], lambda epoch: bool(epochs.append(epoch)) or True)
    assert not receiver.receive(setpoint, 0.0)
    assert receiver.statistics.refused == 1
    assert epochs == []


def test_a_stop_ends_the_stream(receiver: SetpointReceiver) -> None:
    receiver.receive(_setpoint(1), 0.0)
    receiver.drop()
    assert receiver.active(0.0) is None
    assert receiver.statistics.obeyed == 1


def test_a_stream_that_was_ended_stays_ended_until_its_sender_pauses(receiver: SetpointReceiver) -> None:
    receiver.receive(_setpoint(1), 0.0, "pilot")
    receiver.drop()
    for i in range(2, 100):
        assert not receiver.receive(_setpoint(i), i * 0.1, "pilot")
    assert receiver.statistics.ended == 98
    assert receiver.receive(_setpoint(1), 9.9 + PAUSE, "pilot"), "after a pause it is a new stream"


def test_who_streams_while_a_goal_runs_is_not_obeyed_when_it_ends(receiver: SetpointReceiver) -> None:
    for i in range(1, 50):
        receiver.refuse(_setpoint(i), i * 0.1, "pilot", over=True)
    assert not receiver.receive(_setpoint(50), 5.0, "pilot")
    assert not receiver.receive(_setpoint(51), 6.9, "pilot")
    assert receiver.receive(_setpoint(52), 6.9 + PAUSE, "pilot")


def test_a_straggler_of_an_older_lease_does_not_bring_an_ended_stream_back(
    receiver: SetpointReceiver,
) -> None:
    receiver.refuse(_setpoint(7, epoch=2), 0.0, "pilot", over=True)
    receiver.refuse(_setpoint(900, epoch=1), 0.05, "pilot", over=True)
    assert not receiver.receive(_setpoint(8, epoch=2), 0.1, "pilot")
    receiver.refuse(_setpoint(901, epoch=1), 0.1 + PAUSE, "pilot", over=True)
    assert receiver.receive(_setpoint(9, epoch=2), 0.2 + PAUSE, "pilot"), "it has paused meanwhile"


def test_ended_streams_of_many_senders_cost_bounded_memory(receiver: SetpointReceiver) -> None:
    for sender in range(10_000):
        receiver.refuse(_setpoint(1), 0.0, sender, over=True)
    assert len(receiver._shut_out) == MAX_PEERS


def test_a_newer_epoch_begins_a_new_stream_at_once(receiver: SetpointReceiver) -> None:
    receiver.receive(_setpoint(1), 0.0, "pilot")
    receiver.drop()
    assert receiver.receive(_setpoint(2, epoch=2), 0.1, "pilot")


def test_two_senders_of_one_epoch_are_not_mixed(receiver: SetpointReceiver) -> None:
    assert receiver.receive(_setpoint(500, ttl=0.2), 0.0, "first")
    assert not receiver.receive(_setpoint(1), 0.1, "second")
    assert receiver.statistics.ended == 1
    assert receiver.receive(_setpoint(2), 0.3, "second"), "the first one has dried up"


def test_a_set_point_fits_one_can_fd_frame() -> None:
    assert len(Frame.of(_setpoint(2**32 - 1, epoch=2**32 - 1, made=4e6)).raw) <= 62
