"""The sealed way to one other gateway: lanes, receipts, repetition, and how much may be under way. Pure.

A router loses what it carries when it dies. So each message that must arrive is kept until the other side's
receipt has come, and repeated if a receipt shows that it was lost: the same packet, which is opened once.
What is urgent leaves at once. Everything else waits until less is under way than the line carries in about
`QUEUE` seconds: behind more than that a stop would wait in the buffers of the line, where no priority helps.

Beats go each `BEAT` seconds. They carry the receipts, and the echo of the last beat, so that both sides know
the time of the way there and back. No clock of the other machine is compared with the own one: a message
carries when it was sent, and how much longer than the shortest beat of late it took is its delay.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import msgspec

from robotree.vr.sites.sealing import LOSSY, Lane, Sealing, Verdict

BEAT = 0.5
"""[s] between two beats."""

PIECE = 1024
"""[bytes] of a message; longer ones go in pieces, so that a beat never waits behind more than one."""

QUEUE = 0.1
"""[s] by which the way there and back may be longer than at its best before less is sent."""

LEAST_WINDOW, FIRST_WINDOW, MOST_WINDOW = 1024, 1 << 12, 1 << 20
"""[bytes] that may be under way and are not urgent."""

MOST_WAITING = 16 << 20
"""[bytes] that may wait for a site; with more, its session ends."""

LONGEST = 16 << 20
"""[bytes] of a message in pieces."""

REMEMBERED = 10.0
"""[s] for which the shortest way of a beat counts."""

PROBE = 8.0
"""[s] after which the line is emptied for a moment on purpose: else a queue that never ends would count as
the length of the way (as in BBR, Cardwell et al., 2016)."""

_WHOLE, _MORE, _LAST, _BEAT = b"\0", b"\1", b"\2", b"\3"


class _Beat(msgspec.Struct, frozen=True, array_like=True):
    sent: float
    """[s] on the sender's clock."""
    echo: float
    """`sent` of the last beat that has come; 0: none."""
    held: float
    """[s] between the arrival of that one and this one."""
    expects: tuple[int, ...]
    """Number of the next message of each lane."""


_encode = msgspec.msgpack.Encoder().encode
_beats = msgspec.msgpack.Decoder(_Beat)


class _Kept(NamedTuple):
    """A packet whose receipt has not come."""

    number: int
    packet: bytes
    sent: float
    """[s] on the own clock: when it left, last."""


class Full(Exception):
    """More waits for a site than may: it reads nothing."""


class _Shortest:
    """The smallest of the numbers that came within `REMEMBERED`."""

    def __init__(self) -> None:
        self._found: deque[tuple[float, float]] = deque()
        """When, and the number, growing; the others can never be the smallest again."""

    def add(self, now: float, number: float) -> None:
        while self._found and self._found[-1][1] >= number:
            self._found.pop()
        self._found.append((now, number))
        while now - self._found[0][0] > REMEMBERED:
            self._found.popleft()

    def least(self, otherwise: float) -> float:
        return self._found[0][1] if self._found else otherwise


class SiteStream:
    """See the module. Not for several threads at once."""

    def __init__(self, sealing: Sealing, now: float) -> None:
        """Begin with a session [s, on this machine's monotonic clock]."""
        self._sealing = sealing
        self._waiting: dict[Lane, deque[tuple[bytes, bytes, float]]] = {lane: deque() for lane in Lane}
        """Kind, body, and until when it is of use [s]."""
        self._newest: dict[str, bytes] = {}
        """Samples that wait, the newest of each key."""
        self._kept: dict[Lane, deque[_Kept]] = {lane: deque() for lane in Lane}
        self._repeat: deque[bytes] = deque()
        self._waits = self._under_way = 0
        """[bytes]"""
        self._window = float(FIRST_WINDOW)
        self._limited = False
        """Whether the window has held something back since the last receipt."""
        self._pieces = bytearray()
        self._beaten = -math.inf
        self._unreported = 0
        """[bytes] that have come since the last beat left."""
        self._echo = (0.0, 0.0)
        self._beats: deque[float] = deque()
        """[s] When the beats left of which no echo has come, the oldest first."""
        self._ways = _Shortest()
        """Of beats: when they came on this clock, less when they were sent on the other one [s]."""
        self._round_trips = _Shortest()
        """[s]"""
        self._fitted = self._probed = now
        """[s] when the window was fitted, and the line emptied."""
        self.heard = now
        """[s] when something good came last."""
        self.round_trip = 0.0
        """[s] of the way there and back, of late; 0: not known yet."""
        self.counts = dict.fromkeys(Verdict, 0)
        """Packets that came, by what became of them."""
        self.repeated = 0
        """Packets that were sent again."""

    @property
    def session(self) -> bytes:
        """Its id."""
        return self._sealing.session

    def silence(self, now: float) -> float:
        """Return for how long nothing good has come [s]."""
        return now - self.heard

    def delay(self, sent: float, now: float) -> float:
        """Return how long a message took [s], at least half of the shortest way there and back.

        Args:
            sent: [s] on the other clock, as the message says.
            now: [s] on the own clock.
        """
        shortest = self._ways.least(now - sent)
        return max(now - sent - shortest, 0.0) + self._round_trips.least(0.0) / 2

    @property
    def rate(self) -> float:
        """How many bytes per second the line carries, about: at least, while nothing had to wait."""
        return self._window / (self._round_trips.least(0.0) + QUEUE)

    @property
    def way(self) -> float:
        """[s] that the shortest way there and back took of late; 0: not known yet."""
        return self._round_trips.least(0.0)

    # -- sending

    def put(self, lane: Lane, body: bytes, *, until: float = math.inf) -> None:
        """Have a message sent.

        Args:
            lane: it arrives behind all that was put on this lane before; but a long one goes by `BULK`.
            body: the message.
            until: [s] after which it is of no use, if it has not left by then.

        Raises:
            Full: too much waits already.
        """
        if self._waits + len(body) > MOST_WAITING:
            raise Full
        self._waits += len(body)
        if len(body) <= PIECE or lane is Lane.URGENT:
            self._waiting[lane].append((_WHOLE, body, until))
            return
        last = (len(body) - 1) // PIECE * PIECE
        for begin in range(0, last, PIECE):
            self._waiting[Lane.BULK].append((_MORE, body[begin : begin + PIECE], math.inf))
        self._waiting[Lane.BULK].append((_LAST, body[last:], math.inf))

    def publish(self, key: str, body: bytes) -> None:
        """Have a sample sent, in place of an older one of its key that still waits."""
        self._newest.pop(key, None)
        self._newest[key] = body

    def take(self, now: float) -> list[bytes]:
        """Return the packets that leave now, in their order."""
        if now - self._probed > PROBE + 2 * self._round_trips.least(0.0) + QUEUE:
            self._probed = now
        leaving = list(self._repeat)
        self._repeat.clear()
        if now - self._beaten >= BEAT or self._unreported > self._window / 4:
            leaving.append(self._beat(now))
        for lane in (Lane.URGENT, Lane.NORMAL, Lane.BULK):
            self._leave(lane, now, leaving)
        while self._newest and not self._waiting[Lane.BULK] and self._room(now):
            key = next(iter(self._newest))
            body = self._newest.pop(key)
            lane = Lane.SAMPLES if len(body) <= PIECE else Lane.BULK
            self.put(lane, body)
            self._leave(lane, now, leaving)
        return leaving

    # -- receiving

    def receive(self, packet: bytes, now: float) -> bytes | None:
        """Take a packet.

        Returns:
            The message that is complete with it; None: there is none.
        """
        opened = self._sealing.open(packet)
        self.counts[opened.verdict] += 1
        if opened.verdict is not Verdict.GOOD:
            return None
        self.heard = now
        kind, body = opened.body[:1], opened.body[1:]
        if opened.lane is Lane.BEAT:
            self._take_beat(body, now)
            return None
        if opened.lane is not Lane.URGENT:
            self._unreported += len(packet)
        if kind == _WHOLE:
            return body
        if len(self._pieces) <= LONGEST:
            self._pieces += body
        if kind == _MORE:
            return None
        whole, self._pieces = bytes(self._pieces), bytearray()
        return whole if len(whole) <= LONGEST else None

    # -- inside -----------------------------------------------------------------------------------

    def _room(self, now: float) -> bool:
        """Whether something that is not urgent may leave."""
        probing = now - self._probed > PROBE
        if self._under_way < (LEAST_WINDOW if probing else self._window):
            return True
        self._limited = True
        return False

    def _leave(self, lane: Lane, now: float, leaving: list[bytes]) -> None:
        waiting = self._waiting[lane]
        while waiting and (lane is Lane.URGENT or self._room(now)):
            kind, body, until = waiting.popleft()
            self._waits -= len(body)
            if until < now:
                continue
            number = self._sealing.sent(lane)
            packet = self._sealing.seal(lane, kind + body)
            self._kept[lane].append(_Kept(number, packet, now))
            if lane is not Lane.URGENT:
                self._under_way += len(packet)
            else:
                self._waits += len(packet)
            leaving.append(packet)

    def _beat(self, now: float) -> bytes:
        self._beaten, self._unreported = now, 0
        self._beats.append(now)
        echo, came = self._echo
        beat = _Beat(now, echo, now - came, self._sealing.expects())
        return self._sealing.seal(Lane.BEAT, _BEAT + _encode(beat))

    def _take_beat(self, body: bytes, now: float) -> None:
        try:
            beat = _beats.decode(body)
        except msgspec.MsgspecError:
            return  # of another version; it has the key, so it is no attack
        self._echo = (beat.sent, now)
        self._ways.add(now, now - beat.sent)
        measured = 0.0
        while self._beats and self._beats[0] <= beat.echo:
            measured = now - self._beats.popleft() - beat.held
        if measured:
            self._round_trips.add(now, measured)
        if self._beats:  # one that is still under way takes at least as long
            under_way = now - self._beats[0]
            measured = max(measured, under_way if under_way > self.round_trip else 0.0)
        if measured:
            self._fit(measured, now)
        for lane, expected in zip(Lane, beat.expects, strict=False):
            self._take_receipt(lane, expected, beat.echo, now)

    def _fit(self, round_trip: float, now: float) -> None:
        """Fit the window to the queue that the way there and back shows."""
        self.round_trip = round_trip
        if now - self._fitted < self.round_trip:
            return  # what the last change brought is not seen yet
        self._fitted, limited, self._limited = now, self._limited, False
        if self.round_trip > self._round_trips.least(0.0) + QUEUE:
            self._window = max(LEAST_WINDOW, self._window * 0.6)
        elif limited:
            self._window = min(MOST_WINDOW, self._window * 1.3)

    def _take_receipt(self, lane: Lane, expected: int, echo: float, now: float) -> None:
        """Forget what has come, and repeat what was lost: this was sent after a later beat of ours had come.

        Args:
            lane: of which it is the receipt.
            expected: number of the next message there.
            echo: [s] on the own clock, when the last beat left that has come there.
            now: [s] on the own clock.
        """
        kept = self._kept[lane]
        while kept and (kept[0].number < expected or (lane in LOSSY and kept[0].sent < echo)):
            size = len(kept.popleft().packet)
            if lane is Lane.URGENT:
                self._waits -= size
            else:
                self._under_way -= size
        if lane not in LOSSY and kept and kept[0].sent < echo:
            self._kept[lane] = deque(one._replace(sent=now) for one in kept)
            self._repeat.extend(one.packet for one in kept)
            self.repeated += len(kept)
