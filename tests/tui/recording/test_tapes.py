"""The file of a recording: what was written is read, also where it was cut off or damaged."""

from __future__ import annotations

import io
import json
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from robotree.protocol import encode
from robotree.protocol.messages import NamedValueFloat
from robotree.protocol.tools.capture.mcap import LARGEST_RECORD, McapWriter
from robotree.tui.errors import BadRecordedRealm
from robotree.tui.recording import replayed, summary, tape
from robotree.tui.recording.tape import (
    Entry,
    RecordedEnd,
    RecordedLine,
    RecordedPicture,
    RecordedState,
    TapeWriter,
)
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import LoggedLine, Picture, State

NOON = 1_800_000_000.0
ARM = RobotDescription(address=Address("robot", "arm-1", "1"), kinds=("Arm",), units={"z": "m"})
LINE = LoggedLine(1, NOON + 2, "failed", "arm-1: go_to | is `too` far [x]")
PICTURE = Picture(jpeg=b"\xff\xd8\xff", width=4, height=3, camera="wrist")


def written(states: int = 3, *, closed: bool = True) -> bytes:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {"realm": "hall"})
    writer.description(NOON, ARM)
    for number in range(states):
        writer.state(
            NOON + 1 + number / 100, "arm-1", State(readings={"z": number / 10, "hot": float("nan")})
        )
        writer.flush()
    writer.line("arm-1", LINE)
    writer.event(HistoryEvent(kind="stop", unix=NOON + 3, robot="arm-1", text="by hand"))
    writer.picture(NOON + 4, "cell", PICTURE)
    writer.gone(NOON + 5, "arm-1")
    writer.flush()
    if closed:
        writer.close()
    return stream.getvalue()


def read(data: bytes) -> tape.Tape:
    return tape.read(io.BytesIO(data), "it.mcap")


WHOLE = written()


def test_what_was_written_is_read() -> None:
    found = read(WHOLE)
    assert found.whole
    assert found.about["realm"] == "hall"
    kinds = [RobotDescription, *[RecordedState] * 3, RecordedLine, HistoryEvent, RecordedPicture, RecordedEnd]
    assert [type(entry.content) for entry in found.entries] == kinds
    assert found.entries[0].content == ARM
    assert found.entries[4].content == RecordedLine("arm-1", LINE)
    assert found.entries[6] == Entry(NOON + 4, RecordedPicture("cell", "wrist", b"\xff\xd8\xff"))


def test_a_recording_says_where_robots_are_in_the_frames_that_they_name() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {})
    framed = msgspec.structs.replace(ARM, attributes={"controller": "tcp://cell:1"})
    writer.state(NOON, "arm-1", State(readings={"x": 0.3, "y": 0.1, "z": 0.2}))
    writer.description(NOON + 1, framed)
    writer.state(NOON + 2, "arm-1", State(readings={"x": 0.4, "y": 0.1, "z": 0.2}))
    writer.state(NOON + 3, "arm-1", State(readings={"z": 0.2}))
    writer.close()
    stream.seek(0)
    heard = [
        (schema.name, json.loads(message.data)["transforms"][0])
        for schema, channel, message in make_reader(stream).iter_messages(topics=["/tf"])
        if schema is not None and channel.message_encoding == "json"
    ]
    assert [name for name, _ in heard] == ["foxglove.FrameTransforms"] * 2
    assert [(one["parent_frame_id"], one["translation"]["x"]) for _, one in heard] == [
        ("world", 0.3), ("tcp://cell:1", 0.4),
    ]  # fmt: skip
    assert len(read(stream.getvalue()).entries) == 4, "the states say it as well"


def test_a_description_is_written_when_it_has_changed() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {})
    busy = RobotDescription(address=ARM.address, kinds=("Arm",), units={"z": "m"}, busy="go_to")
    other = RobotDescription(address=ARM.address, kinds=("Arm",), units={"z": "m"}, doc="another page")
    for moment, robot in enumerate([ARM, busy, other, other]):
        writer.description(NOON + moment, robot)
    writer.close()
    assert [entry.content for entry in read(stream.getvalue()).entries] == [ARM, other]


def test_a_recorder_that_was_killed_leaves_what_it_had_flushed() -> None:
    found = read(written(closed=False))
    assert not found.whole
    assert len(found.entries) == 8
    assert "cut off" in summary.text(found)


@given(length=st.integers(0, len(WHOLE) - 1))
def test_a_file_that_was_cut_off_anywhere_has_its_beginning(length: int) -> None:
    try:
        found = read(WHOLE[:length])
    except BadRecordedRealm:
        return
    assert found.entries == read(WHOLE).entries[: len(found.entries)]


@given(position=st.integers(0, len(WHOLE) - 1), bit=st.integers(0, 7))
def test_a_damaged_file_never_shows_what_nobody_wrote(position: int, bit: int) -> None:
    damaged = bytearray(WHOLE)
    damaged[position] ^= 1 << bit
    try:
        found = read(bytes(damaged))
    except BadRecordedRealm:
        return
    known = [entry.content for entry in read(WHOLE).entries]
    assert all(entry.content in known for entry in found.entries)


def test_other_files_are_refused_in_one_sentence() -> None:
    frames = io.BytesIO()
    wire = McapWriter(frames)
    wire.write(round(NOON * 1e6), encode(NamedValueFloat(1, "x", 1.0), sequence=0, system=1, component=1))
    wire.close()
    for data in (frames.getvalue(), b"", b"hello", b"\x89MCAP0\r\n"):
        with pytest.raises(BadRecordedRealm, match="no recording of a realm"):
            read(data)


def test_another_version_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tape, "VERSION", "2")
    newer = written()
    monkeypatch.undo()
    with pytest.raises(BadRecordedRealm, match="version 2 of the format, and this robotree reads 1"):
        read(newer)


def test_a_report_escapes_what_robots_say() -> None:
    head = summary.head(read(WHOLE))
    assert r"go\_to \| is \`too\` far \[x\]" in head
    assert "| arm-1.z | 0 | 0.2 | m |" in head


def test_how_robots_were_at_a_moment() -> None:
    assert "z=0.1 m" in summary.at(read(WHOLE), 1.015)


def test_a_forged_recording_adds_no_line_to_a_script_and_names_no_file_elsewhere(tmp_path: Path) -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {})
    for key, arguments in (
        ("1", {"text": "a\nstop"}),
        ("2", {"text": "b\u2028stop"}),
        ("3", {"text": "fine"}),
    ):
        writer.event(
            HistoryEvent(
                kind="accepted", unix=NOON, robot="arm-1", key=key, command="say", arguments=arguments,
                person="eve@pts/1",
            )
        )  # fmt: skip
    writer.picture(NOON + 1, "cell", Picture(jpeg=b"x", width=1, height=1, camera="../../evil](x"))
    writer.close()
    found = read(stream.getvalue())
    asked = [
        line
        for line in replayed.session_of(found, lambda _: True).splitlines()
        if not line.startswith(("#", "sleep"))
    ]
    assert asked == ["call arm-1.say text=fine"]
    folder, count = summary.write_report(found, tmp_path / "it.md")
    assert count == 1
    assert [path.name for path in folder.iterdir()] == ["001-cell-------evil--x.jpg"]


def test_where_nobody_asked_for_anything_the_script_expects_who_was_there() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {"began": repr(NOON)})
    writer.description(NOON, ARM)
    writer.close()
    script = replayed.session_of(read(stream.getvalue()), lambda _: True)
    assert "\nexpect arm-1 listed\n" in script
    assert "Nobody asked for anything" in script


def test_a_page_of_somebody_else_is_not_run_by_a_script() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {"began": repr(NOON)})
    for number, name in enumerate(("mine", "theirs"), 1):
        page = f"/home/{name}/page.py"
        robot = RobotDescription(address=Address("robot", name, "1"), kinds=("Arm",), page=page)
        writer.description(NOON + number, robot)
        writer.state(NOON + number, name, State())
    writer.close()
    script = replayed.session_of(read(stream.getvalue()), lambda page: page.startswith("/home/mine/"))
    assert "create /home/mine/page.py as mine" in script
    assert "theirs.py" not in script
    assert "expect theirs listed" in script


@pytest.mark.parametrize("began", ["x", "nan", "-1e300", "inf"])
def test_a_beginning_that_is_none_is_that_of_the_first_entry(began: str) -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {"began": began})
    writer.state(NOON, "arm-1", State())
    writer.close()
    assert read(stream.getvalue()).began == NOON


def test_a_forged_name_ends_the_reading() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {})
    writer.state(NOON, "arm-1", State())
    writer.state(NOON + 1, "../arm", State())
    writer.close()
    found = read(stream.getvalue())
    assert len(found.entries) == 1
    assert not found.whole


def test_a_chunk_that_grows_beyond_the_limit_is_not_read() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {})
    writer.line("arm-1", LINE)
    writer.flush()
    writer.line("arm-1", LoggedLine(2, NOON + 3, "info", "x" * (LARGEST_RECORD + 1)))
    writer.close()
    assert len(stream.getvalue()) < 100_000
    assert len(read(stream.getvalue()).entries) == 1


def test_what_overlapped_in_a_recording_overlaps_in_its_script() -> None:
    stream = io.BytesIO()
    writer = TapeWriter(stream, {"began": repr(NOON)})

    def called(robot: str, key: str, begin: float, end: float, error: str = "") -> None:
        asked = HistoryEvent(
            kind="accepted", unix=NOON + begin, robot=robot, key=key, command="go", caller="anna@pts/1"
        )
        writer.event(asked)
        writer.event(HistoryEvent(kind="ended", unix=NOON + end, robot=robot, key=key, error=error))

    def all_are(at: float, state: State) -> None:
        for number, name in enumerate(("arm-1", "square")):
            writer.state(NOON + at + number / 10, name, state)

    all_are(1, State())
    called("square", "1", 2, 2.7, "CommandCancelled")
    all_are(2.75, State(stopped=True, stop_reason="anna@pts/1's protective stop"))  # is heard after the end
    all_are(5, State())
    called("arm-1", "2", 6, 8)
    called("square", "3", 7, 7.5)
    called("arm-1", "4", 9, 9.5)
    writer.state(NOON + 9.6, "arm-1", State(stopped=True, stop_reason="anna@pts/1's protective stop"))
    called("square", "5", 11, 12.5, "CommandCancelled")  # nobody stopped it
    writer.close()
    script = replayed.session_of(read(stream.getvalue()), lambda _: True).splitlines()
    assert [line for line in script if not line.startswith("#")] == [
        "expect arm-1 listed within 30s", "expect square listed within 30s",
        "call square.go --detach", "sleep 0.8s", "stop", "expect square idle within 30s",
        "sleep 2.2s", "try resume", "sleep 1.0s",
        "call arm-1.go --detach", "sleep 1.0s", "call square.go", "expect arm-1 idle within 30s",
        "sleep 1.0s", "call arm-1.go", "stop arm-1",
        "sleep 1.4s", "call square.go --detach", "sleep 1.5s", "try cancel square",
        "expect square idle within 30s",
    ]  # fmt: skip
