"""A torn, garbled or malicious stream never raises and never loses an intact frame."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest
from fastcrc.crc16 import mcrf4xx
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol import Frame, Parser, encode
from robotree.protocol.dialect import by_name, definitions
from robotree.protocol.frame import CRC_START, CRC_START_V1, LARGEST_FRAME
from robotree.protocol.messages import (
    AnyMessage,
    Gripper,
    Heartbeat,
    Joints,
    Statustext,
    Tool,
    fields_of,
    make,
)
from robotree.protocol.messages.base import codec_of

if TYPE_CHECKING:
    from types import ModuleType

UNHEARD_OF = next(msgid for msgid in range(256) if msgid not in definitions())
"""An id that MAVLink 1 could have, and no message has."""
GRIPPER = Gripper(1, 0.5, 0.25, 1.0, 2)


def _frame(message: AnyMessage = GRIPPER, sequence: int = 0, system: int = 1) -> bytes:
    return encode(message, sequence=sequence, system=system, component=1)


def _telemetry(count: int, chance: random.Random) -> list[bytes]:
    kinds: list[AnyMessage] = [
        Heartbeat(0, 0, 0, 0, 4),
        Joints(7, (chance.random(),) * 8, 6),
        Tool(7, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (32767, 0, 0, 0), 0),
        Statustext(6, "x" * 50),
        make("ATTITUDE", roll=chance.random()),
    ]
    return [_frame(chance.choice(kinds), sequence) for sequence in range(count)]


def _in_pieces(stream: bytes, chance: random.Random, largest: int) -> list[bytes]:
    pieces, i = list[bytes](), 0
    while i < len(stream):
        size = chance.randint(1, largest)
        pieces.append(stream[i : i + size])
        i += size
    return pieces


@pytest.mark.parametrize("largest", [1, 7, 300, 5000])
def test_a_stream_may_be_torn_anywhere(largest: int) -> None:
    chance = random.Random(largest)
    frames, parser = _telemetry(200, chance), Parser()
    read = [frame for piece in _in_pieces(b"".join(frames), chance, largest) for frame in parser.feed(piece)]
    assert [frame.raw for frame in read] == frames
    assert parser.statistics.received == 200
    assert parser.statistics.skipped == parser.statistics.lost == parser.statistics.late == 0


@pytest.mark.parametrize("seed", range(5))
def test_corruption_and_noise_cost_no_intact_frame(seed: int) -> None:
    """10 % of the frames are corrupted, and 10 % are followed by a burst of noise."""
    chance, stream, intact = random.Random(seed), bytearray(), list[bytes]()
    for frame in _telemetry(1500, chance):
        if chance.random() < 0.1:
            broken = bytearray(frame)
            broken[chance.randrange(len(frame))] ^= 1 << chance.randrange(8)
            stream += broken
        else:
            intact.append(frame)
            stream += frame
        if chance.random() < 0.1:
            stream += chance.randbytes(chance.randrange(1, 80))
    parser = Parser()
    read = [frame for piece in _in_pieces(bytes(stream), chance, 400) for frame in parser.feed(piece)]
    read += parser.flush()
    assert [frame.raw for frame in read] == intact
    statistics = parser.statistics
    assert statistics.bytes == len(stream)
    assert statistics.skipped == len(stream) - sum(map(len, intact))
    assert statistics.bad_crc > 100


@given(
    st.lists(st.one_of(st.binary(max_size=40), st.sampled_from([b"\xfd", b"\xfe", _frame(), _frame()[:-1]])))
)
def test_any_bytes_are_accounted_for(pieces: list[bytes]) -> None:
    parser = Parser()
    read = [frame for piece in pieces for frame in parser.feed(piece)] + parser.flush()
    statistics = parser.statistics
    assert statistics.received == len(read)
    assert statistics.bytes == sum(map(len, pieces))
    assert statistics.skipped + sum(len(frame.raw) for frame in read) == statistics.bytes


@given(before=st.binary(max_size=300), after=st.binary(max_size=300))
def test_an_intact_frame_survives_any_surroundings(before: bytes, after: bytes) -> None:
    """Unless the noise before it happens to be the beginning of a frame with a matching checksum."""
    parser = Parser()
    read = parser.feed(before + _frame() + after) + parser.flush()
    assert _frame() in [frame.raw for frame in read]


def test_ten_million_random_bytes_raise_nothing() -> None:
    parser, chance = Parser(), random.Random(1)
    for _ in range(160):
        parser.feed(chance.randbytes(65536))
    statistics = parser.statistics
    assert statistics.bytes == 160 * 65536
    assert statistics.unknown > 1000
    assert statistics.received < 10


@pytest.mark.parametrize("unit", [b"\xfd", b"\xfe", b"\xfd\xff\x00\x00\x00\x01\x01\x41\xe1\x00", b"\xfe\xff"])
def test_a_stream_made_to_hurt_costs_no_memory(unit: bytes) -> None:
    parser = Parser()
    for _ in range(50):
        parser.feed(unit * 1000)
        assert len(parser._rest) < LARGEST_FRAME
    assert parser.feed(bytes(LARGEST_FRAME) + _frame()) == [Frame.of(GRIPPER)]


def test_an_unknown_id_does_not_swallow_the_frame_inside_its_claimed_length() -> None:
    claims_all = bytes((0xFD, 255, 0, 0, 0, 1, 1, 0xEE, 0xEE, 0xEE))
    parser = Parser()
    assert parser.feed(claims_all + _frame()) == [Frame.of(GRIPPER)]
    assert parser.statistics.unknown == 1


def test_a_frame_behind_a_false_beginning_waits_no_longer_than_the_silence() -> None:
    parser = Parser()
    false_beginning = _frame()[:11]
    assert parser.feed(false_beginning + _frame()[:20]) == []
    assert parser.feed(_frame()[20:]) == [Frame.of(GRIPPER)]
    assert parser.feed(bytes((0xFD, 255, 0, 0, 0, 1, 1, 0, 0, 0)) + _frame()) == []
    assert parser.flush() == [Frame.of(GRIPPER)]


def test_an_intact_frame_with_a_flag_we_do_not_know_is_counted_and_passed_over() -> None:
    frame = bytearray(_frame()[:-2])
    frame[2] = 0x02
    checksum = mcrf4xx(bytes(frame) + Gripper.codec.crc_extra, CRC_START)
    parser = Parser()
    assert parser.feed(bytes(frame) + checksum.to_bytes(2, "little") + _frame()) == [Frame.of(GRIPPER)]
    assert parser.statistics.incompatible == 1
    assert parser.statistics.skipped == 0


@pytest.mark.parametrize("name", ["HEARTBEAT", "PARAM_REQUEST_LIST", "SYS_STATUS"])
def test_version_1_is_understood(name: str, oracle: ModuleType) -> None:
    definition = by_name()[name]
    values = dict.fromkeys((field.name for field in definition.fields), 3)
    theirs = oracle.mavlink_map[definition.id](**values)
    frame = bytes(theirs.pack(oracle.MAVLink(None, srcSystem=7, srcComponent=8), force_mavlink1=True))
    parser = Parser()
    (read,) = parser.feed(frame)
    assert (read.version, read.system, read.component, read.flags, read.signed) == (1, 7, 8, 0, False)
    assert read.raw == frame
    assert fields_of(read.message) == values
    assert parser.statistics.version_1 == 1
    assert parser.feed(frame[:-1] + bytes((frame[-1] ^ 1,)) + _frame()) == [Frame.of(GRIPPER)]
    assert parser.statistics.bad_crc == 1


def test_a_short_frame_of_version_1_is_not_kept_waiting() -> None:
    body = bytes((0xFE, 2, 0, 1, 1, 21, 1, 1))
    checksum = mcrf4xx(body + codec_of(21).crc_extra, CRC_START_V1)
    (read,) = Parser().feed(body + checksum.to_bytes(2, "little"))
    assert read.name == "PARAM_REQUEST_LIST"


def test_gaps_in_the_numbers_are_counted_for_each_speaker() -> None:
    parser = Parser()
    for system, sequence in [(1, 254), (2, 7), (1, 255), (2, 8), (1, 0), (2, 11), (1, 3), (2, 12), (1, 4)]:
        parser.feed(_frame(sequence=sequence, system=system))
    assert parser.statistics.lost == 2 + 2
    assert parser.statistics.late == 0


def _unknown(sequence: int, msgid: int = 10_000_000, *, version: int = 2) -> bytes:
    """A frame of somebody's own message; nobody but them knows whether its checksum is right."""
    if version == 1:
        return bytes((0xFE, 4, sequence, 1, 1, UNHEARD_OF)) + b"abcd" + b"\x12\x34"
    return bytes((0xFD, 4, 0, 0, sequence, 1, 1)) + msgid.to_bytes(3, "little") + b"abcd" + b"\x12\x34"


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("largest", [1, 7, 5000])
def test_a_frame_with_an_id_that_we_do_not_know_is_no_lost_one(version: int, largest: int) -> None:
    """Of the numbers 0 to 19 all come but 3 and 13; each third frame is a message that we do not know."""
    numbers = [number for number in range(20) if number not in {3, 13}]
    frames = [
        _unknown(number, version=version) if number % 3 == 2 else _frame(sequence=number)
        for number in numbers
    ]
    parser = Parser()
    for piece in _in_pieces(b"".join(frames), random.Random(largest), largest):
        parser.feed(piece)
    assert (parser.statistics.lost, parser.statistics.late) == (2, 0)
    assert (parser.statistics.received, parser.statistics.unknown) == (12, 6)


def test_what_looks_like_an_unknown_frame_and_is_followed_by_none_is_nothing() -> None:
    parser = Parser()
    parser.feed(_frame(sequence=0) + _unknown(50) + b"noise" + _frame(sequence=1))
    assert parser.statistics.lost == 0


def test_a_frame_that_is_overtaken_is_late_and_no_new_gap() -> None:
    parser = Parser()
    for sequence in [1, 2, 4, 3, 5, 5, 6]:
        parser.feed(_frame(sequence=sequence))
    assert parser.statistics.lost == 1
    assert parser.statistics.late == 2


def test_a_speaker_that_counts_anew_is_late_only_twice() -> None:
    parser = Parser()
    for sequence in [100, 101, 0, 1, 2, 3, 4]:
        parser.feed(_frame(sequence=sequence))
    assert parser.statistics.late == 2
    assert parser.statistics.lost == 0
