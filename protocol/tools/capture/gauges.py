"""A table of the messages of a link (rates, ages, last values), and of its quality. Pure."""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.links.rejection import rejection
from robotree.protocol.messages import Heartbeat, Timesync, Untyped
from robotree.protocol.parser import Parser
from robotree.protocol.services.heartbeat import SILENCE
from robotree.protocol.services.timesync import Synchroniser
from robotree.protocol.tools.capture.records import plain_fields

if TYPE_CHECKING:
    from typing import Any

    from robotree.protocol.frame import Frame
    from robotree.protocol.messages import AnyMessage
    from robotree.protocol.parser import ParserStatistics
    from robotree.protocol.signing import Verifier

WINDOW = 2.0
"""[s] over which rates are taken; longer where that does not hold two arrivals."""
_MOST_ARRIVALS = 4096
"""Arrivals of one message that are remembered; above 2 kHz the window is shorter."""
_NAMED = ("NAMED_VALUE_", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY")
MAX_ENTRIES = 1024
"""Messages that are told apart, by speaker and name."""
MAX_PEERS = 1024
"""Peers that are remembered; a forged stream must not fill the memory."""


class Rate:
    """How often, and how much, over the last few seconds: by the whole intervals between arrivals.

    What came is divided by the time in which it came, not by one that began or ended in the middle of an
    interval: two arrivals of 1 Hz in the first second are 1/s.
    """

    def __init__(self) -> None:
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=_MOST_ARRIVALS)
        self._amount = 0
        """Of all arrivals but the first: an interval belongs to the arrival that ends it."""

    def add(self, now: float, amount: int = 1) -> None:
        """Something came."""
        arrivals = self._arrivals
        if arrivals and arrivals[-1][0] >= now:  # an arrival of several
            moment, before = arrivals.pop()
            arrivals.append((moment, before + amount))
            self._amount += amount if len(arrivals) > 1 else 0
            return
        if len(arrivals) == _MOST_ARRIVALS:
            self._amount -= arrivals[1][1]
        self._amount += amount if arrivals else 0
        arrivals.append((now, amount))

    def per_second(self, now: float) -> float | None:
        """The rate at this moment; None: something came once, and it takes two to tell how often."""
        arrivals = self._arrivals
        while len(arrivals) > 2 and arrivals[1][0] <= now - WINDOW:
            arrivals.popleft()
            self._amount -= arrivals[0][1]
        if len(arrivals) < 2:
            return None if arrivals else 0.0
        (first, _), (last, _), intervals = arrivals[0], arrivals[-1], len(arrivals) - 1
        if now - last > max(WINDOW, 2 * (last - first) / intervals):
            return 0.0
        if_one_came_now = self._amount * (1 + 1 / intervals) / (now - first)
        return min(self._amount / (last - first), if_one_came_now)


class Loss:
    """Which share of the frames of the last few seconds never came."""

    def __init__(self) -> None:
        self._lately: deque[tuple[float, int, int]] = deque(maxlen=_MOST_ARRIVALS)

    def add(self, now: float, came: int, lost: int) -> None:
        """Frames came, and their numbers tell that others did not."""
        if came or lost:
            self._lately.append((now, came, lost))

    def share(self, now: float) -> float:
        """Of all that were sent; 0 to 1."""
        while self._lately and self._lately[0][0] <= now - WINDOW:
            self._lately.popleft()
        came, lost = (sum(each[part] for each in self._lately) for part in (1, 2))
        return lost / (came + lost) if lost else 0.0


class MessageReading(msgspec.Struct, frozen=True):
    """One row of the table."""

    sysid: int
    compid: int
    name: str
    count: int
    rate: float | None
    """[1/s]; None: one has come, and it takes two to tell."""
    age: float
    """[s] since the last one."""
    fields: dict[str, Any]
    """Of the last one."""


class PeerReading(msgspec.Struct, frozen=True):
    """Somebody whose heartbeat was heard."""

    sysid: int
    compid: int
    type: int
    """MAV_TYPE of the latest heartbeat."""
    state: int
    """MAV_STATE of the latest heartbeat."""
    age: float
    """[s] since the last sign of life."""
    there: bool
    """Whether there was one within three heartbeats."""


class PeerTable:
    """Keeps the list of one link."""

    def __init__(self) -> None:
        self._peers: dict[tuple[int, int], tuple[Heartbeat, float]] = {}
        """By system and component: the last heartbeat, and the time of the last sign of life, [s]."""

    def receive(self, frame: Frame, now: float) -> None:
        """Note a sign of life; who is not there is introduced by a heartbeat alone."""
        peer, message = (frame.system, frame.component), frame.message
        beat, heard = self._peers.get(peer, (None, -inf))
        if isinstance(message, Heartbeat):
            beat = message
        elif now - heard >= SILENCE:
            return
        if beat is not None and (peer in self._peers or self._has_room(now)):
            self._peers[peer] = beat, now

    def _has_room(self, now: float) -> bool:
        """Whether another peer can have a place: one that has gone loses its own."""
        if len(self._peers) >= MAX_PEERS:
            gone = next((peer for peer, (_, heard) in self._peers.items() if now - heard >= SILENCE), None)
            if gone is None:
                return False
            del self._peers[gone]
        return True

    def reading(self, now: float) -> list[PeerReading]:
        """Everyone who was ever there, by their ids; at most `MAX_PEERS`."""
        return [
            PeerReading(
                sysid=system,
                compid=component,
                type=beat.type,
                state=beat.system_status,
                age=now - heard,
                there=now - heard < SILENCE,
            )
            for (system, component), (beat, heard) in sorted(self._peers.items())
        ]


class LinkReading(msgspec.Struct, frozen=True):
    """One reading of a link's gauges."""

    address: str
    bytes_per_second: float | None
    frames_per_second: float | None
    """None: as with the rate of a message."""
    frames: int
    lost: int
    loss: float
    """Share of the frames of the last few seconds that never came."""
    bad_crc: int
    unknown: int
    refused: int
    """Intact frames that are not signed with our key; nothing of them is in the table."""
    rejection: str
    """The mistake in the keys; empty: there is none."""
    skipped: int
    """[bytes] that belong to no intact frame."""
    delay: float | None
    """[s] that a frame takes one way; None: nobody answers TIMESYNC."""
    offset: float | None
    """[s] to add to our clock to get the far one."""
    peers: list[PeerReading]
    messages: list[MessageReading]


def _instance(message: AnyMessage) -> str:
    """The key among messages of one kind: the name of a named value."""
    if not message.codec.definition.name.startswith(_NAMED):
        return ""
    return str(message["name"] if isinstance(message, Untyped) else getattr(message, "name", ""))


class _Row:
    def __init__(self) -> None:
        self.rate, self.count = Rate(), 0
        self.last: Frame | None = None
        self.heard = 0.0


class LinkGauge:
    """Watches one link.

    Args:
        address: names it.
        verifier: decides which frames count; None: all do, signed or not.
    """

    def __init__(self, address: str, verifier: Verifier | None = None) -> None:
        self._address = address
        self._parser, self._verifier = Parser(verifier), verifier
        self._keyless = 0
        self._synchroniser = Synchroniser()
        self._bytes, self._frames, self._loss = Rate(), Rate(), Loss()
        self._lost_before = 0
        self._rows: dict[tuple[int, int, int, str], _Row] = {}
        self._peers = PeerTable()

    def receive(self, data: bytes, now: float) -> None:
        """Bytes came."""
        self._bytes.add(now, len(data))
        frames = self._parser.feed(data)
        for frame in frames:
            self._frames.add(now)
            self._keyless += frame.signed and self._verifier is None
            message = frame.message
            self._peers.receive(frame, now)
            if isinstance(message, Timesync):
                self._synchroniser.receive(message, now)
            key = frame.system, frame.component, frame.msgid, _instance(message)
            if key not in self._rows and len(self._rows) >= MAX_ENTRIES:
                continue
            row = self._rows.setdefault(key, _Row())
            row.rate.add(now)
            row.count, row.last, row.heard = row.count + 1, frame, now
        lost = self._parser.statistics.lost
        self._loss.add(now, len(frames), max(lost - self._lost_before, 0))
        self._lost_before = max(lost, self._lost_before)

    def questions(self, now: float) -> list[Timesync]:
        """The questions to send now to learn how long a frame takes."""
        return self._synchroniser.tick(now)

    def _disbelief(self, parser: ParserStatistics) -> str:
        if self._keyless:
            return f"{self._keyless} frames are signed while this link has no key: they cannot be checked"
        return "" if parser.received else rejection(self._verifier)

    def reading(self, now: float) -> LinkReading:
        """The gauges now."""
        parser, estimate = self._parser.statistics, self._synchroniser.estimate
        return LinkReading(
            address=self._address,
            bytes_per_second=self._bytes.per_second(now),
            frames_per_second=self._frames.per_second(now),
            frames=parser.received,
            lost=parser.lost,
            loss=self._loss.share(now),
            bad_crc=parser.bad_crc,
            unknown=parser.unknown,
            refused=parser.refused,
            rejection=self._disbelief(parser),
            skipped=parser.skipped,
            delay=None if estimate is None else estimate.delay,
            offset=None if estimate is None else estimate.offset,
            peers=self._peers.reading(now),
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
