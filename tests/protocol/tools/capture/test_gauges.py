"""The tables of a link tell what came, how often, and who is there."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Parser, encode
from robotree.protocol.messages import (
    AnyMessage,
    Gripper,
    Heartbeat,
    MavState,
    MavType,
    NamedValueFloat,
    Timesync,
    make,
)
from robotree.protocol.services.heartbeat import SILENCE
from robotree.protocol.services.ping import summary
from robotree.protocol.tools.capture.gauges import MAX_ENTRIES, MAX_PEERS, LinkGauge, PeerReading, Rate


def speaker(system: int = 1) -> Callable[[AnyMessage], bytes]:
    sequence = -1

    def speak(message: AnyMessage) -> bytes:
        nonlocal sequence
        sequence += 1
        return encode(message, sequence=sequence, system=system, component=1)

    return speak


def named(name: str, value: float) -> NamedValueFloat:
    return NamedValueFloat(time_boot_ms=0, name=name, value=value)


def test_a_row_tells_rate_age_and_last_value() -> None:
    gauge, say = LinkGauge("tcp:arm"), speaker()
    for step in range(100):
        gauge.receive(say(named("lever", step)), step * 0.05)
    (row,) = gauge.reading(5.2).messages
    assert (row.name, row.count, row.fields["value"]) == ("NAMED_VALUE_FLOAT", 100, 99.0)
    assert row.rate == pytest.approx(17.5, abs=1)  # it has been silent for a quarter of a second
    assert row.age == pytest.approx(0.25)


def test_a_link_that_has_only_just_begun_is_not_slow() -> None:
    gauge, say = LinkGauge("tcp:arm"), speaker()
    for step in range(10):
        gauge.receive(say(named("lever", step)), 10.05 + step * 0.05)
    assert gauge.reading(10.5).frames_per_second == pytest.approx(20)


def test_a_rate_is_that_of_whole_intervals() -> None:
    gauge, say = LinkGauge("tcp:arm"), speaker()
    assert gauge.reading(99.0).frames_per_second == 0.0, "nobody speaks"
    beat = Gripper(time_boot_ms=0, width=0, commanded=0, force=0, state=0)
    told: list[float | None] = []
    for step in range(5):
        gauge.receive(say(beat), 100.01 + step)
        reading = gauge.reading(100.5 + step)
        assert reading.messages[0].rate == reading.frames_per_second
        told.append(reading.messages[0].rate)
    assert told == [None, *[pytest.approx(1.0)] * 4], "one alone does not tell how often it comes"
    assert gauge.reading(104.99).messages[0].rate == pytest.approx(1.0)
    assert gauge.reading(106.0).messages[0].rate == pytest.approx(2 / 2.99), "a silence has begun"
    assert gauge.reading(106.02).messages[0].rate == 0.0


def test_what_comes_seldom_has_a_rate_and_what_comes_together_is_one_arrival() -> None:
    rate = Rate()
    for moment in (0.0, 3.0, 6.0):
        for _ in range(10):
            rate.add(moment, 2)
    assert [rate.per_second(now) for now in (6.0, 8.9)] == [pytest.approx(20 / 3)] * 2


def test_named_values_have_rows_of_their_own() -> None:
    gauge, say = LinkGauge("tcp:arm"), speaker()
    gauge.receive(
        say(named("lever", 1)) + say(named("peak_f", 2)) + say(make("NAMED_VALUE_INT", name="n")), 0
    )
    assert [row.fields["name"] for row in gauge.reading(1).messages] == ["lever", "peak_f", "n"]


def test_a_frame_that_never_came_is_a_loss() -> None:
    gauge, say = LinkGauge("tcp:arm"), speaker()
    for step in range(20):
        frame = say(named("lever", step))
        if step not in (4, 9):
            gauge.receive(frame, step / 20)
    reading = gauge.reading(1.0)
    assert (reading.lost, reading.loss) == (2, pytest.approx(0.1))
    assert gauge.reading(4.0).loss == 0  # that was long ago


def test_the_delay_is_half_of_the_way_there_and_back() -> None:
    gauge, say = LinkGauge("tcp:arm"), speaker()
    (question,) = gauge.questions(1.0)
    assert gauge.reading(1.0).delay is None
    gauge.receive(say(Timesync(tc1=51_000_000_000, ts1=question.ts1)), 1.008)
    reading = gauge.reading(1.1)
    assert reading.delay == pytest.approx(0.004)
    assert reading.offset == pytest.approx(49.996)


@given(st.lists(st.binary(max_size=400), max_size=20))
def test_nothing_that_comes_raises(pieces: list[bytes]) -> None:
    gauge = LinkGauge("tcp:arm")
    for now, piece in enumerate(pieces):
        gauge.receive(piece, now)
    reading = gauge.reading(len(pieces))
    assert reading.frames + reading.skipped <= sum(map(len, pieces))


def test_a_crowd_of_forged_speakers_does_not_fill_the_memory() -> None:
    gauge = LinkGauge("tcp:arm")
    message = Gripper(time_boot_ms=0, width=0, commanded=0, force=0, state=0)
    for number in range(2 * MAX_ENTRIES):
        raw = encode(message, sequence=0, system=1 + number % 255, component=number // 255)
        gauge.receive(raw, 0)
    assert len(gauge.reading(1).messages) == MAX_ENTRIES
    assert gauge.reading(1).frames == 2 * MAX_ENTRIES == len(Parser().feed(raw)) * 2 * MAX_ENTRIES


def test_a_rate_of_very_many_is_taken_over_a_shorter_time() -> None:
    rate = Rate()
    for step in range(20_000):
        rate.add(step * 1e-4, 3)
    assert rate.per_second(2.0) == pytest.approx(30_000, rel=0.01)


def test_trips_are_told_by_their_order() -> None:
    trips = summary(200, [0.001 * n for n in range(100, 0, -1)])
    assert (trips.answered, trips.loss) == (100, 0.5)
    told = (trips.shortest, trips.median, trips.late, trips.longest)
    assert told == pytest.approx((0.001, 0.051, 0.1, 0.1))
    assert summary(3, []).median is None


ROVER = Heartbeat(MavType.GROUND_ROVER, 0, 0, 0, MavState.ACTIVE)


def say(message: AnyMessage, system: int = 1, component: int = 1) -> bytes:
    return encode(message, sequence=0, system=system, component=component)


def test_who_falls_silent_is_gone_and_who_speaks_again_is_there() -> None:
    gauge = LinkGauge("tcp:far")
    gauge.receive(say(ROVER) + say(ROVER, 2), 1.0)
    gauge.receive(say(Timesync(0, 1)), 3.0)
    rover = PeerReading(1, 1, MavType.GROUND_ROVER, MavState.ACTIVE, 1.5, there=True)
    gone = PeerReading(2, 1, MavType.GROUND_ROVER, MavState.ACTIVE, 3.5, there=False)
    assert gauge.reading(4.5).peers == [rover, gone]
    gauge.receive(say(Timesync(0, 1), 2), 5.0)
    assert [peer.there for peer in gauge.reading(5.0).peers] == [True, False], "it has yet to say who it is"
    gauge.receive(say(ROVER, 2), 5.5)
    assert [peer.there for peer in gauge.reading(5.5).peers] == [True, True]


def test_the_latest_heartbeat_counts() -> None:
    gauge = LinkGauge("tcp:far")
    for state in (MavState.BOOT, MavState.CRITICAL):
        gauge.receive(say(Heartbeat(0, 0, 0, 0, state)), 1.0)
    (peer,) = gauge.reading(1.0).peers
    assert peer.state == MavState.CRITICAL


def test_forged_peers_that_come_and_go_do_not_fill_the_memory() -> None:
    gauge = LinkGauge("tcp:far")
    for wave in range(3):
        now = wave * 2 * SILENCE
        crowd = (divmod(wave * MAX_PEERS + i, 255) for i in range(MAX_PEERS))
        gauge.receive(b"".join(say(ROVER, 1 + system, component) for component, system in crowd), now)
        peers = gauge.reading(now + SILENCE).peers
        assert len(peers) == MAX_PEERS
        assert not any(peer.there for peer in peers)
