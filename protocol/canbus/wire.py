"""One connection to another member of the bus. It never blocks.

What the far end has not read fills the system's buffers first and then a backlog. A far end that lets the
backlog grow to its bound and reads nothing at all for `STALLED_AFTER` seconds is *stalled*: from then on
frames for it are dropped and counted, until it has read everything. It cannot hold up the others.
"""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

from robotree.protocol.canbus.records import Records

if TYPE_CHECKING:
    from can import Message

BOUND = 256 * 1024
"""[bytes] of the backlog; about 3000 frames of 64 bytes."""
STALLED_AFTER = 0.25
"""[s] for which it reads nothing."""
GLANCE = 0.1
"""[s] that one look counts at most. Who looks again much later was withheld the processor, and so perhaps was
the far end, which may live in the same process."""
SYSTEM_BUFFER = 256 * 1024
"""[bytes] that the system keeps for us on either side."""
_CHUNK = 64 * 1024


class Wire:
    """Records out and in. `put` and `flush` under the owner's lock, `read` by one thread.

    Args:
        connection: to the far end, which has introduced itself.
        token: the far end's.
        channel: what `Message.channel` shall say.
    """

    def __init__(self, connection: socket.socket, token: int, channel: str) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SYSTEM_BUFFER)
        self.connection, self.token = connection, token
        self.descriptor = connection.fileno()
        self.stalled = False
        self.dropped = 0
        """Frames that a stalled far end did not get."""
        self._records = Records(channel)
        self._backlog = bytearray()
        self._looked = self._idle = 0.0

    @property
    def waits(self) -> bool:
        """Whether there is a backlog to flush."""
        return bool(self._backlog)

    @property
    def full(self) -> bool:
        """Whether the backlog has reached its bound, and the far end may still make room."""
        return len(self._backlog) >= BOUND and not self.stalled

    @property
    def intact(self) -> bool:
        """False: what came is no record; the connection is of no more use."""
        return self._records.intact

    def put(self, record: bytes, now: float) -> bool:
        """Send a record, or put it into the backlog, or drop it if the far end is stalled.

        Returns:
            Whether there is a backlog that was not there before.

        Raises:
            OSError: the far end has gone.
        """
        if self.stalled:
            self.dropped += 1
        elif self._backlog:
            self._backlog += record
        elif (sent := self._send(record)) < len(record):
            self._backlog += record[sent:]
            self._looked, self._idle = now, 0.0
            return True
        return False

    def flush(self, now: float) -> None:
        """Send from the backlog what the system takes.

        Raises:
            OSError: the far end has gone.
        """
        sent = self._send(self._backlog)
        del self._backlog[:sent]
        self._idle = 0.0 if sent else self._idle + min(now - self._looked, GLANCE)
        self._looked = now
        if not self._backlog:
            self.stalled = False
        elif len(self._backlog) >= BOUND and self._idle > STALLED_AFTER:
            self.stalled = True

    def read(self) -> list[Message] | None:
        """The frames that have come; None: the far end has gone."""
        try:
            data = self.connection.recv(_CHUNK)
        except BlockingIOError:
            return []
        except OSError:
            return None
        return self._records.feed(data) if data else None

    def _send(self, data: bytes | bytearray) -> int:
        try:
            return self.connection.send(data)
        except BlockingIOError:
            return 0
