"""From the bytes of any recording to frames, with everything counted. Pure; nothing that is fed can raise.

A log of candump (`candump -l`, `candump -L`, python-can's .log) has one line per frame; CAN FD has `##` and
one digit of flags, and python-can and newer can-utils end a line with the direction::

    (1436509053.850870) can0 0CDA0180#074865617274
    (1436509053.850871) can0 14DBFF01##1002A4C...  R

Identifiers are those of `robotree.protocol.links.can.identifiers`, payloads are ISO-TP; a listener hears both
directions and answers nothing. Frames of other uses of the bus are counted.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from robotree.protocol.isotp.channel import Receiver
from robotree.protocol.isotp.frames import ConsecutiveFrame, FirstFrame, FlowControl, SingleFrame, decode
from robotree.protocol.links.can.identifiers import Kind, taken_apart
from robotree.protocol.parser import Parser
from robotree.protocol.tools.capture import mcap
from robotree.protocol.tools.capture.framing import Splitter, known, msgid
from robotree.protocol.tools.capture.mcap import McapReader
from robotree.protocol.tools.capture.records import Captured, plain_fields, plausible_time
from robotree.protocol.tools.capture.tlog import STAMP_BYTES, TlogReader, plausible

if TYPE_CHECKING:
    from robotree.protocol.frame import Frame
    from robotree.protocol.parser import Verifier

LONGEST_LINE = 4096
"""[bytes]"""
"""Routes that are remembered: what senders forge must not fill the memory."""
_LINE = re.compile(
    rb"\((\d{1,12})\.(\d{1,9})\) +(\S+) +([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#(?:#[0-9A-Fa-f])?([0-9A-Fa-f]*)"
    rb"(?:_[0-9A-Fa-f])?(?: +[RT])?"
)
_EXTENDED_DIGITS = 8
_ERROR_FLAG = 0x20000000


class CandumpStatistics(msgspec.Struct):
    """One reading of a reader's gauges."""

    lines: int = 0
    malformed: int = 0
    """Lines that are no frame, among them remote and error frames."""
    foreign: int = 0
    """Frames of other uses of the bus, link control among them."""
    payloads: int = 0
    """ISO-TP payloads that were whole."""
    broken: int = 0
    """Payloads of which a frame is missing, and frames that belong to no payload."""


class CandumpReader:
    """Takes a log apart, whatever it is. Keeps less than one line and one payload per route."""

    def __init__(self) -> None:
        self._rest = b""
        self._receivers: dict[tuple[str, int], Receiver] = {}
        self._partner: dict[tuple[bytes, int], int] = {}
        self._gauges = CandumpStatistics()
        self.skipped = 0
        """[bytes] that belong to no line."""

    @property
    def statistics(self) -> CandumpStatistics:
        """The gauges now."""
        broken = self._gauges.broken + sum(map(_broken, self._receivers.values()))
        return msgspec.structs.replace(self._gauges, broken=broken)

    def feed(self, data: bytes) -> list[Captured]:
        """Take some bytes and hand out the payloads that they complete."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            self.skipped += len(self._rest)
            self._rest = b""
        return [found for line in lines if (found := self._line(line)) is not None]

    def flush(self) -> list[Captured]:
        """The file ended."""
        return self.feed(b"\n") if self._rest else []

    def _line(self, line: bytes) -> Captured | None:
        line = line.strip()
        if not line:
            return None
        self._gauges.lines += 1
        parts = _LINE.fullmatch(line)
        if parts is None or len(parts[5]) % 2 or int(parts[4], 16) & _ERROR_FLAG:
            self._gauges.malformed += 1
            return None
        time = int(parts[1]) * 1_000_000 + int(parts[2].ljust(6, b"0")[:6])
        field = bytes.fromhex(parts[5].decode())
        kind, target, source = taken_apart(int(parts[4], 16))
        if len(parts[4]) != _EXTENDED_DIGITS or kind not in (Kind.ADDRESSED, Kind.BROADCAST):
            self._gauges.foreign += 1
            return None
        if kind == Kind.ADDRESSED and len(self._partner) < MAX_ENTRIES:
            self._partner[parts[3], source] = target
        elif kind == Kind.BROADCAST:  # it has the sequence number of one of the speaker's links
            target = self._partner.get((parts[3], source), target)
        route = f"{parts[3].decode('ascii', 'replace')}/{source}>{target}"
        payload = self._reassemble((route, kind), field, time)
        return None if payload is None else Captured(payload, time, route)

    def _reassemble(self, stream: tuple[str, int], field: bytes, time: int) -> bytes | None:
        receiver = self._receivers.get(stream)
        if receiver is None:
            if len(self._receivers) >= MAX_ENTRIES:
                self._gauges.foreign += 1
                return None
            receiver = self._receivers[stream] = Receiver()
        now, payload = time / 1e6, None
        match decode(field):
            case SingleFrame() as frame:
                payload = receiver.single(frame)
            case FirstFrame() as frame:
                receiver.first(frame, now)
            case ConsecutiveFrame() as frame:
                payload, _ = receiver.consecutive(frame, now)
            case FlowControl():
                pass
            case None:
                self._gauges.broken += 1
        self._gauges.payloads += payload is not None
        return payload


def _broken(receiver: Receiver) -> int:
    gauges = receiver.statistics
    return gauges.out_of_sequence + gauges.interrupted + gauges.silent + gauges.unexpected + gauges.refused


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
