"""A .tlog is what other tools take for one, also logs of candump; a damaged one gives all that is whole."""

from __future__ import annotations

import time
from pathlib import Path
from types import ModuleType
from typing import Any

import can
import pytest
from can.io.canutils import CanutilsLogWriter
from fastcrc.crc16 import mcrf4xx
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.protocol import encode
from robotree.protocol.frame import Frame
from robotree.protocol.isotp import CLASSIC, FD, Channel
from robotree.protocol.isotp.frames import single
from robotree.protocol.links.can.identifiers import EVERYBODY, Kind, Priority, identifier, route
from robotree.protocol.messages import Heartbeat, NamedValueFloat, make
from robotree.protocol.tools.capture import Captured, Decoder, Recording, detect, tlog
from robotree.protocol.tools.capture.decode import LONGEST_LINE, CandumpReader
from robotree.protocol.tools.capture.framing import Splitter, intact
from robotree.protocol.tools.capture.tlog import TlogReader

NOON = 1_700_000_000_000_000
"""[us]"""


def frame(number: int) -> bytes:
    message = NamedValueFloat(time_boot_ms=number, name="x", value=number / 3)
    return encode(message, sequence=number, system=1, component=1)


def log(count: int) -> list[bytes]:
    return [tlog.encode(NOON + 10_000 * number, frame(number)) for number in range(count)]


def read(data: bytes, cut: int = 1 << 16) -> tuple[list[Captured], TlogReader]:
    reader = TlogReader()
    found = [one for i in range(0, len(data), cut) for one in reader.feed(data[i : i + cut])]
    return found + reader.flush(), reader


def heard(reader: Any) -> list[tuple[int, int, str]]:
    """What mavutil finds."""
    found: list[tuple[int, int, str]] = []
    while (message := reader.recv_match()) is not None:
        found.append((round(message._timestamp * 1e6), message.get_seq(), message.get_type()))
    return found


def test_mavutil_reads_what_we_record(mavutil: ModuleType, frames: list[Frame], tmp_path: Path) -> None:
    times = [NOON + 20_000 * number for number in range(len(frames))]
    path = tmp_path / "arm.tlog"
    path.write_bytes(b"".join(tlog.encode(t, one.raw) for t, one in zip(times, frames, strict=True)))
    connection = mavutil.mavlink_connection(str(path))
    expected = [(t, one.sequence, one.name) for t, one in zip(times, frames, strict=True)]
    assert heard(connection) == expected
    connection.close()


def test_we_read_what_mavutil_records(mavutil: ModuleType, frames: list[Frame], tmp_path: Path) -> None:
    (tmp_path / "stream.raw").write_bytes(b"".join(one.raw for one in frames))
    began = time.time()
    connection = mavutil.mavlink_connection(str(tmp_path / "stream.raw"), notimestamps=True)
    connection.setup_logfile(str(tmp_path / "theirs.tlog"), mode="wb")
    assert len(heard(connection)) == len(frames)
    connection.logfile.close()
    connection.close()
    decoder = Decoder("tlog")
    found = decoder.feed((tmp_path / "theirs.tlog").read_bytes()) + decoder.flush()
    assert [one.frame.raw for one in found] == [one.raw for one in frames]
    assert all(one.time is not None and began - 1 <= one.time / 1e6 <= time.time() for one in found)
    assert decoder.statistics.skipped == 0


@given(count=st.integers(0, 20), cut=st.integers(1, 90))
def test_a_recording_reads_the_same_however_it_is_cut(count: int, cut: int) -> None:
    found, reader = read(b"".join(log(count)), cut)
    assert [(one.time, one.data) for one in found] == [
        (NOON + 10_000 * number, frame(number)) for number in range(count)
    ]
    assert reader.skipped == 0


@given(st.lists(st.sampled_from(log(10)) | st.binary(max_size=40), max_size=30), st.integers(1, 300))
@settings(max_examples=200)
def test_nothing_that_is_read_raises_and_every_byte_is_accounted_for(parts: list[bytes], cut: int) -> None:
    data = b"".join(parts)
    found, reader = read(data, cut)
    assert sum(tlog.STAMP_BYTES + len(one.data) for one in found) + reader.skipped == len(data)


def test_a_damaged_record_costs_no_other() -> None:
    records = log(20)
    records[5] = records[5][:10] + b"\xff" + records[5][11:]  # a wrong flag: the length is wrong too
    records[9] = records[9][:-3]  # the disk was full for a moment
    records[13] = records[13][:20] + b"?" + records[13][21:]  # a wrong checksum at the right place
    decoder = Decoder("tlog")
    found = decoder.feed(b"".join(records)) + decoder.flush()
    assert [one.frame.sequence for one in found] == [n for n in range(20) if n not in (5, 9, 13)]
    assert decoder.statistics.bad_crc >= 1
    damaged = len(records[5]) + len(records[9]) + len(records[13])
    assert damaged - tlog.STAMP_BYTES == decoder.statistics.skipped  # the stamp of 13 is one


def test_a_frame_of_an_unknown_message_is_kept_where_a_frame_may_be() -> None:
    stranger = bytes((0xFD, 3, 0, 0, 9, 1, 1, 0x21, 0x43, 0x65, 1, 2, 3, 0xAA, 0xBB))
    records = [log(1)[0], tlog.encode(NOON + 20_000, stranger), log(4)[3]]
    found, _ = read(b"".join(records))
    assert [one.data for one in found] == [frame(0), stranger, frame(3)]


def test_frames_of_version_1_are_read_too() -> None:
    first = bytes.fromhex("fe0900010100000000000608000403")
    raw = first + mcrf4xx(first[1:] + b"\x32").to_bytes(2, "little")
    assert intact(raw)
    decoder = Decoder("tlog")
    (one,) = decoder.feed(tlog.encode(NOON, raw)) + decoder.flush()
    assert isinstance(one.frame.message, Heartbeat)
    assert decoder.statistics.version_1 == 1


def test_the_format_is_told_by_the_first_bytes_or_else_by_the_name() -> None:
    assert detect(log(1)[0]) == "tlog"
    assert detect((5_000_000).to_bytes(8, "big") + frame(0)) == "raw"
    assert detect((5_000_000).to_bytes(8, "big") + frame(0), "boot.tlog") == "tlog"
    assert detect(frame(0) + frame(1)) == "raw"
    assert detect(b"(1436509052.249713) vcan0 044#2A") == "candump"
    assert detect(b"") == "raw"


@given(st.lists(st.sampled_from([frame(n) for n in range(8)]) | st.binary(max_size=30)), st.integers(1, 99))
def test_all_pieces_of_a_stream_are_the_stream(parts: list[bytes], cut: int) -> None:
    data, splitter = b"".join(parts), Splitter()
    pieces = [one for i in range(0, len(data), cut) for one in splitter.feed(data[i : i + cut])]
    assert b"".join(one.data for one in pieces + splitter.flush()) == data


def test_a_splitter_finds_every_frame_between_noise() -> None:
    splitter = Splitter()
    stream = b"\xfd\x01".join(frame(number) for number in range(9)) + b"noise"
    pieces = splitter.feed(stream) + splitter.flush()
    assert [piece.data for piece in pieces if piece.framed] == [frame(number) for number in range(9)]


def test_a_text_field_of_any_message_can_be_recorded() -> None:
    sent = encode(make("PARAM_VALUE", param_id="wrist", param_value=1.5), sequence=0, system=1, component=1)
    (one,), _ = read(tlog.encode(NOON, sent))
    assert one.data == sent


HOST, ROBOT = 0x80, 1
NOON_S = 1_700_000_000


def addressed(*, target: int, source: int) -> int:
    return identifier(Priority.TO_HOST, Kind.ADDRESSED, target=target, source=source)


def message(arbitration_id: int, field: bytes, time: float) -> can.Message:
    return can.Message(
        timestamp=time, arbitration_id=arbitration_id, data=field, is_fd=len(field) > CLASSIC, channel="can0"
    )


def transfer(payload: bytes, width: int, time: float) -> list[can.Message]:
    """All CAN frames of one payload from the robot to the host, with the flow control that it needs."""
    near, far = Channel(width), Channel(width)
    out, lines = [*near.send(payload, time)], list[can.Message]()
    while out:
        lines += [message(addressed(target=HOST, source=ROBOT), field, time) for field in out]
        back = [answer for field in out for answer in far.feed(field, time).reply]
        lines += [message(addressed(target=ROBOT, source=HOST), field, time) for field in back]
        out = [field for each in back for field in near.feed(each, time).reply]
    return lines


def logged(messages: list[can.Message], path: Path) -> Path:
    """What python-can's writer of candump logs makes of them."""
    with CanutilsLogWriter(path, channel="can0") as log:
        for each in messages:
            log.on_message_received(each)
    return path


@pytest.mark.parametrize("width", [CLASSIC, FD])
def test_what_python_can_logs_is_the_arm_again(width: int, frames: list[Frame], tmp_path: Path) -> None:
    messages = [one for n, frame in enumerate(frames) for one in transfer(frame.raw, width, NOON_S + n / 50)]
    recording = Recording(str(logged(messages, tmp_path / "arm.log")))
    found = [one for batch in recording.frames() for one in batch]
    assert recording.form == "candump"
    assert [one.frame for one in found] == frames
    assert [one.time for one in found[:3]] == [NOON_S * 1_000_000 + n * 20_000 for n in range(3)]
    assert {one.route for one in found} == {f"can0/{ROBOT}>{HOST}"}
    statistics = recording.statistics
    assert (statistics.lost, statistics.late, statistics.skipped) == (0, 0, 0)
    assert statistics.can is not None
    assert (statistics.can.malformed, statistics.can.foreign, statistics.can.broken) == (0, 0, 0)


def test_telemetry_to_everybody_counts_with_the_link_it_belongs_to(frames: list[Frame]) -> None:
    reader, decoder = CandumpReader(), Decoder("candump")
    to_all = identifier(Priority.TELEMETRY, Kind.BROADCAST, target=EVERYBODY, source=ROBOT)
    lines: list[str] = []
    for number, frame in enumerate(one for one in frames if len(one.raw) <= 62):
        target = to_all if number % 2 else addressed(target=HOST, source=ROBOT)
        raw = Frame.of(frame.message, sequence=number).raw
        if len(raw) <= 62:
            lines.append(f"({NOON_S}.{number:06}) vcan0 {target:08X}##1{single(raw, FD).hex().upper()}")
    text = "\n".join(lines).encode() + b"\n"
    assert len(reader.feed(text)) == len(lines) > 20
    assert len(decoder.feed(text)) == len(lines)
    assert (decoder.statistics.lost, decoder.statistics.late) == (0, 0)


def test_a_missing_piece_costs_one_frame_and_is_counted(frames: list[Frame], tmp_path: Path) -> None:
    messages = [
        one for n, frame in enumerate(frames[:10]) for one in transfer(frame.raw, CLASSIC, NOON_S + n)
    ]
    pieces = [n for n, one in enumerate(messages) if one.data[0] >> 4 == 2]
    del messages[pieces[3]]
    recording = Recording(str(logged(messages, tmp_path / "arm.log")))
    found = [one for batch in recording.frames() for one in batch]
    assert len(found) == 9
    assert recording.statistics.can is not None
    assert recording.statistics.can.broken >= 1


LINES = [
    ("(1436509052.249713) vcan0 044#2A366C2BBA", "foreign"),
    ("(1436509052.249713) vcan0 0CDA0180#R", "malformed"),
    ("(1436509052.249713) vcan0 20000080#0000000000000000", "malformed"),
    ("(1436509052.249713) vcan0 0CDA0180#123", "malformed"),
    ("(1436509052.249713) vcan0 0CEF0180#0102", "foreign"),
    ("  can0  123   [8]  01 02 03", "malformed"),
    ("(x) vcan0 0CDA0180#00", "malformed"),
    ("(1436509052.249713) vcan0 0CDA0180#", "broken"),
    ("(1436509052.249713) vcan0 0CDA0180#2102", "broken"),
    ("(1436509052.249713) vcan0 0CDA0180#05FD000000 R", "broken"),
]


@pytest.mark.parametrize(("line", "where"), LINES)
def test_what_is_no_payload_of_ours_is_counted(line: str, where: str) -> None:
    reader = CandumpReader()
    assert reader.feed(line.encode() + b"\r\n") == []
    counted = {name: getattr(reader.statistics, name) for name in ("malformed", "foreign", "broken")}
    assert counted == {"malformed": 0, "foreign": 0, "broken": 0} | {where: 1}


@given(st.lists(st.binary(max_size=60) | st.sampled_from([line.encode() for line, _ in LINES])))
def test_no_line_raises(lines: list[bytes]) -> None:
    reader = CandumpReader()
    reader.feed(b"\n".join(lines))
    reader.flush()
    assert reader.statistics.lines <= sum(line.count(b"\n") + 1 for line in lines)


def test_a_file_without_an_end_of_line_is_not_kept() -> None:
    reader = CandumpReader()
    for _ in range(100):
        reader.feed(b"x" * LONGEST_LINE)
    reader.flush()
    assert reader.skipped >= 99 * LONGEST_LINE


def test_identifiers_are_taken_whole() -> None:
    assert detect(b"(1436509052.249713) can0 0CDA0180#") == "candump"
    assert route(Kind.ADDRESSED, target=ROBOT, source=HOST) == 0x00DA0180
