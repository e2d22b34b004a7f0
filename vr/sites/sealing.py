"""Seals each message between two gateways, and opens each once and in order. Pure.

ChaCha20-Poly1305 (RFC 8439) with a key for each direction. The nonce is the lane and the number of the
message on it, so it is never used twice; both are authenticated. What was opened is not opened again, and
what comes before its predecessors is not opened at all, except on a lane that may lose.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct
from typing import NamedTuple

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

ID_SIZE = 8
"""[bytes] of the id of a session."""

_HEAD = Struct(f">{ID_SIZE}sBQ")
_NONCE = Struct(">3xBQ")
OVERHEAD = _HEAD.size + 16
"""[bytes] by which a message grows."""


class Lane(IntEnum):
    """Messages of one lane arrive in their order; a lane with a smaller number goes first."""

    BEAT = 0
    """Signs of life and receipts: the newest counts, so some may be lost."""
    URGENT = 1
    """Stops, renewals and presence."""
    NORMAL = 2
    """Requests and replies."""
    BULK = 3
    """Large ones, in pieces."""
    SAMPLES = 4
    """What is published; some may be lost, as of beats."""


LOSSY = frozenset({Lane.BEAT, Lane.SAMPLES})


class Verdict(IntEnum):
    """What became of a packet."""

    GOOD = 0
    FOREIGN = 1
    """Of another session, or none at all."""
    FORGED = 2
    """Somebody without the key made or changed it."""
    REPLAYED = 3
    """It was opened before, here; also what is sent again because its receipt was lost."""
    EARLY = 4
    """One before it has not come: it will be sent again."""


class Opened(NamedTuple):
    """What a packet was."""

    verdict: Verdict
    lane: Lane = Lane.URGENT
    number: int = 0
    body: bytes = b""


_BAD = {verdict: Opened(verdict) for verdict in Verdict}
_LANES = tuple(Lane)


class Sealing:
    """One session between two gateways. Not for several threads at once."""

    __slots__ = ("_mine", "_next", "_sent", "_theirs", "session")

    def __init__(self, session: bytes, mine: bytes, theirs: bytes) -> None:
        """Begin.

        Args:
            session: its id.
            mine: key of what this side sends, 32 bytes.
            theirs: of what the other side sends.
        """
        self.session = session
        self._mine, self._theirs = ChaCha20Poly1305(mine), ChaCha20Poly1305(theirs)
        self._sent = [0] * len(Lane)
        self._next = [0] * len(Lane)

    def seal(self, lane: Lane, body: bytes) -> bytes:
        """Return a message as a packet: the next one of its lane."""
        number = self._sent[lane]
        self._sent[lane] = number + 1
        head = _HEAD.pack(self.session, lane, number)
        return head + self._mine.encrypt(_NONCE.pack(lane, number), body, head)

    def open(self, packet: bytes) -> Opened:
        """Open a packet, once. Whatever comes from a network, nothing raises."""
        if len(packet) < OVERHEAD:
            return _BAD[Verdict.FOREIGN]
        head: tuple[bytes, int, int] = _HEAD.unpack_from(packet)
        session, code, number = head
        if session != self.session or code >= len(_LANES):
            return _BAD[Verdict.FOREIGN]
        lane, expected = _LANES[code], self._next[code]
        if number < expected:
            return _BAD[Verdict.REPLAYED]
        if number > expected and lane not in LOSSY:
            return _BAD[Verdict.EARLY]
        nonce = _NONCE.pack(code, number)
        try:
            body = self._theirs.decrypt(nonce, packet[_HEAD.size :], packet[: _HEAD.size])
        except InvalidTag:
            return _BAD[Verdict.FORGED]
        self._next[code] = number + 1
        return Opened(Verdict.GOOD, lane, number, body)

    def expects(self) -> tuple[int, ...]:
        """Return the number of the next message of each lane that has not come: a receipt for all before."""
        return tuple(self._next)

    def sent(self, lane: Lane) -> int:
        """Return how many messages of a lane were sealed."""
        return self._sent[lane]
