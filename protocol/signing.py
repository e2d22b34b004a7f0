"""MAVLink 2 signing: who has the key may speak, and nothing may be said twice. Pure.

A signature is the id of the link, a timestamp and the first six bytes of SHA-256 over key, frame, link id and
timestamp. Three things are done otherwise than in the tools around us, each because of a known attack:

* the hash is verified before the timestamp is believed, else one forged frame from the far future locks the
  honest speaker out for ever;
* our own time starts at the wall clock or at the time that was persisted, whichever is later, never at zero,
  else a fresh receiver accepts any old recording;
* one table of streams serves all links, else a recording of one link can be played on another.
"""

from __future__ import annotations

import hashlib
from hmac import compare_digest
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.protocol.frame import Frame

KEY_BYTES = 32
EPOCH = 1420070400
"""[s] of Unix time at the beginning of 2015, when signing timestamps are 0."""
UNITS = 100_000
"""Timestamps per second: they count 10 microseconds."""
OLDEST_STREAM = 60 * UNITS
"""How far a new stream may lie behind our clock: a minute, as MAVLink says."""
LARGEST_CROWD = 4096
"""Streams that are remembered."""
_DIGEST = 6


class Key:
    """A secret of 32 bytes. Shows itself to nobody.

    Raises:
        ValueError: it has another length.
    """

    __slots__ = ("_hash", "fingerprint")

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(secret)}; make a new one")
        self._hash = hashlib.sha256(secret)
        self.fingerprint = hashlib.sha256(b"robotree fingerprint" + secret).hexdigest()[:16]
        """Tells keys apart without telling them."""

    @classmethod
    def of_passphrase(cls, passphrase: str) -> Key:
        """The key that MAVProxy and QGroundControl make of a passphrase."""
        return cls(hashlib.sha256(passphrase.encode()).digest())

    def digest(self, data: bytes) -> bytes:
        """The six bytes that prove the key."""
        running = self._hash.copy()
        running.update(data)
        return running.digest()[:_DIGEST]

    def __repr__(self) -> str:
        return f"<Key {self.fingerprint}>"

    def __reduce__(self) -> str:
        raise TypeError("a key is never stored as a value; keep it in its file")


class SigningTime:
    """Our signing timestamp: never behind the wall clock, never the same twice, never going back.

    Args:
        clock: the wall clock, Unix time in [s].
        persisted: the `last` of an earlier run.
    """

    def __init__(self, clock: Callable[[], float], persisted: int = 0) -> None:
        self._clock = clock
        self.last = persisted
        """The latest timestamp; persist it, so that a wall clock that is set back does no harm."""

    def now(self) -> int:
        """The timestamp of this moment."""
        wall = int((self._clock() - EPOCH) * UNITS)
        self.last = max(self.last, wall)
        return self.last

    def next(self) -> int:
        """A timestamp for one frame."""
        wall = int((self._clock() - EPOCH) * UNITS)
        self.last = wall if wall > self.last else self.last + 1
        return self.last


class Signer:
    """Signs what we send on one link. A frame that is sent again must be signed again.

    Args:
        key: the link's.
        time: ours, the same for all links.
        link_id: tells our links apart, 0 to 255.
    """

    def __init__(self, key: Key, time: SigningTime, link_id: int = 0) -> None:
        self._digest, self._next, self._link = key.digest, time.next, link_id

    def sign(self, frame: bytes) -> bytes:
        """The 13 bytes that follow a complete frame whose SIGNED flag is set."""
        stamp = (self._next() << 8 | self._link).to_bytes(7, "little")
        return stamp + self._digest(frame + stamp)


class StreamTable:
    """The newest timestamp of every stream, for each key. One table serves all links."""

    def __init__(self) -> None:
        self._newest: dict[str, dict[bytes, int]] = {}

    def of(self, key: Key) -> dict[bytes, int]:
        """The newest timestamps under one key, by system, component and link id."""
        return self._newest.setdefault(key.fingerprint, {})


class VerifierStatistics(msgspec.Struct, frozen=True):
    """One reading of a verifier's gauges."""

    passed: int
    allowed: int
    """Unsigned frames that the allow-list let pass."""
    unsigned: int
    """Frames without a signature, MAVLink 1 among them, that were refused."""
    forged: int
    """Signatures that do not belong to the key."""
    replayed: int
    """Good signatures with a timestamp that is not new."""


def nothing_unsigned(frame: Frame) -> bool:  # noqa: ARG001  the strictest allow-list
    """Let no unsigned frame pass."""
    return False


class Verifier:
    """Decides which frames of one link may pass.

    Args:
        key: the link's.
        time: ours, the same for all links.
        streams: the table of all links.
        allow: which unsigned frames may pass.
    """

    def __init__(
        self,
        key: Key,
        time: SigningTime,
        streams: StreamTable,
        allow: Callable[[Frame], bool] = nothing_unsigned,
    ) -> None:
        self._digest, self._time, self._allow = key.digest, time, allow
        self._newest = streams.of(key)
        self._passed = self._allowed = self._unsigned = self._forged = self._replayed = 0

    @property
    def statistics(self) -> VerifierStatistics:
        """The gauges now."""
        return VerifierStatistics(
            passed=self._passed,
            allowed=self._allowed,
            unsigned=self._unsigned,
            forged=self._forged,
            replayed=self._replayed,
        )

    def verify(self, frame: Frame) -> bool:
        """Whether a frame may pass."""
        signature = frame.signature
        if not signature:
            allowed = self._allow(frame)
            self._allowed += allowed
            self._unsigned += not allowed
            return allowed
        proof = self._digest(frame.body + frame.checksum.to_bytes(2, "little") + signature[:7])
        if not compare_digest(proof, signature[7:]):
            self._forged += 1
            return False
        stream, timestamp = frame.body[5:7] + signature[:1], int.from_bytes(signature[1:7], "little")
        if timestamp <= self._newest.get(stream, -1) or (
            stream not in self._newest and self._is_old(timestamp)
        ):
            self._replayed += 1
            return False
        self._newest[stream] = timestamp
        self._passed += 1
        return True

    def _is_old(self, timestamp: int) -> bool:
        """Whether a stream that we do not know may not begin with this timestamp."""
        return timestamp < self._time.now() - OLDEST_STREAM or len(self._newest) >= LARGEST_CROWD
