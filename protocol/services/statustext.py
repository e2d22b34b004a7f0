"""STATUSTEXT: sentences for people, in chunks of 50 bytes if they are longer."""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.codec import AS_LONG
from robotree.protocol.messages import AnyMessage, MavSeverity, Statustext, Untyped
from robotree.protocol.services.peer import Peer

if TYPE_CHECKING:
    from collections.abc import Hashable

    from robotree.protocol.frame import Frame

CHUNK = 50
"""[bytes]"""
LONGEST = CHUNK * 20
"""[bytes] of one sentence; the wire would allow 12 750."""
CHUNKS_WITHIN = 2.0
"""[s] until a sentence with missing chunks is told as it is."""
MAX_PEERS = 64
"""Unfinished sentences that are kept."""


class Sentence(msgspec.Struct, frozen=True):
    """A whole sentence from a peer."""

    peer: Peer
    severity: int
    text: str


class StatustextSender:
    """Cuts sentences into chunks, and numbers them."""

    def __init__(self) -> None:
        self._id = 0

    def say(self, severity: MavSeverity, text: str) -> list[AnyMessage]:
        """The messages that carry a sentence; what is longer than `LONGEST` is cut off."""
        data = text.replace("\0", " ").encode()[:LONGEST]
        if len(data) <= CHUNK:
            return [_chunk(severity, data, 0, 0)]
        self._id = self._id % 0xFFFF + 1
        # A chunk without a zero promises another, so a text that fills its last chunk needs an empty one.
        pieces = [data[i : i + CHUNK] for i in range(0, len(data) + 1, CHUNK)]
        return [_chunk(severity, piece, self._id, i) for i, piece in enumerate(pieces)]


def _chunk(severity: int, data: bytes, number: int, place: int) -> AnyMessage:
    """Bytes, because a chunk may end inside a character."""
    return Untyped(Statustext.codec.definition.id, (severity, data, number, place))


class _Unfinished:
    def __init__(self, severity: int, since: float) -> None:
        self.severity, self.since = severity, since
        self.pieces: dict[int, bytes] = {}
        self.count: int | None = None

    def sentence(self, peer: Peer) -> Sentence:
        count = self.count if self.count is not None else max(self.pieces) + 2
        data = b"".join(self.pieces.get(i, b"[...]") for i in range(count))
        return Sentence(peer, self.severity, data.decode("utf-8", AS_LONG))


class StatustextReceiver:
    """Joins chunks to sentences; one with missing chunks is returned after `CHUNKS_WITHIN`."""

    def __init__(self) -> None:
        self._unfinished: dict[tuple[Peer, int], _Unfinished] = {}

    def receive(self, frame: Frame, via: Hashable, now: float) -> list[Sentence]:
        """Take a frame; the sentence that it completes."""
        message = frame.message
        if not isinstance(message, Statustext):
            return []
        peer = Peer(via, frame.system, frame.component)
        if message.id == 0:
            return [Sentence(peer, message.severity, message.text)]
        key = (peer, message.id)
        if key not in self._unfinished and len(self._unfinished) >= MAX_PEERS:
            del self._unfinished[next(iter(self._unfinished))]
        whole = self._unfinished.setdefault(key, _Unfinished(message.severity, now))
        piece = frame.payload[1 : 1 + CHUNK].split(b"\0", 1)[0]
        whole.pieces[message.chunk_seq] = piece
        if len(piece) < CHUNK:
            whole.count = message.chunk_seq + 1
        if whole.count is None or any(i not in whole.pieces for i in range(whole.count)):
            return []
        del self._unfinished[key]
        return [whole.sentence(peer)]

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]."""
        if not self._unfinished:
            return inf
        return min(whole.since for whole in self._unfinished.values()) + CHUNKS_WITHIN

    def tick(self, now: float) -> list[Sentence]:
        """The sentences that will not be completed any more, with their gaps marked."""
        if not self._unfinished:
            return []
        late = [key for key, whole in self._unfinished.items() if now >= whole.since + CHUNKS_WITHIN]
        return [self._unfinished.pop(key).sentence(key[0]) for key in late]
