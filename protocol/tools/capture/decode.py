"""From the bytes of any recording to frames, with everything counted. Pure; nothing that is fed can raise."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from robotree.protocol.parser import Parser
from robotree.protocol.tools.capture import mcap
from robotree.protocol.tools.capture.candump import CandumpReader, CandumpStatistics
from robotree.protocol.tools.capture.framing import Splitter, known, msgid
from robotree.protocol.tools.capture.mcap import McapReader
from robotree.protocol.tools.capture.records import Captured, plain_fields, plausible_time
from robotree.protocol.tools.capture.tlog import STAMP_BYTES, TlogReader, plausible

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame
    from robotree.protocol.parser import Verifier

HEAD_BYTES = STAMP_BYTES + 1
"""[bytes] from which `detect` can tell."""
MAX_ENTRIES = 1024
"""Routes and speakers that are told apart; further ones share a last place."""
_OTHERS = "others"


class Reader(Protocol):
    """Takes the bytes of one format apart."""

    skipped: int
    """[bytes] that belong to nothing."""

    def feed(self, data: bytes) -> list[Captured]:
        """Take some bytes, whatever they are."""
        ...

    def flush(self) -> list[Captured]:
        """There are no more."""
        ...


class RawReader:
    """A stream as it was on the wire, without times."""

    skipped = 0

    def feed(self, data: bytes) -> list[Captured]:
        """Hand the bytes on."""
        return [Captured(data)] if data else []

    def flush(self) -> list[Captured]:
        """Nothing was kept."""
        return []


READERS: dict[str, type[Reader]] = {
    "raw": RawReader,
    "tlog": TlogReader,
    "mcap": McapReader,
    "candump": CandumpReader,
}
"""Every format that is read."""


def detect(head: bytes, name: str = "") -> str:
    """The format of a recording.

    Args:
        head: its first bytes, HEAD_BYTES or more if there are so many.
        name: of its file.
    """
    if name.endswith(".tlog") or plausible(head):
        return "tlog"
    if head.startswith(mcap.MAGIC):
        return "mcap"
    text = head.lstrip()
    return "candump" if text[:1] == b"(" and text[1:2].isdigit() else "raw"


class Decoded(msgspec.Struct, frozen=True, gc=False):
    """A frame, and when and where it was captured."""

    frame: Frame
    time: int | None
    """[us] since 1970; None: the recording has no times."""
    route: str

    def plain(self) -> dict[str, Any]:
        """As plain data; numbers that JSON does not have become null when msgspec encodes it."""
        data: dict[str, Any] = {
            "msgid": self.frame.msgid,
            "name": self.frame.name,
            "sysid": self.frame.system,
            "compid": self.frame.component,
            "seq": self.frame.sequence,
            "fields": plain_fields(self.frame),
            "signed": self.frame.signed,
        }
        if self.time is not None:
            data["time"] = self.time / 1e6
        if self.route:
            data["route"] = self.route
        return data


class DecoderStatistics(msgspec.Struct, frozen=True, omit_defaults=True):
    """One reading of a decoder's gauges. Those of the parser mean what they mean there."""

    format: str
    bytes: int
    """[bytes] fed."""
    frames: int
    signed: int
    version_1: int
    bad_crc: int
    unknown: int
    incompatible: int
    refused: int
    lost: int
    late: int
    skipped: int
    """[bytes] that belong to no intact frame of a message of the dialect."""
    first: float | None
    """[s] since 1970, of the first frame."""
    last: float | None
    """[s] since 1970, of the last frame."""
    messages: dict[str, int]
    """Frames by the name of their message."""
    speakers: dict[str, int]
    """Frames by system and component."""
    strange: dict[int, int] = {}
    """Frames of messages that the dialect does not have, by id, in parts where little else is."""
    bad_times: int = 0
    """Frames whose time was damaged; they are handed out without one."""
    broken: int = 0
    """Frames in parts of the file that cannot be read."""
    can: CandumpStatistics | None = None


class Decoder:
    """Turns a recording into frames. The memory that it takes has a bound, whatever it is fed.

    Args:
        form: one of `READERS`.
        reader: takes it apart; None: a new one.
        verifier: asked about every intact frame.
    """

    def __init__(self, form: str, reader: Reader | None = None, verifier: Verifier | None = None) -> None:
        self._form = form
        self._reader = reader or READERS[form]()
        self._verifier = verifier
        self._parsers: dict[str, Parser] = {}
        self._messages: Counter[str] = Counter()
        self._speakers: Counter[str] = Counter()
        self._strange: Counter[int] = Counter()
        self._bytes = self._signed = 0
        self._first: int | None = None
        self._last: int | None = None
        self._bad_times = 0

    @property
    def statistics(self) -> DecoderStatistics:
        """The gauges now."""
        each = [parser.statistics for parser in self._parsers.values()]
        reader = self._reader
        return DecoderStatistics(
            format=self._form,
            bytes=self._bytes,
            frames=sum(one.received for one in each),
            signed=self._signed,
            version_1=sum(one.version_1 for one in each),
            bad_crc=sum(one.bad_crc for one in each),
            unknown=sum(one.unknown for one in each),
            incompatible=sum(one.incompatible for one in each),
            refused=sum(one.refused for one in each),
            lost=sum(one.lost for one in each),
            late=sum(one.late for one in each),
            skipped=sum(one.skipped for one in each) + reader.skipped,
            first=None if self._first is None else self._first / 1e6,
            last=None if self._last is None else self._last / 1e6,
            messages=dict(self._messages.most_common()),
            speakers=dict(self._speakers.most_common()),
            strange=dict(self._strange.most_common()),
            bad_times=self._bad_times,
            broken=reader.broken if isinstance(reader, McapReader) else 0,
            can=reader.statistics if isinstance(reader, CandumpReader) else None,
        )

    def feed(self, data: bytes) -> list[Decoded]:
        """Take some bytes, whatever they are, and hand out the frames that they complete."""
        self._bytes += len(data)
        return [one for captured in self._reader.feed(data) for one in self.decode(captured)]

    def flush(self) -> list[Decoded]:
        """The recording ended."""
        found = [one for captured in self._reader.flush() for one in self.decode(captured)]
        for route, parser in self._parsers.items():
            found += [self._count(frame, None, route) for frame in parser.flush()]
        return found

    def decode(self, captured: Captured) -> list[Decoded]:
        """The frames in what a reader handed out."""
        route = captured.route
        if route not in self._parsers and len(self._parsers) >= MAX_ENTRIES:
            route = _OTHERS
        parser = self._parsers.get(route)
        if parser is None:
            parser = self._parsers[route] = Parser(self._verifier)
        frames, time = parser.feed(captured.data), captured.time
        if time is not None:  # what was captured at one moment is whole
            frames += parser.flush()
        if not frames:
            self._strange.update(_strangers(captured.data, MAX_ENTRIES - len(self._strange)))
        if time is not None and not plausible_time(time):
            self._bad_times += len(frames)
            time = None
        return [self._count(frame, time, route) for frame in frames]

    def _count(self, frame: Frame, time: int | None, route: str) -> Decoded:
        speaker = f"{frame.system}/{frame.component}"
        self._messages[frame.name] += 1
        told_apart = speaker in self._speakers or len(self._speakers) < MAX_ENTRIES
        self._speakers[speaker if told_apart else _OTHERS] += 1
        self._signed += frame.signed
        if time is not None:
            self._first = time if self._first is None else self._first
            self._last = time
        return Decoded(frame, time, route)


def _strangers(data: bytes, most: int) -> list[int]:
    """The ids of unknown messages, at most so many, whose frames are most of the data; in noise none are."""
    pieces = Splitter().feed(data)
    frames = [piece.data for piece in pieces if piece.framed and not known(piece.data)]
    return [msgid(frame) for frame in frames][:most] if 2 * sum(map(len, frames)) > len(data) else []
