"""The measurements measure what they say; whether the promises hold here `python -m bench.wire` tells."""

from __future__ import annotations

import time
from types import ModuleType

import pytest

from bench.wire import codec
from bench.wire.figures import CODEC, FIGURES, Figure, Promise, chance_bytes, recovery
from bench.wire.round_trips import compare
from robotree.protocol.testing import check_codec


def test_a_promise_is_kept_on_the_right_side_of_its_bound() -> None:
    fast, small = Promise("fast", 3.0, at_least=True), Promise("small", 3.0, at_least=False)
    assert Figure(fast, 3.0).kept
    assert not Figure(fast, 2.9).kept
    assert Figure(small, 3.0).kept
    assert not Figure(small, 3.1).kept
    assert not Figure(small, float("nan")).kept


def test_every_codec_promise_is_measured_on_40_bytes(oracle: ModuleType) -> None:
    message = codec.telemetry_40()
    assert message.codec.length == 40
    found = [each for signed in (False, True) for each in codec.contests(message, oracle, signed=signed)]
    assert {*CODEC} <= {each.name for each in found}
    for each in found:
        outcome = codec.compare(each, rounds=2)
        assert outcome.ours > 0
        assert outcome.ratio == outcome.theirs / outcome.ours


@pytest.mark.speed
def test_a_reference_that_was_disturbed_makes_the_figure_unsure_and_not_better() -> None:
    turns = {"ours": 0, "theirs": 0}

    def work(side: str, *, disturbed: bool) -> None:
        turns[side] += 1
        end = time.perf_counter() + (0.004 if disturbed and turns[side] % 4 else 0.001)
        while time.perf_counter() < end:
            pass

    quiet = codec.Contest("quiet", lambda: work("ours", disturbed=False), lambda: None)
    busy = codec.Contest(
        "busy", lambda: work("ours", disturbed=False), lambda: work("theirs", disturbed=True)
    )
    outcome = codec.compare(busy, rounds=12)
    assert outcome.ratio == pytest.approx(1, rel=0.3)
    assert not outcome.sure
    assert codec.compare(quiet, rounds=1).sure


def test_both_sides_of_a_contest_do_the_same(oracle: ModuleType) -> None:
    for message in codec.messages():
        values = [getattr(message, field.name) for field in message.codec.definition.fields]
        theirs = oracle.mavlink_map[message.codec.definition.id](*values)
        frames, *_ = (contest.ours() for contest in codec.contests(message, oracle, signed=False)[1:2])
        raw = [frame.raw for frame in frames]  # type: ignore[attr-defined]  # this contest hands out frames
        speaker = codec.speaker(oracle, signed=False)
        assert len(raw) == codec.BATCH
        for number, packed in enumerate(raw):
            speaker.seq = number
            assert bytes(theirs.pack(speaker)) == packed


def test_the_reference_is_what_the_codec_is_compared_with(oracle: ModuleType) -> None:
    assert check_codec(codec.encoder(oracle), rounds=1) == len(oracle.mavlink_map)


def test_a_bad_stream_gives_back_all_that_is_whole_in_it() -> None:
    saved = recovery(frames=2000, share=0.1, seed=3)
    assert 1700 <= saved.intact <= 1900
    assert (saved.found, saved.invented) == (saved.intact, 0)


def test_bytes_of_chance_are_accounted_for() -> None:
    assert chance_bytes(300_001, seed=3) == 300_001


async def test_round_trips_take_turns_with_a_bare_echo() -> None:
    bare, *others = await compare(rounds=3, turn=2)
    assert (bare.name, bare.ratio) == ("bare asyncio echo", 1.0)
    assert [way.name for way in others] == ["PING over TCP", "PING over CAN FD", "PING over classic CAN"]
    assert all(0 < way.median < 1 for way in (bare, *others))


def test_every_part_has_a_name_and_the_promises_are_the_project_s() -> None:
    assert [*FIGURES] == ["codec", "trips", "noise"]
    assert {name: promise.bound for name, promise in CODEC.items()} == {
        "encode": 3.5,
        "decode to frames": 7.0,
        "encode signed": 2.5,
        "decode signed to frames": 3.5,
    }
