"""Logs of candump: other people's lines, ISO-TP in pieces, and whatever else is in a file."""

from __future__ import annotations

from pathlib import Path

import can
import pytest
from can.io.canutils import CanutilsLogWriter
from hypothesis import given
from hypothesis import strategies as st

from robotree.protocol.frame import Frame
from robotree.protocol.isotp import CLASSIC, FD, Channel
from robotree.protocol.isotp.frames import single
from robotree.protocol.links.can.identifiers import EVERYBODY, Kind, Priority, identifier, route
from robotree.protocol.tools.capture import Decoder, Recording, detect
from robotree.protocol.tools.capture.candump import LONGEST_LINE, CandumpReader

HOST, ROBOT = 0x80, 1
NOON = 1_700_000_000


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
    messages = [one for n, frame in enumerate(frames) for one in transfer(frame.raw, width, NOON + n / 50)]
    recording = Recording(str(logged(messages, tmp_path / "arm.log")))
    found = [one for batch in recording.frames() for one in batch]
    assert recording.form == "candump"
    assert [one.frame for one in found] == frames
    assert [one.time for one in found[:3]] == [NOON * 1_000_000 + n * 20_000 for n in range(3)]
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
            lines.append(f"({NOON}.{number:06}) vcan0 {target:08X}##1{single(raw, FD).hex().upper()}")
    text = "\n".join(lines).encode() + b"\n"
    assert len(reader.feed(text)) == len(lines) > 20
    assert len(decoder.feed(text)) == len(lines)
    assert (decoder.statistics.lost, decoder.statistics.late) == (0, 0)


def test_a_missing_piece_costs_one_frame_and_is_counted(frames: list[Frame], tmp_path: Path) -> None:
    messages = [one for n, frame in enumerate(frames[:10]) for one in transfer(frame.raw, CLASSIC, NOON + n)]
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
