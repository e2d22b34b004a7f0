"""The frames of a recording that may be kept or sent again, and when. Pure.

Frames that carry a secret, such as a signing key in the clear, are never kept, sent again or passed on:
SETUP_SIGNING is for its receiver, over a link that nobody else reads, while a recording is shown to others
and a relay may lead to another machine.

Frames that command may be left out, so that a replay moves nothing and changes nothing. Every message with a
target counts as a command, unless it is known to ask, to answer or to measure: an unknown message, or one of
somebody's own dialect, is rather left out once too often.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.dialect.table import SECRETS, by_name, definitions
from robotree.protocol.tools.capture.framing import Splitter, msgid
from robotree.protocol.tools.capture.records import plausible_time

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from robotree.protocol.tools.capture.records import Captured

_IDS = frozenset(by_name()[name].id for name in SECRETS)
_ON_THE_WIRE = tuple(number.to_bytes(3, "little") for number in _IDS)
"""How a frame of MAVLink 2 writes them; none fits into a frame of MAVLink 1."""
_HARMLESS = frozenset(
    {
        "PING", "COMMAND_ACK", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_ERROR",
        "PARAM_EXT_REQUEST_READ", "PARAM_EXT_REQUEST_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT",
        "MISSION_REQUEST_LIST", "MISSION_REQUEST_PARTIAL_LIST", "MISSION_ACK", "LOG_REQUEST_LIST",
        "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOGGING_DATA", "LOGGING_DATA_ACKED", "LOGGING_ACK",
        "GIMBAL_DEVICE_ATTITUDE_STATUS", "AUTOPILOT_STATE_FOR_GIMBAL_DEVICE", "GLOBAL_POSITION_SENSOR",
        "ROBOTREE_GOAL_STATUS", "ROBOTREE_CLAIM_STATUS", "ROBOTREE_PICTURE_REQUEST",
    }
)  # fmt: skip
"""Messages with a target that command nothing; so are those that begin with `_BROADCAST`."""
_BROADCAST = "OPEN_DRONE_ID_"
_ELSEWHERE = frozenset({"MANUAL_CONTROL", "SERIAL_CONTROL"})
"""Commands without the usual fields for a target."""
LONGEST_GAP = 60_000_000
"""[us] of silence that are replayed; a longer one is a pause of the recorder, or a damaged time."""


def carries_secret(frame: bytes) -> bool:
    """Whether a whole frame is of a message that has a secret field."""
    return msgid(frame) in _IDS


def may_carry_secret(data: bytes) -> bool:
    """Whether whole frames, looked at quickly, may have a secret among them; False: they have none."""
    return any(number in data for number in _ON_THE_WIRE)


def commands(frame: bytes) -> bool:
    """Whether a whole frame is of a message that commands; False for an unknown message."""
    definition = definitions().get(msgid(frame))
    if definition is None:
        return False
    name = definition.name
    if definition.target_system < 0:
        return name in _ELSEWHERE
    return name not in _HARMLESS and not name.startswith(_BROADCAST)


class RecordFilter:
    """Removes frames that carry a secret.

    Args:
        passive: also remove frames that command.
    """

    def __init__(self, *, passive: bool = False) -> None:
        self._passive = passive
        self.withheld = 0
        """Removed frames with a secret."""
        self.commands = Counter[str]()
        """Removed frames that command, by the name of their message."""

    def filter(self, records: Iterable[Captured]) -> Generator[Captured]:
        """The records without the removed frames; a record with nothing left is left out.

        Yields:
            What may be sent or kept.
        """
        for record in records:
            if not self._passive and not may_carry_secret(record.data):
                yield record
                continue
            splitter = Splitter()
            pieces = splitter.feed(record.data) + splitter.flush()
            passing = [piece.data for piece in pieces if not (piece.framed and self._is_removed(piece.data))]
            if passing:
                yield msgspec.structs.replace(record, data=b"".join(passing))

    def _is_removed(self, frame: bytes) -> bool:
        if carries_secret(frame):
            self.withheld += 1
            return True
        commanding = self._passive and commands(frame)
        if commanding:
            self.commands[definitions()[msgid(frame)].name] += 1
        return commanding


def schedule(records: Iterable[Captured], speed: float = 1.0) -> Generator[tuple[float, bytes]]:
    """Each record's moment; never earlier than the one before it, even if the recording's clock was set back.

    A time that nothing was captured at is damaged, and its record follows at once; no gap is longer than
    `LONGEST_GAP`.

    Args:
        records: with times; those without one follow at once.
        speed: how many seconds of the recording pass in one; infinity: as fast as it goes.

    Yields:
        [s] after the beginning, and what is to be sent then.
    """
    elapsed, latest = 0, None
    for record in records:
        if record.time is not None and plausible_time(record.time):
            elapsed += min(max(record.time - latest, 0), LONGEST_GAP) if latest is not None else 0
            latest = record.time
        yield elapsed / 1e6 / speed, record.data
