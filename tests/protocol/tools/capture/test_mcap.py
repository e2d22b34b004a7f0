"""An MCAP is what Foxglove's own library reads, and ours is read back; a forged one does no harm."""

from __future__ import annotations

import io
import json
import math
import random
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import McapRecord, Message
from mcap.stream_reader import StreamReader

from robotree.protocol.dialect import definitions
from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    Goal,
    Gripper,
    Heartbeat,
    Joints,
    Mode,
    ModeKind,
    NamedValueFloat,
    Reason,
    Tool,
    fields_of,
    make,
)
from robotree.protocol.tools.capture import Decoder, Recording, detect
from robotree.protocol.tools.capture.mcap import MAGIC, McapReader, McapWriter, schema_of, views

NOON = 1_700_000_000_000_000


def recorded(frames: list[Frame], *, whole: bool = True) -> bytes:
    file = io.BytesIO()
    writer = McapWriter(file)
    for number, frame in enumerate(frames):
        writer.write(NOON + 10_000 * number, frame.raw)
    if whole:
        writer.close()
    return file.getvalue()


def told(frames: list[Frame]) -> list[tuple[Any, str, dict[str, Any], int]]:
    """What Foxglove's library reads: schema, topic, fields and time."""
    return [
        (schema, channel.topic, json.loads(message.data), message.log_time)
        for schema, channel, message in make_reader(io.BytesIO(recorded(frames))).iter_messages()
        if schema is not None
    ]


def test_foxglove_s_library_reads_every_message(frames: list[Frame]) -> None:
    heard = [
        (schema.name, topic, {name: fields[name] for name in fields if not name.endswith("_name")}, time)
        for schema, topic, fields, time in told(frames)
        if not schema.name.startswith("foxglove.")
    ]
    expected = [
        (
            one.name,
            f"/{one.system}/{one.component}/{one.name}",
            json.loads(json.dumps(fields_of(one.message), default=list)),  # bytes are a list of numbers
            (NOON + 10_000 * number) * 1000,
        )
        for number, one in enumerate(frames)
    ]
    assert heard == expected


def fits(value: Any, schema: dict[str, Any]) -> bool:
    """Whether a value is what a schema says, as far as our schemas go."""
    match schema["type"]:
        case "object":
            known = schema["properties"]
            return set(value) <= set(known) and all(fits(value[name], known[name]) for name in value)
        case "array":
            return isinstance(value, list) and all(fits(one, schema["items"]) for one in value)
        case "string":
            return isinstance(value, str)
        case "integer":
            return isinstance(value, int)
        case _:
            return isinstance(value, int | float)


@given(seed=st.integers(0, 2**32))
def test_every_message_is_what_its_schema_says_though_numbers_are_none(seed: int) -> None:
    chance = random.Random(seed)
    goal = Goal(
        7, 1, 0, tuple(chance.choice((0.5, math.nan, math.inf)) for _ in range(7)), chance.randrange(9), 1, 1
    )
    numbers = [chance.choice((0.5, math.nan, -math.inf)) for _ in range(6)]
    place = make("LOCAL_POSITION_NED", **dict(zip(("x", "y", "z", "vx", "vy", "vz"), numbers, strict=True)))
    beat = Heartbeat(chance.randrange(256), chance.randrange(256), 0, 0, chance.randrange(256))
    for schema, _, fields, _ in told([Frame.of(each) for each in (goal, place, beat, TOOL, JOINTS)]):
        assert fits(fields, json.loads(schema.data)), (schema.name, fields)


TOOL = Tool(5, 0.4, 0.1, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, (0, 32767, 0, 0), 0)
JOINTS = Joints(5, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.0, 0.0), 6)


def test_the_arm_is_seen_where_it_is_in_foxglove_s_own_schemas() -> None:
    seen = {
        schema.name: (topic, fields) for schema, topic, fields, _ in told([Frame.of(TOOL), Frame.of(JOINTS)])
    }
    topic, pose = seen["foxglove.PoseInFrame"]
    assert topic == "/1/1/tool"
    assert pose["timestamp"] == {"sec": NOON // 1_000_000, "nsec": 0}
    assert pose["frame_id"] == "world"
    assert pose["pose"]["position"] == pytest.approx({"x": 0.4, "y": 0.1, "z": 0.3})
    assert pose["pose"]["orientation"] == {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}, "it points down"
    topic, moved = seen["foxglove.FrameTransforms"]
    (transform,) = moved["transforms"]
    assert (topic, transform["parent_frame_id"], transform["child_frame_id"]) == ("/tf", "world", "1/1/tool")
    assert transform["translation"] == pose["pose"]["position"]
    topic, states = seen["foxglove.JointStates"]
    assert [each["name"] for each in states["joints"]] == [f"joint_{number}" for number in range(1, 7)]
    assert states["joints"][5]["position"] == pytest.approx(0.6)


def test_a_rover_is_seen_on_its_side_of_the_world() -> None:
    place = make("LOCAL_POSITION_NED", x=1.0, y=2.0, z=-0.5)
    (pose,) = [
        fields for schema, *_, fields, _ in told([Frame.of(place)]) if schema.name == "foxglove.PoseInFrame"
    ]
    assert pose["pose"]["position"] == {"x": 1.0, "y": -2.0, "z": 0.5}, "NED has y to the right and z down"


def test_values_that_have_names_are_told_by_name() -> None:
    ((_, _, fields, _),) = told([Frame.of(Mode(1, 2, 2000, ModeKind.SAFE_STOP, Reason.OPERATOR))])
    assert (fields["mode"], fields["mode_name"], fields["reason_name"]) == (4, "SAFE_STOP", "OPERATOR")


def test_what_is_recorded_is_decoded_again(frames: list[Frame], tmp_path: Path) -> None:
    path = tmp_path / "arm.mcap"
    path.write_bytes(recorded(frames))
    recording = Recording(str(path))
    found = [one for batch in recording.frames() for one in batch]
    assert recording.form == "mcap"
    assert [(one.frame, one.time) for one in found] == [
        (frame, NOON + 10_000 * number) for number, frame in enumerate(frames)
    ]
    assert recording.statistics.skipped == 0


@given(cut=st.integers(1, 5000))
def test_it_reads_the_same_however_it_is_cut(cut: int) -> None:
    frame = Frame.of(NamedValueFloat(time_boot_ms=1, name="x", value=2.0))
    data, reader = recorded([frame] * 30), McapReader()
    found = [one for i in range(0, len(data), cut) for one in reader.feed(data[i : i + cut])]
    assert len(found) == 30
    reader.flush()
    assert reader.skipped == 0


def test_a_recording_that_was_never_closed_keeps_its_whole_chunks(frames: list[Frame]) -> None:
    decoder = Decoder("mcap")
    many = frames * 20
    found = decoder.feed(recorded(many, whole=False)) + decoder.flush()
    assert 0 < len(found) < len(many)


def test_a_number_that_json_does_not_have_is_left_out() -> None:
    ((_, _, fields, _),) = told([Frame.of(NamedValueFloat(time_boot_ms=1, name="x", value=math.nan))])
    assert fields == {"time_boot_ms": 1, "name": "x"}
    args = (0.5, math.nan, *(0.0,) * 5)
    ((_, _, fields, _),) = told([Frame.of(Goal(7, 1, 0, args, 1, 1, 1))])
    assert "args" not in fields
    assert fields["args_text"] == "0.5 nan 0 0 0 0 0"


def test_every_message_has_a_schema() -> None:
    for definition in definitions().values():
        assert {field.name for field in definition.fields} <= set(schema_of(definition)["properties"])


@given(seed=st.integers(0, 2**32), count=st.integers(1, 30))
def test_a_forged_file_never_raises(seed: int, count: int) -> None:
    chance = random.Random(seed)
    grip = Gripper(time_boot_ms=0, width=0, commanded=0, force=0, state=0)
    data = bytearray(recorded([Frame.of(grip)] * 5))
    for _ in range(count):
        data[chance.randrange(len(MAGIC), len(data))] = chance.randrange(256)
    reader = McapReader()
    found = [*reader.feed(bytes(data)), *reader.flush()]
    assert len(found) <= 5, "nothing is invented"


@pytest.mark.parametrize("length", [0, 1, 2**31, 2**63, 2**64 - 1])
def test_a_forged_length_is_not_waited_for_in_memory(length: int) -> None:
    reader = McapReader()
    reader.feed(MAGIC + b"\x06" + length.to_bytes(8, "little"))
    for _ in range(300):
        assert reader.feed(bytes(64 * 1024)) == []
        assert len(reader._rest) <= 64 * 1024
    reader.flush()
    assert reader.skipped > 299 * 64 * 1024
    assert detect(MAGIC + b"\0") == "mcap"


def test_what_was_flushed_is_in_the_file_though_it_is_never_closed(frames: list[Frame]) -> None:
    """Kill -9 keeps what our reader, and Foxglove's in the order of the file, can read."""
    frames = frames[:40]  # less than a chunk
    file, kept = io.BytesIO(), len(frames) // 2
    writer = McapWriter(file)
    for number, frame in enumerate(frames):
        if number == kept:
            writer.flush()
        writer.write(NOON + 10_000 * number, frame.raw)
    decoder = Decoder("mcap")
    assert [one.frame for one in decoder.feed(file.getvalue()) + decoder.flush()] == frames[:kept]
    assert decoder.statistics.skipped == decoder.statistics.broken == 0
    theirs = StreamReader(io.BytesIO(file.getvalue()), emit_chunks=False).records
    said = [record for record in until_the_end(theirs) if isinstance(record, Message)]
    shown = sum(len(views(frame, 0)) for frame in frames[:kept])
    assert len(said) == 2 * kept + shown


def until_the_end(records: Iterable[McapRecord]) -> Iterator[McapRecord]:
    with suppress(EndOfFile):
        yield from records


def chunks_of(data: bytes) -> list[int]:
    """Where the chunks of a recording begin."""
    return [found.start() for found in re.finditer(rb"\x06.{6}\0\0.{28}\x04\0\0\0zstd", data, re.DOTALL)]


@pytest.mark.parametrize("place", [3, 46, 53], ids=["its length", "the length of its data", "its data"])
def test_a_flipped_bit_takes_one_chunk_with_it_and_tells_how_much_it_was(
    frames: list[Frame], place: int
) -> None:
    many = frames * 5
    whole = recorded(many)
    first, *others = chunks_of(whole)
    assert len(others) >= 2
    for chunk in (first, others[-1]):
        data = bytearray(whole)
        data[chunk + place] ^= 0x10
        decoder = Decoder("mcap")
        left = [one.frame for one in decoder.feed(bytes(data)) + decoder.flush()]
        share = 1 / (1 + len(others))
        assert len(many) * (1 - 2 * share) < len(left) < len(many)
        assert all(frame in frames for frame in left)
        assert decoder.statistics.skipped > 0
        if place == 53:
            assert decoder.statistics.broken == len(many) - len(left)
