"""What a link says, as a table of rates, ages and last values, and how well the link does. Pure."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.capture.attendance import Attendance, PeerReading
from robotree.protocol.capture.plain import plain_fields
from robotree.protocol.links.disbelief import disbelief
from robotree.protocol.messages import Timesync, Untyped
from robotree.protocol.parser import Parser
from robotree.protocol.services.timesync import Synchroniser

if TYPE_CHECKING:
    from typing import Any

    from robotree.protocol.frame import Frame
    from robotree.protocol.messages import AnyMessage
    from robotree.protocol.parser import ParserStatistics, Verifier

WINDOW = 2.0
"""[s] over which rates are taken."""
_SHORTEST = 0.1
"""[s] of a window that has only just begun."""
_MOST_ARRIVALS = 4096
"""Arrivals of one message that are remembered; above 2 kHz the window is shorter."""
_NAMED = ("NAMED_VALUE_", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY")
LARGEST_CROWD = 1024
"""Messages that are told apart, by speaker and name."""


class Rate:
    """How often, and how much, over the last few seconds.

    Args:
        began: when counting began, [s].
    """

    def __init__(self, began: float) -> None:
        self._began = began
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=_MOST_ARRIVALS)
        self._amount = 0

    def add(self, now: float, amount: int = 1) -> None:
        """Something came."""
        if len(self._arrivals) == _MOST_ARRIVALS:
            self._amount -= self._arrivals[0][1]
        self._arrivals.append((now, amount))
        self._amount += amount

    def per_second(self, now: float) -> float:
        """The rate at this moment."""
        while self._arrivals and self._arrivals[0][0] <= now - WINDOW:
            self._amount -= self._arrivals.popleft()[1]
        if len(self._arrivals) < _MOST_ARRIVALS:
            return self._amount / min(max(now - self._began, _SHORTEST), WINDOW)
        return self._amount / max(now - self._arrivals[0][0], 1e-6)


class MessageReading(msgspec.Struct, frozen=True):
    """One row of the table."""

    sysid: int
    compid: int
    name: str
    count: int
    rate: float
    """[1/s]"""
    age: float
    """[s] since the last one."""
    fields: dict[str, Any]
    """Of the last one."""


class LinkReading(msgspec.Struct, frozen=True):
    """One reading of a link's gauges."""

    address: str
    bytes_per_second: float
    frames_per_second: float
    frames: int
    lost: int
    loss: float
    """Share of the frames of the last few seconds that never came."""
    bad_crc: int
    unknown: int
    refused: int
    """Intact frames that are not signed with our key; nothing of them is in the table."""
    disbelief: str
    """What is wrong with the keys; empty: nothing."""
    skipped: int
    """[bytes] that belong to no intact frame."""
    delay: float | None
    """[s] that a frame takes one way; None: nobody answers TIMESYNC."""
    offset: float | None
    """[s] to add to our clock to get the far one."""
    peers: list[PeerReading]
    messages: list[MessageReading]


def _instance(message: AnyMessage) -> str:
    """What tells messages of one kind apart: the name of a named value."""
    if not message.codec.definition.name.startswith(_NAMED):
        return ""
    return str(message["name"] if isinstance(message, Untyped) else getattr(message, "name", ""))


class _Row:
    def __init__(self, began: float) -> None:
        self.rate, self.count = Rate(began), 0
        self.last: Frame | None = None
        self.heard = 0.0


class LinkGauge:
    """Watches one link.

    Args:
        address: names it.
        now: [s], of the clock that all other calls use.
        verifier: decides which frames count; None: all do, signed or not.
    """

    def __init__(self, address: str, now: float, verifier: Verifier | None = None) -> None:
        self._address, self._began = address, now
        self._parser = Parser(verifier)
        self._keyless = 0
        self._synchroniser = Synchroniser()
        self._bytes, self._frames, self._lost = Rate(now), Rate(now), Rate(now)
        self._lost_before = 0
        self._rows: dict[tuple[int, int, int, str], _Row] = {}
        self._attendance = Attendance()

    def receive(self, data: bytes, now: float) -> None:
        """The link tells: bytes came."""
        self._bytes.add(now, len(data))
        for frame in self._parser.feed(data):
            self._frames.add(now)
            self._keyless += frame.signed and self._parser.verifier is None
            message = frame.message
            self._attendance.receive(frame, now)
            if isinstance(message, Timesync):
                self._synchroniser.receive(message, now)
            key = frame.system, frame.component, frame.msgid, _instance(message)
            if key not in self._rows and len(self._rows) >= LARGEST_CROWD:
                continue
            row = self._rows.setdefault(key, _Row(self._began))
            row.rate.add(now)
            row.count, row.last, row.heard = row.count + 1, frame, now
        if (missing := self._parser.statistics.lost - self._lost_before) > 0:
            self._lost.add(now, missing)
            self._lost_before += missing

    def questions(self, now: float) -> list[Timesync]:
        """What to ask now to learn how long a frame takes."""
        return self._synchroniser.tick(now)

    def _disbelief(self, parser: ParserStatistics) -> str:
        if self._keyless:
            return f"{self._keyless} frames are signed while this link has no key: nobody vouches for them"
        return "" if parser.received else disbelief(refused=parser.refused, keyless=0)

    def reading(self, now: float) -> LinkReading:
        """The gauges now."""
        parser, estimate = self._parser.statistics, self._synchroniser.estimate
        frames, lost = self._frames.per_second(now), self._lost.per_second(now)
        return LinkReading(
            address=self._address,
            bytes_per_second=self._bytes.per_second(now),
            frames_per_second=frames,
            frames=parser.received,
            lost=parser.lost,
            loss=lost / (frames + lost) if lost else 0.0,
            bad_crc=parser.bad_crc,
            unknown=parser.unknown,
            refused=parser.refused,
            disbelief=self._disbelief(parser),
            skipped=parser.skipped,
            delay=None if estimate is None else estimate.delay,
            offset=None if estimate is None else estimate.offset,
            peers=self._attendance.reading(now),
            messages=[
                MessageReading(
                    sysid=row.last.system,
                    compid=row.last.component,
                    name=row.last.name,
                    count=row.count,
                    rate=row.rate.per_second(now),
                    age=now - row.heard,
                    fields=plain_fields(row.last),
                )
                for _, row in sorted(self._rows.items())
                if row.last is not None
            ],
        )
