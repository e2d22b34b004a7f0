"""Any bytes are decoded as far as they go, within a bound of memory, and everything is counted."""

from __future__ import annotations

import json
import math
import random
import tracemalloc
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import encode
from robotree.protocol.frame import Frame
from robotree.protocol.messages import Gripper, NamedValueFloat, Timesync, make
from robotree.protocol.signing import Key, Signer, SigningTime, StreamTable, Verifier
from robotree.protocol.tools.capture import BadRecording, Captured, Decoder, Recording, tlog
from robotree.protocol.tools.capture.decode import MAX_ENTRIES, READERS
from robotree.protocol.tools.capture.replay import LONGEST_GAP, schedule

NOISE = 2_000_000
"""[bytes]"""
NOON = 1_700_000_000_000_000
PIECE = 64 * 1024
GRIP = Gripper(time_boot_ms=0, width=0, commanded=0, force=0, state=0)


@pytest.mark.parametrize("form", READERS)
def test_two_million_bytes_of_noise_raise_nothing_and_are_not_kept(form: str) -> None:
    chance, decoder = random.Random(1), Decoder(form)
    tracemalloc.start()
    try:
        for _ in range(0, NOISE, PIECE):
            decoder.feed(chance.randbytes(PIECE))
        decoder.flush()
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 4_000_000
    statistics = decoder.statistics
    assert statistics.frames == 0
    assert form == "candump" or statistics.skipped == statistics.bytes


@given(form=st.sampled_from(sorted(READERS)), pieces=st.lists(st.binary(max_size=200), max_size=20))
def test_nothing_raises(form: str, pieces: list[bytes]) -> None:
    decoder = Decoder(form)
    for piece in pieces:
        decoder.feed(piece)
    decoder.flush()
    assert decoder.statistics.bytes == sum(map(len, pieces))
    assert msgspec.json.encode(decoder.statistics)


def test_a_frame_as_plain_data_is_json_whatever_its_numbers_are() -> None:
    raw = encode(NamedValueFloat(time_boot_ms=1, name="x", value=math.nan), sequence=9, system=3, component=4)
    raw += encode(make("BATTERY_STATUS", temperature=-5), sequence=10, system=3, component=4)
    raw += encode(make("ENCAPSULATED_DATA", seqnr=1, data=b"\x00\xff"), sequence=11, system=3, component=4)
    objects = [json.loads(msgspec.json.encode(one.plain())) for one in Decoder("raw").feed(raw)]
    first, second, third = objects
    assert first == {
        "msgid": 251,
        "name": "NAMED_VALUE_FLOAT",
        "sysid": 3,
        "compid": 4,
        "seq": 9,
        "fields": {"time_boot_ms": 1, "value": None, "name": "x"},
        "signed": False,
    }
    assert second["fields"]["temperature"] == -5
    assert third["fields"]["data"][:3] == [0, 255, 0]


def test_signed_frames_are_told_and_can_be_verified() -> None:
    now = [1_700_000_000.0]
    key = Key(bytes(range(32)))
    signer = Signer(key, SigningTime(lambda: now[0]))
    good = encode(GRIP, sequence=0, system=1, component=1, signer=signer)
    forged = good[:-1] + bytes((good[-1] ^ 1,))
    (one,) = Decoder("raw").feed(good)
    assert one.plain()["signed"]
    decoder = Decoder("raw", verifier=Verifier(key, SigningTime(lambda: now[0]), StreamTable()))
    assert len(decoder.feed(good + forged)) == 1
    assert (decoder.statistics.signed, decoder.statistics.refused) == (1, 1)


def test_a_crowd_of_forged_speakers_does_not_fill_the_memory() -> None:
    decoder = Decoder("raw")
    for number in range(2 * MAX_ENTRIES):
        decoder.feed(encode(GRIP, sequence=0, system=1 + number % 255, component=number // 255))
    speakers = decoder.statistics.speakers
    assert len(speakers) == MAX_ENTRIES + 1
    assert sum(speakers.values()) == 2 * MAX_ENTRIES


def test_a_file_that_is_not_there_and_a_format_that_is_none_are_told_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(BadRecording, match="No such file"):
        Recording(str(tmp_path / "missing.tlog"))
    (tmp_path / "some.raw").write_bytes(Frame.of(GRIP).raw)
    with pytest.raises(BadRecording, match="there is raw, tlog, mcap, candump"):
        Recording(str(tmp_path / "some.raw"), "pcap")


def test_a_short_file_is_read_too(tmp_path: Path) -> None:
    for data in (b"", b"\xfd", b"(1"):
        (tmp_path / "short").write_bytes(data)
        recording = Recording(str(tmp_path / "short"))
        assert [one for batch in recording.frames() for one in batch] == []
        assert recording.statistics.bytes == len(data)


times = st.lists(st.integers(0, 10**9) | st.none(), max_size=30)


@given(times=times, speed=st.sampled_from([0.5, 1.0, 10.0, math.inf]))
def test_a_replay_never_goes_back_and_keeps_every_record(times: list[int | None], speed: float) -> None:
    records = [Captured(bytes((n,)), time) for n, time in enumerate(times)]
    moments = [*schedule(records, speed)]
    assert [data for _, data in moments] == [record.data for record in records]
    due = [moment for moment, _ in moments]
    assert due == sorted(due)


def test_a_replay_keeps_the_recording_s_time_divided_by_the_speed() -> None:
    records = [Captured(b"", time) for time in (5_000_000, 5_500_000, 4_000_000, 4_250_000)]
    assert [due for due, _ in schedule(records, 2.0)] == [0.0, 0.25, 0.25, 0.375]
    assert [due for due, _ in schedule(records, math.inf)] == [0.0] * 4


def test_a_flipped_bit_in_a_time_is_damage_and_the_frame_is_kept() -> None:
    raw = [encode(Timesync(n, 0), sequence=n, system=1, component=1) for n in range(9)]
    for bit in (53, 55, 62, 63):
        data = bytearray(b"".join(tlog.encode(NOON + 1000 * n, one) for n, one in enumerate(raw)))
        data[4 * (8 + len(raw[0])) + 7 - bit // 8] ^= 1 << bit % 8
        decoder = Decoder("tlog")
        found = decoder.feed(bytes(data)) + decoder.flush()
        assert [one.frame.sequence for one in found] == [*range(9)]
        assert [n for n, one in enumerate(found) if one.time is None] == [4]
        statistics = decoder.statistics
        assert statistics.bad_times == 1
        assert (statistics.first, statistics.last) == (NOON / 1e6, (NOON + 8000) / 1e6)


@given(bit=st.integers(0, 63), number=st.integers(0, 9))
def test_a_flipped_bit_in_a_time_delays_a_replay_by_no_more_than_a_gap(bit: int, number: int) -> None:
    times = [NOON + 1_000_000 * n for n in range(10)]
    times[number] ^= 1 << bit
    moments = [due for due, _ in schedule([Captured(b"", time) for time in times])]
    assert moments == sorted(moments)
    assert moments[-1] <= 10 + LONGEST_GAP / 1e6
    assert moments[-1] >= 8 - (1 if number in {0, 9} else 0) - 1
