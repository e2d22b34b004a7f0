"""One connection between two processes of a machine, and what goes over it.

A frame is four bytes of length, little-endian, and as many bytes of MessagePack: an array whose first item
says which of the classes below it is. The first frame in each direction is a `Hello`. A process that says
anything else is not one of ours, or of another version: its connection is closed. Sending never blocks, in
any thread.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Annotated, ClassVar

import msgspec

from robotree.vr.base.os_files import AT_ONCE
from robotree.vr.base.principal import Credentials
from robotree.vr.base.system import THIS_SYSTEM, Socket, System
from robotree.vr.network.refusals import RefusalKind

VERSION = 3
"""Of these frames. Two processes whose versions differ do not talk; `robotree doctor` names them."""

LONGEST_FRAME = 64 << 20
"""[bytes] A longer one is nonsense: pictures have 10 kB, the source of a virtual robot less."""

MOST_KEYS = 1 << 15
"""Keys that one process may announce. A robot needs two; a host has some thousand robots."""

LONGEST_KEY = 255
"""[bytes] of a key or a pattern that is announced."""

LONGEST_HELLO = MOST_KEYS * (LONGEST_KEY + 3) + 1024
"""[bytes] of the first frame on a connection, with all keys that its process may announce."""

PIECE = 1 << 16
"""[bytes] read in one go."""

MOST_WAITING = 64 << 20
"""[bytes] of requests and replies that may wait for one receiver; with more, its connection is closed."""

MOST_SAMPLES = 1 << 20
"""[bytes] of samples that may wait for one receiver; of more, the newest of each key are kept."""

_LENGTH = 4


class Channel(IntEnum):
    """Two processes have two connections, so that a stop waits behind nothing that is large or plenty."""

    URGENT = 0
    BULK = 1


class Topic(IntEnum):
    """The announcements of a process to the others."""

    HOLDS = 0
    """It is present under a key."""
    SERVES = 1
    """It answers requests to a key."""
    SUBSCRIBES = 2
    """It wants the samples published under a pattern."""


Key = Annotated[str, msgspec.Meta(max_length=LONGEST_KEY)]
Known = dict[Topic, Annotated[list[Key], msgspec.Meta(max_length=MOST_KEYS)]]


class Hello(msgspec.Struct, frozen=True, array_like=True, tag=0):
    """The first frame on each connection, in both directions."""

    version: int
    member: str
    """The sender: the name of its socket in the realm's folder."""
    channel: Channel
    known: Annotated[Known, msgspec.Meta(max_length=len(Topic))]
    """All that it lets others know; empty on the bulk channel."""
    ranks: Annotated[dict[Key, int], msgspec.Meta(max_length=MOST_KEYS)] = {}
    """Of the keys that it serves, where that is not 0: see `Transport.serve`."""


class News(msgspec.Struct, frozen=True, array_like=True, tag=1):
    """One change of what a process lets others know."""

    topic: Topic
    key: Key
    there: bool
    rank: int = 0
    """Of a key that it serves: see `Transport.serve`."""


class AskFrame(msgspec.Struct, frozen=True, array_like=True, tag=2):
    """A request."""

    number: int
    """Of the request, among those of the asker."""
    key: str
    body: bytes


class ReplyFrame(msgspec.Struct, frozen=True, array_like=True, tag=3):
    """One of the replies to a request."""

    number: int
    body: bytes


class EndFrame(msgspec.Struct, frozen=True, array_like=True, tag=4):
    """The last frame about a request."""

    number: int
    last: bytes | None
    """One more reply."""
    elsewhere: bool = False
    """Whether somebody else serves the key from now on, who is to be asked."""


class Sample(msgspec.Struct, frozen=True, array_like=True, tag=5):
    """Something published."""

    key: str
    body: bytes


class Awake(msgspec.Struct, frozen=True, array_like=True, tag=6):
    """Sent by a process that has slept: the others need not wait for its next beat."""


LinkFrame = Hello | News | AskFrame | ReplyFrame | EndFrame | Sample | Awake

_encode = msgspec.msgpack.Encoder().encode
_decoder: msgspec.msgpack.Decoder[LinkFrame] = msgspec.msgpack.Decoder(LinkFrame)


class NotAFrame(ValueError):
    """The data is no frame, or none that may come now."""

    kind: ClassVar[RefusalKind] = "nonsense"


class Impostor(NotAFrame):
    """A process says that it is another one."""

    kind: ClassVar[RefusalKind] = "identity"


class Greedy(NotAFrame):
    """A process announces more than is taken of one."""

    kind: ClassVar[RefusalKind] = "keys"


def pack(frame: LinkFrame) -> bytes:
    """Return a frame's bytes, its length first."""
    body = _encode(frame)
    return len(body).to_bytes(_LENGTH, "little") + body


class Unpacker:
    """Cuts a stream into frames."""

    def __init__(self, longest: int = LONGEST_FRAME) -> None:
        """Begin at the start of a stream.

        Args:
            longest: [bytes] of a frame; a longer one is none.
        """
        self.longest = longest
        self._rest = bytearray()

    @property
    def size(self) -> int:
        """Return how much of a frame that is not complete has come [bytes]."""
        return len(self._rest)

    def feed(self, data: bytes) -> Iterator[LinkFrame]:
        """Take the next piece of the stream; read the iterator to its end.

        Returns:
            The frames that are complete now, in their order.

        Raises:
            NotAFrame: what came is none; nothing that follows can be read either. The iterator may raise it.
        """
        if not self._rest and int.from_bytes(data[:_LENGTH], "little") == len(data) - _LENGTH:
            return iter((_read(memoryview(data)[_LENGTH:]),))  # one whole frame, as nearly always
        return self._cut(data)

    def _cut(self, data: bytes) -> Iterator[LinkFrame]:
        self._rest += data
        begin = 0
        try:
            while len(self._rest) - begin >= _LENGTH:
                length = int.from_bytes(self._rest[begin : begin + _LENGTH], "little")
                if length > self.longest:
                    raise NotAFrame(f"a frame of {length} bytes; the longest has {self.longest}")
                end = begin + _LENGTH + length
                if len(self._rest) < end:
                    return
                body = bytes(self._rest[begin + _LENGTH : end])
                begin = end
                yield _read(body)
        finally:
            del self._rest[:begin]


def _read(body: bytes | memoryview) -> LinkFrame:
    try:
        return _decoder.decode(body)
    except msgspec.MsgspecError as error:
        raise NotAFrame(str(error)) from None


class Overflow(Exception):
    """The receiver does not read, and no more can wait for it."""


class PeerLink:
    """One end of a connection.

    Frames and samples wait in two queues, frames first. A frame that has begun to leave is finished first.
    """

    def __init__(
        self,
        sock: Socket,
        *,
        channel: Channel | None = None,
        member: str = "",
        wants_to_write: Callable[[PeerLink], None],
        system: System = THIS_SYSTEM,
    ) -> None:
        """Take a connected socket.

        Args:
            sock: it is the link's from now on.
            channel: what it is for; None: the far end dialed, and has yet to say so.
            member: who is at the far end; empty: as above.
            wants_to_write: called in any thread when something waits; `flush` sends it on.
            system: of which the socket is one.
        """
        sock.setblocking(False)
        self.socket, self.channel, self.member = sock, channel, member
        self.dialed = bool(member)
        """Whether this side dialed."""
        self.introduced = False
        """Whether the far end has said hello."""
        self.refused = False
        """Whether the far end will close it for another one, so that its messages here do not count."""
        self.closed = False
        self.full = False
        """Whether the last piece was a whole one, so that more may have come."""
        self._wants_to_write = wants_to_write
        self._unpacker = Unpacker(LONGEST_HELLO)
        self._lock = system.lock()
        self._frames: deque[bytes | memoryview] = deque()
        self._frames_size = 0
        self._samples: deque[tuple[str, bytes]] = deque()
        self._samples_size = 0
        self.far_end = Credentials(*system.far_end(sock))

    @property
    def incomplete(self) -> int:
        """Return how much of a frame that is not complete has come [bytes]."""
        return self._unpacker.size

    def introduce(self) -> None:
        """The far end has said hello; longer frames may come now."""
        self.introduced = True
        self._unpacker.longest = LONGEST_FRAME

    def send(self, packed: bytes) -> None:
        """Send a frame, now or when there is room; on a closed link it is lost.

        Raises:
            Overflow: too much waits already.
        """
        with self._lock:
            if self.closed:
                return
            rest = packed if self._frames else self._push(packed)
            if not rest:
                return
            if self._frames_size > MOST_WAITING:
                raise Overflow(self.member)
            self._frames.append(rest)
            self._frames_size += len(rest)
        self._wants_to_write(self)

    def publish(self, key: str, packed: bytes) -> None:
        """Send a sample, now or when there is room. A receiver that is too slow misses older ones."""
        with self._lock:
            if self.closed:
                return
            if not self._frames and not self._samples:
                rest = self._push(packed)
                if not rest:
                    return
                if len(rest) < len(packed):
                    self._frames.append(rest)
                    self._frames_size += len(rest)
                    packed = b""
            if packed:
                self._samples.append((key, packed))
                self._samples_size += len(packed)
                if self._samples_size > MOST_SAMPLES:
                    self._keep_newest()
        self._wants_to_write(self)

    def flush(self) -> bool:
        """Send what waits, as far as there is room; returns whether something waits still."""
        with self._lock:
            while not self.closed:
                if not self._frames:
                    if not self._samples:
                        return False
                    _, packed = self._samples.popleft()
                    self._samples_size -= len(packed)
                    self._frames.append(packed)
                    self._frames_size += len(packed)
                frame = self._frames.popleft()
                self._frames_size -= len(frame)
                if rest := self._push(frame):
                    self._frames.appendleft(rest)
                    self._frames_size += len(rest)
                    return True
            return False

    def receive(self) -> Iterator[LinkFrame]:
        """Read once; returns the frames that are complete, as an iterator to be read to its end.

        Raises:
            EOFError: the far end has closed, or its process has died.
            NotAFrame: it speaks nonsense.
            BlockingIOError: nothing has come.
        """
        try:
            data = self.socket.recv(PIECE)
        except BlockingIOError:
            raise
        except OSError:
            data = b""
        if not data:
            raise EOFError
        self.full = len(data) == PIECE
        return self._unpacker.feed(data)

    def close(self) -> None:
        """End the connection; what has left arrives, what waits does not. Twice is once."""
        with self._lock:
            if not self.closed:
                self.closed = True
                self._frames.clear()
                self._samples.clear()
                self.socket.close()

    def _push(self, packed: bytes | memoryview) -> bytes | memoryview:
        """Send what there is room for; return the rest."""
        try:
            sent = self.socket.send(packed, AT_ONCE)
        except BlockingIOError:
            return packed
        except OSError:  # the far end is gone; the reading side sees it too
            return b""
        return b"" if sent == len(packed) else memoryview(packed)[sent:]

    def _keep_newest(self) -> None:
        """Keep the newest sample of each key; if these are too many, the half that is newer."""
        newest = dict(self._samples)
        for key, _ in list(self._samples):
            newest[key] = newest.pop(key)  # to the place of its newest sample
        self._samples = deque(newest.items())
        self._samples_size = sum(len(packed) for packed in newest.values())
        while self._samples_size > MOST_SAMPLES // 2 and len(self._samples) > 1:
            self._samples_size -= len(self._samples.popleft()[1])
