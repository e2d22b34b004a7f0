"""The log of candump (`candump -l`, `candump -L`, python-can's .log): CAN frames become MAVLink frames. Pure.

One line per frame; CAN FD has `##` and one digit of flags, and python-can and newer can-utils end a line with
the direction::

    (1436509053.850870) can0 0CDA0180#074865617274
    (1436509053.850871) can0 14DBFF01##1002A4C...  R

Identifiers are those of `robotree.protocol.links.can.identifiers`, payloads are ISO-TP; a listener hears both
directions and answers nothing. Frames of other uses of the bus are counted.
"""

from __future__ import annotations

import re

import msgspec

from robotree.protocol.isotp.frames import (
    ConsecutiveFrame,
    FirstFrame,
    FlowControl,
    SingleFrame,
    decode,
)
from robotree.protocol.isotp.receiver import Receiver
from robotree.protocol.links.can.identifiers import Kind, taken_apart
from robotree.protocol.tools.capture.records import Captured

LONGEST_LINE = 4096
"""[bytes]"""
MAX_ENTRIES = 1024
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
