"""What must not be kept or passed on: frames that carry a secret, such as a signing key in the clear. Pure.

MAVLink asks for it: SETUP_SIGNING is for the one who is addressed, over a link that nobody else reads. A
recording is shown to others, and a relay may lead to another machine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.capture.commanding import commands
from robotree.protocol.capture.framing import Splitter, msgid
from robotree.protocol.dialect.table import SECRETS, by_name

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from robotree.protocol.capture.captured import Captured

_IDS = frozenset(by_name()[name].id for name in SECRETS)
_ON_THE_WIRE = tuple(number.to_bytes(3, "little") for number in _IDS)
"""How a frame of MAVLink 2 writes them; none fits into a frame of MAVLink 1."""


def carries_secret(frame: bytes) -> bool:
    """Whether a whole frame is of a message that has a secret field."""
    return msgid(frame) in _IDS


class Sieve:
    """Lets captured frames pass, but none that carries a secret.

    Args:
        passive: nor one that commands somebody.
    """

    def __init__(self, *, passive: bool = False) -> None:
        self._passive = passive
        self.withheld = 0
        """Frames with a secret that did not pass."""
        self.commands = 0
        """Frames that command and did not pass."""

    def sift(self, records: Iterable[Captured]) -> Generator[Captured]:
        """The records, each without its frames that do not pass; one with nothing left is left out.

        Yields:
            What may be sent or kept.
        """
        for record in records:
            if not self._passive and not any(number in record.data for number in _ON_THE_WIRE):
                yield record
                continue
            splitter = Splitter()
            pieces = splitter.feed(record.data) + splitter.flush()
            passing = [piece.data for piece in pieces if not (piece.framed and self._holds_back(piece.data))]
            if passing:
                yield msgspec.structs.replace(record, data=b"".join(passing))

    def _holds_back(self, frame: bytes) -> bool:
        if carries_secret(frame):
            self.withheld += 1
            return True
        commanding = self._passive and commands(frame)
        self.commands += commanding
        return commanding
