"""The file of a recording of a realm. Streams are handed in, and no clock is read.

It is MCAP (https://mcap.dev/spec), with JSON messages, times in ns since 1970 on the clock of who records:

    /robots/NAME/state        the state of a robot, as it published it (`State`)
    /robots/NAME/readings     its readings alone, in SI units, for plots
    /robots/NAME/description  its description, when it has changed (`RobotDescription`)
    /robots/NAME/gone         it is there no more
    /robots/NAME/log          one line of its log (`LoggedLine`); of any agent
    /log                      the same for Foxglove (`foxglove.Log`)
    /events                   an event of a history (`HistoryEvent`), at the time when it happened
    /views/NAME/CAMERA        a picture (`foxglove.CompressedImage`)
    /tf                       where robots are (`foxglove.FrameTransforms`), from their readings

A file whose writer was killed has everything up to its last `flush`.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, BinaryIO, Final, NamedTuple, TypeVar

import msgspec

from robotree.protocol.tools.capture.mcap import LARGEST_RECORD, inflated
from robotree.tui.errors import BadRecordedRealm
from robotree.tui.recording import foxglove_messages as messages
from robotree.vr.base.address import parted
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import LoggedLine, State

if TYPE_CHECKING:
    from mcap.records import McapRecord

    from robotree.vr.base.requests import Picture

PROFILE: Final = "robotree.realm"
"""The profile of the file: who reads another one says so."""

VERSION: Final = "1"
"""Of the topics and their messages."""

CHUNK: Final = 256 * 1024
"""[bytes] that are compressed together, and the most that a damaged place takes along."""

_NUMBER: Final = {"type": "number"}

_ROBOT = re.compile(r"/robots/(.+)/(state|description|log|gone)")
_VIEW = re.compile(r"/views/(.+)/([^/]+)")


class RecordedPicture(NamedTuple):
    """One picture."""

    view: str
    camera: str
    jpeg: bytes


class RecordedLine(NamedTuple):
    """One line of an agent's log."""

    name: str
    line: LoggedLine


class RecordedState(NamedTuple):
    """How a robot was."""

    name: str
    state: State


class RecordedEnd(NamedTuple):
    """A robot that is there no more: deleted, or its process has ended."""

    name: str


Content = RecordedState | RecordedEnd | RobotDescription | RecordedLine | HistoryEvent | RecordedPicture


Kind = TypeVar("Kind", bound=Content)


class Entry(NamedTuple):
    """One thing that was recorded."""

    unix: float
    """[s] since 1970."""
    content: Content


class TapeWriter:
    """Writes a recording to a stream. Raises what the stream raises (`OSError`)."""

    def __init__(self, stream: BinaryIO, about: Mapping[str, str]) -> None:
        """Begin a file; `about`: texts for people by name, such as `realm` and `recorded by`."""
        from mcap.writer import Writer

        self._writer = Writer(stream, chunk_size=CHUNK)
        self._writer.start(profile=PROFILE, library="robotree")
        self._writer.add_metadata("robotree", {"version": VERSION, **about})
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._descriptions: dict[str, RobotDescription] = {}
        self.entries = 0

    def state(self, unix: float, name: str, state: State) -> None:
        """Append the state of a robot; readings that are no number now are left out."""
        finite = {key: value for key, value in state.readings.items() if isfinite(value)}
        state = msgspec.structs.replace(state, readings=finite)
        self._add(f"/robots/{name}/state", unix, msgspec.json.encode(state), _schema_of(State))
        if finite:
            schema = _readings_schema(name, finite)
            self._add(f"/robots/{name}/readings", unix, msgspec.json.encode(finite), schema, counts=False)
        if where := messages.transforms(name, finite, self._descriptions.get(name), unix):
            schema = _foxglove("foxglove.FrameTransforms")
            self._add(messages.TRANSFORMS, unix, _encoded(where), schema, counts=False)

    def description(self, unix: float, description: RobotDescription) -> None:
        """Append the description of a robot, if it is not the one that is there already."""
        lasting = _lasting(description)
        if self._descriptions.get(description.name) == lasting:
            return
        self._descriptions[description.name] = lasting
        topic = f"/robots/{description.name}/description"
        self._add(topic, unix, msgspec.json.encode(description), _schema_of(RobotDescription))

    def gone(self, unix: float, name: str) -> None:
        """Append that a robot is there no more."""
        self._descriptions.pop(name, None)
        self._add(f"/robots/{name}/gone", unix, b"{}", ("robotree.Gone", _encoded({"type": "object"})))

    def line(self, name: str, line: LoggedLine) -> None:
        """Append a line of an agent's log."""
        self._add(f"/robots/{name}/log", line.unix, msgspec.json.encode(line), _schema_of(LoggedLine))
        self._add(
            "/log", line.unix, _encoded(messages.log(name, line)), _foxglove("foxglove.Log"), counts=False
        )

    def event(self, event: HistoryEvent) -> None:
        """Append an event of a history."""
        self._add("/events", event.unix, msgspec.json.encode(event), _schema_of(HistoryEvent))

    def picture(self, unix: float, view: str, picture: Picture) -> None:
        """Append a picture of a view."""
        topic = f"/views/{view}/{picture.camera.replace('/', '-')}"
        self._add(topic, unix, _encoded(messages.image(unix, picture)), _foxglove("foxglove.CompressedImage"))

    def flush(self) -> None:
        """End the chunk: all that was written can be read from now on, also after this process is killed."""
        # mcap ends a chunk when it is full or the file is closed, and offers no public way in between
        self._writer._Writer__finalize_chunk()  # type: ignore[attr-defined] # noqa: SLF001

    def close(self) -> None:
        """Write the index; without it the file can still be read from its beginning."""
        self._writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves it without types

    def _add(
        self, topic: str, unix: float, data: bytes, schema: tuple[str, bytes], *, counts: bool = True
    ) -> None:
        name, text = schema
        if (channel := self._channels.get((topic, name))) is None:
            if (number := self._schemas.get(name)) is None:
                number = self._schemas[name] = self._writer.register_schema(name, "jsonschema", text)
            channel = self._writer.register_channel(topic, "json", number)
            self._channels[topic, name] = channel
        nanoseconds = round(unix * 1e9)
        self._writer.add_message(channel, nanoseconds, data, nanoseconds)
        self.entries += counts


class Tape:
    """What is read of a recording: the entries in the order of their times."""

    def __init__(
        self,
        about: Mapping[str, str],
        entries: Iterable[Entry],
        *,
        whole: bool,
        name: str,
        growing: bool = False,
    ) -> None:
        """Made by `read`."""
        self.growing = growing and not whole
        """Whether it is still being written: then it ends where its writer was when it was read."""
        self.about = about
        self.entries = sorted(entries, key=lambda entry: entry.unix)
        self.whole = whole
        """Whether it was closed by its writer; else it ends where the writer was killed, or is damaged."""
        self.name = name
        """Of its file."""

    @property
    def end_in_words(self) -> str:
        """Why it has no end that its writer wrote, as a clause; empty: it has."""
        if self.whole:
            return ""
        return "it is still being written" if self.growing else "it was cut off, or its end is damaged"

    @property
    def began(self) -> float:
        """[s] since 1970: who described itself then was there already."""
        try:
            began = float(self.about.get("began", "inf"))
        except ValueError:
            began = inf
        first = self.entries[0].unix
        return began if 0.0 <= began <= first else first

    @property
    def ended(self) -> float:
        """[s] since 1970."""
        return self.entries[-1].unix

    def all_of(self, kind: type[Kind]) -> Iterator[tuple[float, Kind]]:
        """Yield what is of one kind, each with its time [s since 1970]."""
        for unix, content in self.entries:
            if isinstance(content, kind):
                yield unix, content

    def described(self) -> dict[str, RobotDescription]:
        """Return how each robot described itself last, by name."""
        return {robot.name: robot for _, robot in self.all_of(RobotDescription)}

    def peaks(self) -> dict[str, dict[str, tuple[float, float]]]:
        """Return the least and the largest value of each reading of each robot."""
        found = dict[str, dict[str, tuple[float, float]]]()
        for _, (name, state) in self.all_of(RecordedState):
            of_robot = found.setdefault(name, {})
            for key, value in state.readings.items():
                low, high = of_robot.get(key, (value, value))
                of_robot[key] = (min(low, value), max(high, value))
        return found


def read(stream: BinaryIO, name: str, *, growing: bool = False) -> Tape:
    """Read a recording whole.

    Args:
        stream: the bytes of the file.
        name: of the file, for messages.
        growing: whether somebody writes it at this moment.

    Raises:
        BadRecordedRealm: it is no recording of a realm, of another version, or nothing of it can be read.
    """
    reading = _Reading()
    # the library raises what it likes at bytes that are cut off or forged
    with suppress(Exception):
        for record in _records(stream):
            reading.take(record)
            if reading.version != VERSION:
                break
    if reading.profile != PROFILE:
        raise BadRecordedRealm(name, "is no recording of a realm; `robotree record FILE` makes one")
    if reading.version != VERSION:
        detail = f"has version {reading.version} of the format, and this robotree reads {VERSION}"
        raise BadRecordedRealm(name, f"{detail}: read it with the robotree that has recorded it")
    if not reading.entries:
        detail = "holds nothing that can be read: its beginning is damaged, or it is empty"
        raise BadRecordedRealm(name, detail)
    return Tape(reading.about, reading.entries, whole=reading.whole, name=name, growing=growing)


class _Reading:
    """What is known of a file while it is read."""

    def __init__(self) -> None:
        self.profile, self.whole = "", False
        self.about: Mapping[str, str] = {}
        self.entries = list[Entry]()
        self._topics = dict[int, str]()

    @property
    def version(self) -> str:
        return self.about.get("version", VERSION)

    def take(self, record: McapRecord) -> None:
        from mcap.records import Channel, Footer, Header, Message, Metadata

        match record:
            case Header():
                self.profile = record.profile
            case Metadata(name="robotree"):
                self.about = dict(record.metadata)
            case Channel():
                self._topics[record.id] = record.topic
            case Message():
                content = _content(self._topics.get(record.channel_id, ""), record.data)
                if content is not None:
                    self.entries.append(Entry(record.log_time / 1e9, content))
            case Footer():
                self.whole = True
            case _:
                pass


def _records(stream: BinaryIO) -> Iterable[McapRecord]:
    """Read the records one after the other; neither a forged length nor a forged chunk fills the memory."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    reader = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=LARGEST_RECORD)
    for record in reader.records:
        if isinstance(record, Chunk):
            yield from breakup_chunk(inflated(record), validate_crc=True)
        else:
            yield record


_OF_ROBOTS: Final[Mapping[str, Callable[[str, bytes], Content]]] = {
    "state": lambda name, data: RecordedState(name, msgspec.json.decode(data, type=State)),
    "description": lambda _, data: msgspec.json.decode(data, type=RobotDescription),
    "log": lambda name, data: RecordedLine(name, msgspec.json.decode(data, type=LoggedLine)),
    "gone": lambda name, _: RecordedEnd(name),
}
"""How a message is read, by the last word of its topic."""


def _content(topic: str, data: bytes) -> Content | None:
    """Return what a message says; None: it is said elsewhere, too, or by a later version.

    Raises:
        VrError: a name cannot be one.
        ValueError: it cannot be read.
    """
    if topic == "/events":
        event = msgspec.json.decode(data, type=HistoryEvent)
        parted(event.robot)
        return event
    if found := _ROBOT.fullmatch(topic):
        parted(found[1])
        return _OF_ROBOTS[found[2]](found[1], data)
    if found := _VIEW.fullmatch(topic):
        parted(found[1])
        said = json.loads(data)
        return RecordedPicture(found[1], str(said["frame_id"]), base64.b64decode(said["data"]))
    return None


def _lasting(description: RobotDescription) -> RobotDescription:
    """Leave out what states say as well: a description is new only where something else has changed."""
    bond = description.bond
    return msgspec.structs.replace(
        description, busy="", waiting=0, readings={}, calls={}, stops=0, stopped=False, stop_reason="",
        epoch=0, bond=None if bond is None else msgspec.structs.replace(bond, remaining=0.0),
        kept={}, held="", paused="", drill="", abandoned=(), asks="", online=True,
    )  # fmt: skip


def _encoded(said: Mapping[str, Any]) -> bytes:
    return json.dumps(said).encode()


def _foxglove(name: str) -> tuple[str, bytes]:
    return name, _encoded(messages.SCHEMAS[name])


_made: dict[type, tuple[str, bytes]] = {}
"""The schemas of our own messages."""


def _schema_of(kind: type[msgspec.Struct]) -> tuple[str, bytes]:
    """Return the name and the JSON schema of one of our own messages: its fields, none of them required."""
    if kind not in _made:
        properties: dict[str, Any] = {field.name: {} for field in msgspec.structs.fields(kind)}
        schema = {"title": kind.__name__, "type": "object", "properties": properties}
        _made[kind] = (f"robotree.{kind.__name__}", _encoded(schema))
    return _made[kind]


def _readings_schema(name: str, readings: Mapping[str, float]) -> tuple[str, bytes]:
    """Return the schema of the readings of one robot; other readings are another schema."""
    keys = sorted(readings)
    properties = dict.fromkeys(keys, _NUMBER)
    schema = {"title": f"readings of {name}", "type": "object", "properties": properties}
    return f"robotree.readings.{name}.{'+'.join(keys)}", _encoded(schema)
