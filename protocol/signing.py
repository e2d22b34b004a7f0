"""MAVLink 2 signing: authenticates frames and refuses replays. Pure.

A signature is the id of the link, a timestamp and the first six bytes of SHA-256 over key, frame, link id and
timestamp. Three things are done otherwise than in the tools around us, each because of a known attack:

* the hash is verified before the timestamp is believed, else one forged frame from the far future locks the
  honest speaker out for ever;
* our own time starts at the wall clock or at the time that was persisted, whichever is later, never at zero,
  and no stream begins before the moment at which we were started, else a fresh receiver accepts a recording
  of what was said to the one before it;
* one table of streams serves all links, else a recording of one link can be played on another.

The signature covers no receiver. So each controller has a key of its own (`Key.of_controller`), else a
recording of one robot can be played to another one.
"""

from __future__ import annotations

import hashlib
import hmac
from copy import copy
from hmac import compare_digest
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.frame import PROOF_BYTES

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.protocol.frame import Frame

KEY_BYTES = 32
PASSPHRASE_BYTES = 16
"""Of a controller's passphrase: 128 bits, many more than a signature has."""
EPOCH = 1420070400
"""[s] of Unix time at the beginning of 2015, when signing timestamps are 0."""
UNITS = 100_000
"""Timestamps per second: they count 10 microseconds."""
OLDEST_STREAM = 60 * UNITS
"""How far a new stream may lie behind our clock: a minute, as MAVLink says."""
LARGEST_LEAD = OLDEST_STREAM // 2
"""How far somebody else may put our clock forward; the other half is for delays, and clocks that differ."""
CLOCK_SET = (1_767_225_600 - EPOCH) * UNITS
"""2026-01-01: a clock before that was never set."""
MAX_STREAMS = 4096
"""Streams that are remembered."""
_EPOCH, _UNITS = float(EPOCH), float(UNITS)
"""Floats, because each frame that is sent multiplies with them and mixed arithmetic is slower."""


class Key:
    """A secret of 32 bytes. Shows itself to nobody.

    Raises:
        ValueError: it has another length.
    """

    __slots__ = ("_secret", "begin", "fingerprint")

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes, not {len(secret)}; make a new one")
        self._secret = secret
        self.begin = hashlib.sha256(secret).copy
        """A SHA-256 that has taken the key and waits for more."""
        self.fingerprint = hashlib.sha256(b"robotree fingerprint" + secret).hexdigest()[:16]
        """Tells keys apart without telling them."""

    def of_controller(self, name: str) -> Key:
        """The key of one controller, made from this one, for what is said to it and what it says."""
        return Key(secret_of(self.passphrase_for(name)))

    def passphrase_for(self, controller: str) -> str:
        """The passphrase of one controller; its SHA-256 is the controller's key.

        The first 16 bytes of `hkdf`, in 32 hexadecimal digits. It is a passphrase because MAVProxy and
        QGroundControl take nothing else.

        Args:
            controller: its name, usually the address where it listens.
        """
        info = b"robotree controller " + controller.encode()
        return hkdf(self._secret, info)[:PASSPHRASE_BYTES].hex()

    def reveal(self) -> str:
        """The secret itself, 64 hexadecimal digits; for its owner only."""
        return self._secret.hex()

    def __repr__(self) -> str:
        return f"<Key {self.fingerprint}>"

    def __reduce__(self) -> str:
        raise TypeError("a key is never stored as a value; keep it in its file")


def hkdf(secret: bytes, info: bytes) -> bytes:
    """32 bytes derived from a secret: the first block of HKDF with SHA-256, without salt (RFC 5869)."""
    extracted = hmac.digest(bytes(KEY_BYTES), secret, "sha256")
    return hmac.digest(extracted, info + b"\x01", "sha256")


def secret_of(passphrase: str) -> bytes:
    """The secret that MAVProxy and QGroundControl make of a passphrase: its SHA-256."""
    return hashlib.sha256(passphrase.encode()).digest()


class HeardTime:
    """The newest timestamp that was accepted from others."""

    newest = 0

    def note(self, timestamp: int) -> None:
        """A timestamp is accepted that is later than all before."""
        self.newest = timestamp


class SigningTime:
    """Our signing timestamp: never behind the wall clock, never the same twice, never going back.

    Args:
        clock: the wall clock, Unix time in [s].
        persisted: the `last` of an earlier run.
        heard: remembers the newest timestamp that was accepted from others; None: nothing is remembered.
    """

    __slots__ = ("_clock", "_passed", "heard", "last", "start")

    def __init__(
        self, clock: Callable[[], float], persisted: int = 0, heard: HeardTime | None = None
    ) -> None:
        self._clock = clock
        self.heard = heard or HeardTime()
        self.start = max(self.wall(), self.heard.newest + 1)
        """The time of the wall clock at our start, or later than all that was heard before. No stream
        begins earlier: what was said before may have been heard by the one before us, however that ended."""
        self._passed = 0.0
        """[s] of Unix time; before it the wall clock shows no timestamp that is later than `last`."""
        self.last: int = persisted
        """The latest timestamp; persist it, so that a wall clock that is set back does no harm."""

    def now(self) -> int:
        """The timestamp of this moment."""
        self.last = max(self.last, self.wall())
        return self.last

    def advance(self, moment: int) -> None:
        """Go on at a timestamp that a holder of the key names, if it is later than ours.

        But no further than `LARGEST_LEAD` ahead of the wall clock: nobody whose clock is right is locked out
        by one whose clock is wrong.
        """
        self.last = max(self.last, min(moment, self.wall() + LARGEST_LEAD))

    def next(self) -> int:
        """A timestamp for one frame."""
        clock, last = self._clock, self.last
        now = clock()
        if now < self._passed:  # frames come faster than timestamps count: a comparison is enough
            self.last = last = last + 1
            return last
        wall = int((now - _EPOCH) * _UNITS)
        self.last = last = wall if wall > last else last + 1
        self._passed = _EPOCH + last / _UNITS
        return last

    def wall(self) -> int:
        """The time of the wall clock."""
        return int((self._clock() - _EPOCH) * _UNITS)


class Signer:
    """Signs what we send on one link. A frame that is sent again must be signed again.

    Args:
        key: the link's.
        time: ours, the same for all links.
        link_id: of this link, 0 to 255.
    """

    __slots__ = ("_begin", "_link", "_time")

    def __init__(self, key: Key, time: SigningTime, link_id: int = 0) -> None:
        self._begin, self._time, self._link = key.begin, time, bytes((link_id,))

    def sign(self, frame: bytes) -> bytes:
        """A complete frame whose SIGNED flag is set, and the 13 bytes that follow it."""
        begin = self._begin
        frame += self._link + self._time.next().to_bytes(6, "little")
        running = begin()
        running.update(frame)
        return frame + running.digest()[:PROOF_BYTES]


class StreamTable:
    """The newest timestamp of every stream, for each key. One table serves all links."""

    def __init__(self) -> None:
        self._newest: dict[str, dict[bytes, int]] = {}

    def of(self, key: Key) -> dict[bytes, int]:
        """The newest timestamps under one key, by system, component and link id."""
        return self._newest.setdefault(key.fingerprint, {})


class VerifierStatistics(msgspec.Struct):
    """One reading of a verifier's gauges."""

    passed: int = 0
    unsigned: int = 0
    """Frames without a signature, MAVLink 1 among them, that were refused."""
    forged: int = 0
    """Signatures that do not belong to the key."""
    late: int = 0
    """Good signatures that would begin a stream more than a minute ago, or before we were started."""
    behind: float = 0.0
    """[s] by which the timestamp of the last of these lay behind our clock, or behind all that we accept."""
    early: int = 0
    """Good signatures more than a minute ahead of our clock."""
    ahead: float = 0.0
    """[s] by which the last of these was ahead."""
    replayed: int = 0
    """Good signatures with a timestamp that is not later than the one before in its stream."""
    repeated: int = 0
    """Those among them that have the very timestamp of the one before."""


class Verifier:
    """Decides which frames of one link may pass.

    Args:
        key: the link's.
        time: ours, the same for all links.
        streams: the table of all links.
    """

    def __init__(self, key: Key, time: SigningTime, streams: StreamTable) -> None:
        self.key = key
        """The key whose signatures pass."""
        self._begin, self._time = key.begin, time
        self._newest = streams.of(key)
        self._gauges = VerifierStatistics()

    @property
    def statistics(self) -> VerifierStatistics:
        """The gauges now."""
        return copy(self._gauges)

    def verify(self, frame: Frame, said: bytes) -> bool:
        """Whether a frame may pass.

        Args:
            frame: an intact frame.
            said: what its signature is about: all its bytes but the last six.
        """
        signature = frame.signature
        if not signature:
            self._gauges.unsigned += 1
            return False
        begin = self._begin
        running = begin()
        running.update(said)
        if not compare_digest(running.digest()[:PROOF_BYTES], signature[7:]):
            self._gauges.forged += 1
            return False
        stream, timestamp = said[5:7] + signature[:1], int.from_bytes(signature[1:7], "little")
        newest = self._newest.get(stream)
        if newest is not None and timestamp <= newest:
            self._gauges.replayed += 1
            self._gauges.repeated += timestamp == newest
            return False
        heard = self._time.heard
        if (newest is None and self._is_late(timestamp)) or self._is_early(timestamp, heard.newest):
            return False
        if timestamp > heard.newest:
            heard.note(timestamp)
        self._newest[stream] = timestamp
        self._gauges.passed += 1
        return True

    def _is_early(self, timestamp: int, newest: int) -> bool:
        """Whether a timestamp is too far ahead of our clock, and of all that was heard.

        Else who has a wrong clock once would lock out everybody else after our restart. A clock that was
        never set knows nothing of others.
        """
        if timestamp <= newest + OLDEST_STREAM:
            return False
        ahead = timestamp - self._time.now()
        if ahead <= OLDEST_STREAM or self._time.wall() < CLOCK_SET:
            return False
        self._gauges.early += 1
        self._gauges.ahead = ahead / UNITS
        return True

    def _is_late(self, timestamp: int) -> bool:
        """Whether a stream that we do not know may not begin with this timestamp."""
        now, start = self._time.now(), self._time.start
        late = timestamp < max(now - OLDEST_STREAM, start)
        if late:
            self._gauges.late += 1
            self._gauges.behind = (max(now, start) - timestamp) / UNITS
        return late or len(self._newest) >= MAX_STREAMS
