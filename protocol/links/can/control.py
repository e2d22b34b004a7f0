"""How two nodes of a bus agree that there is a link between them. Pure.

CAN knows no connections, and a handler wants to be told when the far end has gone. So a host opens a session,
both ends send ALIVE every `ALIVE_PERIOD`, and the end that closes the session sends CLOSE. A control frame is
not ISO-TP; its data field is::

    code, version, session (4)

The session is a number that the host draws by chance. A controller or a host that knows nothing of this, and
just sends MAVLink, is a partner too: then its frames are its signs of life, and silence is judged by the
one heartbeat per second that MAVLink asks for.
"""

from __future__ import annotations

import struct
from enum import IntEnum

import msgspec

VERSION = 1
ALIVE_PERIOD = 0.4
"""[s] between two signs of life."""
SILENCE = 2.0
"""[s] without any frame after which a partner that sends signs of life has gone."""
SILENCE_OF_STRANGERS = 3.5
"""[s] The same for one that sends just heartbeats, one per second."""

_FORMAT = struct.Struct(">BBI")


class Code(IntEnum):
    """The meaning of a control frame."""

    CLAIM = 1
    """A controller asks everybody: does my number belong to another one?"""
    OPEN = 2
    """A host asks a controller for a session."""
    ACCEPT = 3
    """The controller grants it."""
    REFUSE = 4
    """The number belongs to somebody else."""
    ALIVE = 5
    """The session goes on."""
    CLOSE = 6
    """The session has ended, or there is none."""


class Control(msgspec.Struct, frozen=True):
    """One control frame."""

    code: Code
    session: int

    def encode(self) -> bytes:
        """As a data field."""
        return _FORMAT.pack(self.code, VERSION, self.session)


def read(field: bytes) -> Control | None:
    """From a data field, perhaps with padding behind it; None: it says nothing we know. Never raises."""
    if len(field) < _FORMAT.size:
        return None
    code, version, session = _FORMAT.unpack_from(field)
    if version != VERSION or code not in Code.__members__.values():
        return None
    return Control(Code(code), session)


class SilenceTimer:
    """Whether the partner is still there, and when to say that we are.

    Args:
        now: [s]
        session: None: the partner knows nothing of sessions.
        silence: [s] after which it has gone; None: the usual.
    """

    def __init__(self, now: float, session: int | None, silence: float | None = None) -> None:
        self.session = session
        self.heard = now
        """When the partner's latest frame came, [s]."""
        usual = SILENCE_OF_STRANGERS if session is None else SILENCE
        self.silence = usual if silence is None else silence
        self._alive_due = now + ALIVE_PERIOD

    @property
    def due(self) -> float:
        """When to call `tick` again, [s]."""
        return min(self._alive_due, self.heard + self.silence)

    def gone(self, now: float) -> bool:
        """Whether the partner has been silent too long."""
        return now - self.heard >= self.silence

    def tick(self, now: float) -> Control | None:
        """The sign of life to send now, if it is time; a partner without sessions gets none."""
        if now < self._alive_due:
            return None
        self._alive_due = now + ALIVE_PERIOD
        return None if self.session is None else Control(Code.ALIVE, self.session)
