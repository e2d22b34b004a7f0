"""Recordings in MCAP, the format of Foxglove (https://mcap.dev/spec): the frames, and what they say as JSON.

Each frame is kept as it came, on the channel `/mavlink`, which is what we read again; and its fields as JSON
on the channel `/SYSTEM/COMPONENT/MESSAGE`, with a schema made from the dialect, which is what Foxglove plots.
Places and postures are told a third time, in Foxglove's own schemas, which it shows in space: Foxglove's
panels know a message by the name of its schema, in JSON too, whose schemas are given here
(https://docs.foxglove.dev/docs/visualization/message-schemas: PoseInFrame, FrameTransforms, JointStates;
times are sec and nsec). The frame of all is `world`, our W: metres, x forward, y left, z up. Times are [ns]
since 1970.

JSON has no NaN: a number that is none is left out, and an array that has one is told as text beside it,
`NAME_text`. A value with a name has it beside it, `NAME_name`.
"""

from __future__ import annotations

import json
import math
import re
from io import BytesIO
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import msgspec

from robotree.protocol.messages import (
    ClaimWish,
    GoalState,
    GripperState,
    Joints,
    LocalPositionNed,
    MavAutopilot,
    MavCmd,
    MavResult,
    MavSeverity,
    MavState,
    MavType,
    ModeKind,
    Reason,
    SetpointKind,
    Tool,
    Verb,
)
from robotree.protocol.parser import Parser
from robotree.protocol.tools.capture.framing import claimed_size
from robotree.protocol.tools.capture.records import Captured, plain_fields

if TYPE_CHECKING:
    from collections.abc import Mapping
    from enum import IntEnum
    from typing import BinaryIO

    from mcap.records import Chunk, Message

    from robotree.protocol.dialect import Definition, Field
    from robotree.protocol.frame import Frame

WORLD: Final = "world"
_NUMBER: Final = {"type": "number"}
_TEXT: Final = {"type": "string"}


def _object(title: str = "", **properties: Mapping[str, Any]) -> dict[str, Any]:
    return ({"title": title} if title else {}) | {"type": "object", "properties": properties}


_TIME: Final = _object("time", sec={"type": "integer"}, nsec={"type": "integer"})
_VECTOR: Final = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION: Final = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_TRANSFORM: Final = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_TEXT,
    child_frame_id=_TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
_JOINT: Final = _object("foxglove.JointState", name=_TEXT, position=_NUMBER)
SCHEMAS: Final[Mapping[str, Mapping[str, Any]]] = {
    "foxglove.PoseInFrame": _object(
        "foxglove.PoseInFrame",
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_object("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION),
    ),
    "foxglove.FrameTransforms": _object(
        "foxglove.FrameTransforms", transforms={"type": "array", "items": _TRANSFORM}
    ),
    "foxglove.JointStates": _object(
        "foxglove.JointStates", timestamp=_TIME, joints={"type": "array", "items": _JOINT}
    ),
}
"""By name, as Foxglove has them."""


class View(NamedTuple):
    """One message for Foxglove."""

    topic: str
    schema: str
    """Its name, one of `SCHEMAS`."""
    data: dict[str, Any]


def views(frame: Frame, nanoseconds: int) -> list[View]:
    """Return what a frame shows, at a moment [ns] since 1970; nothing: it is no place and no posture."""
    message, where = frame.message, f"/{frame.system}/{frame.component}"
    time = {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}
    match message:
        case Tool():
            w, x, y, z = (each / 32767 for each in message.q)
            turned = {"x": x, "y": y, "z": z, "w": w}
            return _placed(f"{where}/tool", time, (message.x, message.y, message.z), turned)
        case LocalPositionNed():  # NED has y to the right and z down
            straight = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
            return _placed(f"{where}/base", time, (message.x, -message.y, -message.z), straight)
        case Joints():
            angles = message.position[: message.count]
            joints = [
                {"name": f"joint_{number}", "position": angle}
                for number, angle in enumerate(angles, 1)
                if math.isfinite(angle)
            ]
            return [View(f"{where}/joints", "foxglove.JointStates", {"timestamp": time, "joints": joints})]
        case _:
            return []


def _placed(
    topic: str, time: dict[str, int], place: tuple[float, float, float], turned: dict[str, float]
) -> list[View]:
    """A pose, and the frame that stands there; it is named as its topic."""
    if not all(map(math.isfinite, place)):
        return []
    position = dict(zip("xyz", place, strict=True))
    pose = {"position": position, "orientation": turned}
    transform = {
        "timestamp": time,
        "parent_frame_id": WORLD,
        "child_frame_id": topic.strip("/"),
        "translation": position,
        "rotation": turned,
    }
    return [
        View(topic, "foxglove.PoseInFrame", {"timestamp": time, "frame_id": WORLD, "pose": pose}),
        View("/tf", "foxglove.FrameTransforms", {"transforms": [transform]}),
    ]


MAGIC = b"\x89MCAP0\r\n"
TOPIC = "/mavlink"
ENCODING = "mavlink"
"""How the messages of our own channel are encoded: each is one frame."""
CHUNK = 32 * 1024
"""[bytes] that are compressed and written together, and that one flipped bit may take with it."""
LARGEST_RECORD = 8 * 1024 * 1024
"""[bytes] of a record that we read, compressed or not: a forged length must not fill the memory."""
_RECORD_HEADER = 9
_LAST_OPCODE = 0x0F
_FRAMES = 1
"""The channel of the frames: the first that a writer registers."""
_CHUNK_HEAD = re.compile(rb"\x06.{6}\0\0.{28}\x04\0\0\0zstd", re.DOTALL)
"""How a compressed chunk begins: opcode, length, two times, size and checksum, name of the compression."""
_CHUNK_HEAD_BYTES = 45
_MAX_ENTRIES = 4096


class McapWriter:
    """Writes a recording to a stream."""

    def __init__(self, stream: BinaryIO) -> None:
        from mcap.writer import Writer

        self._writer = Writer(stream, chunk_size=CHUNK)
        self._writer.start(library="robotree")
        self._frames = self._writer.register_channel(TOPIC, ENCODING, 0)
        self._parser = Parser()
        self._schemas: dict[int, int] = {}
        self._channels: dict[tuple[int, int, int], int] = {}
        self._views: dict[str, int] = {}
        self._view_schemas: dict[str, int] = {}

    def write(self, time: int, frame: bytes) -> None:
        """Append one frame that came at `time`, [us] since 1970."""
        nanoseconds = time * 1000
        self._writer.add_message(self._frames, nanoseconds, frame, nanoseconds)
        for each in self._parser.feed(frame) + self._parser.flush():
            channel = self._channel(each)
            said = msgspec.json.encode(said_of(each))
            self._writer.add_message(channel, nanoseconds, said, nanoseconds, each.sequence)
            for view in views(each, nanoseconds):
                data = msgspec.json.encode(view.data)
                self._writer.add_message(self._shown(view), nanoseconds, data, nanoseconds, each.sequence)

    def flush(self) -> None:
        """End the chunk, so that it can be read while the file grows, and after we were killed."""
        # mcap 1.x ends a chunk when it is full or the file is closed, and offers no public way in between.
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined] # noqa: SLF001

    def close(self) -> None:
        """Write the index; without it the file can still be read from its beginning."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without types

    def _channel(self, frame: Frame) -> int:
        key = frame.system, frame.component, frame.msgid
        if (channel := self._channels.get(key)) is None:
            if len(self._channels) >= _MAX_ENTRIES:
                return self._frames
            topic = f"/{frame.system}/{frame.component}/{frame.name}"
            channel = self._writer.register_channel(topic, "json", self._schema(frame.codec.definition))
            self._channels[key] = channel
        return channel

    def _shown(self, view: View) -> int:
        if (channel := self._views.get(view.topic)) is None:
            if len(self._views) >= _MAX_ENTRIES:
                return self._frames
            if (schema := self._view_schemas.get(view.schema)) is None:
                text = json.dumps(SCHEMAS[view.schema]).encode()
                schema = self._view_schemas[view.schema] = self._writer.register_schema(
                    view.schema, "jsonschema", text
                )
            channel = self._views[view.topic] = self._writer.register_channel(view.topic, "json", schema)
        return channel

    def _schema(self, definition: Definition) -> int:
        if (schema := self._schemas.get(definition.id)) is None:
            text = json.dumps(schema_of(definition)).encode()
            schema = self._writer.register_schema(definition.name, "jsonschema", text)
            self._schemas[definition.id] = schema
        return schema


def said_of(frame: Frame) -> dict[str, Any]:
    """Return a frame's fields as its schema has them."""
    named, said = NAMES.get(frame.name, {}), dict[str, Any]()
    for name, value in plain_fields(frame).items():
        if isinstance(value, float):
            if math.isfinite(value):
                said[name] = value
        elif isinstance(value, list | tuple) and not all(map(math.isfinite, cast("list[float]", value))):
            said[f"{name}_text"] = " ".join(f"{each:g}" for each in cast("list[float]", value))
        else:
            said[name] = value
        if name in named and value in named[name].__members__.values():
            said[f"{name}_name"] = named[name](value).name
    return said


def schema_of(definition: Definition) -> dict[str, Any]:
    """Return the JSON schema of a message's fields; none is required, for NaN is left out."""
    properties: dict[str, Any] = {}
    for field in definition.fields:
        properties[field.name] = _type_of(field)
        if field.length and field.type in ("float", "double"):
            properties[f"{field.name}_text"] = {"type": "string"}
        if field.name in NAMES.get(definition.name, {}):
            properties[f"{field.name}_name"] = {"type": "string"}
    return {"title": definition.name, "type": "object", "properties": properties}


def _type_of(field: Field) -> dict[str, Any]:
    if field.type == "char":
        return {"type": "string"}
    one = {"type": "number" if field.type in ("float", "double") else "integer"}
    return {"type": "array", "items": one} if field.length else one


NAMES: Mapping[str, Mapping[str, type[IntEnum]]] = {
    "HEARTBEAT": {"type": MavType, "autopilot": MavAutopilot, "system_status": MavState},
    "STATUSTEXT": {"severity": MavSeverity},
    "COMMAND_ACK": {"command": MavCmd, "result": MavResult},
    "COMMAND_LONG": {"command": MavCmd},
    "COMMAND_INT": {"command": MavCmd},
    "ROBOTREE_MODE": {"mode": ModeKind, "reason": Reason},
    "ROBOTREE_SET_MODE": {"mode": ModeKind},
    "ROBOTREE_GOAL": {"verb": Verb},
    "ROBOTREE_GOAL_STATUS": {"state": GoalState, "reason": Reason},
    "ROBOTREE_GRIPPER": {"state": GripperState},
    "ROBOTREE_SETPOINT": {"kind": SetpointKind},
    "ROBOTREE_CLAIM": {"wish": ClaimWish},
    "ROBOTREE_CLAIM_STATUS": {"reason": Reason},
}
"""Fields whose values have names, by message."""


class McapReader:
    """Reads the frames of a recording of ours, whatever it is. Keeps at most one record.

    Where a length cannot be believed it goes on with the next chunk. How much a chunk held that cannot be
    inflated is known from the index behind it.
    """

    def __init__(self) -> None:
        self._rest = b""
        self._begun = False
        self._seeking = False
        """Whether the next record has to be looked for."""
        self._in_broken_chunk = False
        self._ours: set[int] = set()
        self.skipped = 0
        """[bytes] of a file that is broken, or none at all."""
        self.broken = 0
        """Frames in chunks that cannot be read."""

    def feed(self, data: bytes) -> list[Captured]:
        """Take some bytes and hand out the frames that they complete."""
        buffer, i, found = self._rest + data, 0, list[Captured]()
        if not self._begun and len(buffer) >= len(MAGIC):
            self._begun, self._seeking = True, not buffer.startswith(MAGIC)
        while self._begun and len(buffer) - i >= _RECORD_HEADER:
            if self._seeking:
                i = self._seek(buffer, i)
                if len(buffer) - i < _CHUNK_HEAD_BYTES:
                    break
            if buffer.startswith(MAGIC, i):  # the beginning, or another file behind this one
                i += len(MAGIC)
                continue
            start = i + _RECORD_HEADER
            length = int.from_bytes(buffer[i + 1 : start], "little")
            believed = length <= LARGEST_RECORD and 0 < buffer[i] <= _LAST_OPCODE
            if believed and len(buffer) < start + length:
                break
            if not (believed and _consistent(buffer, i, length)):
                self._seeking = True
                self.skipped += 1
                i += 1
            else:
                self._seeking = False
                found += self._record(buffer[i], buffer[start : start + length])
                i = start + length
        self._rest = buffer[i:]
        return found

    def flush(self) -> list[Captured]:
        """The file ended; a length that reached beyond it was none."""
        found = list[Captured]()
        while self._rest and self._rest != MAGIC:
            rest, self._rest = self._rest[1:], b""
            self.skipped += 1
            self._seeking = True
            found += self.feed(rest)
            if len(self._rest) < _CHUNK_HEAD_BYTES:  # no chunk begins in what is left
                self.skipped += len(self._rest)
                self._rest = b""
        self._rest = b""
        return found

    def _seek(self, buffer: bytes, i: int) -> int:
        """Where the next chunk begins, or may begin."""
        chunk = _CHUNK_HEAD.search(buffer, i)
        after = chunk.start() if chunk else max(len(buffer) - _CHUNK_HEAD_BYTES + 1, i)
        self.skipped += after - i
        return after

    def _record(self, code: int, body: bytes) -> list[Captured]:
        from mcap.data_stream import ReadDataStream
        from mcap.opcode import Opcode
        from mcap.records import Channel, Chunk, McapRecord, Message, MessageIndex
        from mcap.stream_reader import breakup_chunk

        stream, records = ReadDataStream(BytesIO(body)), list[McapRecord]()
        try:
            match code:
                case Opcode.CHUNK:
                    self._in_broken_chunk = True
                    records = breakup_chunk(inflated(Chunk.read(stream)))
                    self._in_broken_chunk = False
                case Opcode.CHANNEL:
                    records = [Channel.read(stream)]
                case Opcode.MESSAGE:
                    records = [Message.read(stream, len(body))]
                case Opcode.MESSAGE_INDEX if self._in_broken_chunk:
                    index = MessageIndex.read(stream)
                    self.broken += len(index.records) * (index.channel_id == _FRAMES)
                case _:
                    pass
        except Exception:  # noqa: BLE001  the library raises what it likes at forged bytes
            self.skipped += len(body)
        for record in records:
            if isinstance(record, Channel) and record.message_encoding == ENCODING:
                self._ours.add(record.id)
        return [
            Captured(record.data, record.log_time // 1000)
            for record in records
            if isinstance(record, Message) and self._is_ours(record)
        ]

    def _is_ours(self, message: Message) -> bool:
        """Whether it is a frame; the channel is declared only once, and that chunk may be the broken one."""
        if self._ours:
            return message.channel_id in self._ours
        return claimed_size(message.data, 0) == len(message.data)


def _consistent(buffer: bytes, i: int, length: int) -> bool:
    """Whether a compressed chunk, which says its length twice, does not contradict itself."""
    if _CHUNK_HEAD.match(buffer, i) is None:
        return True
    inner = i + _CHUNK_HEAD_BYTES
    return int.from_bytes(buffer[inner : inner + 8], "little") == length - (inner + 8 - i - _RECORD_HEADER)


def inflated(chunk: Chunk) -> Chunk:
    """Return a chunk that is not compressed, of at most `LARGEST_RECORD`; the library would not limit it.

    Raises:
        ValueError: it is compressed in another way than ours.
    """
    import zstandard

    if chunk.compression == "zstd":
        inflate = zstandard.ZstdDecompressor(max_window_size=LARGEST_RECORD).stream_reader(chunk.data)
        chunk.data, chunk.compression = inflate.read(LARGEST_RECORD), ""
    if chunk.compression:
        raise ValueError(f"a chunk is compressed by {chunk.compression}, which we never do")
    return chunk
